"""A distributed run: one process per robot, one for the plant, and this one around them.

Every child is started anew (never forked), with its standard input as a leash:
when this process closes it, or dies, the child ends. The plant's record stream
comes through a pipe, so all that was sent before a death can still be read.
"""

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from formation.bus import LOOPBACK
from formation.record import Event, Outcome, Record, Sink, read
from formation.scenario import Scenario

GRACE_S = 1.5
"""How long children have to end by themselves before they are killed."""


class Launch:
    """Spawns the processes of one run and passes the plant's records to ``sink``."""

    def __init__(
        self, scenario_file: Path, scenario: Scenario, name: str, sink: Sink, logs: Path
    ) -> None:
        self._sink = sink
        self._logs = logs
        self._outcome: Outcome | None = None
        self._last_t_ns = 0
        self._stopping = False
        logs.mkdir(parents=True, exist_ok=True)
        endpoint = f"tcp/{LOOPBACK}:{_free_port()}"
        common = ["--run", name, "--leash"]
        self.plant = self._spawn(
            "plant", [str(scenario_file), "--listen", endpoint, "--record", "-", *common]
        )
        self.robots = {
            robot: self._spawn(
                "agent", ["--robot", str(robot), "--connect", endpoint, *common], f"robot-{robot}"
            )
            for robot in scenario.ids
        }
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def wait(self, stopped: Callable[[], bool], tick: Callable[[], None]) -> Outcome:
        """Until the run has ended one way or another; ``tick`` is called about ten times a second.

        When it returns, no child is left and every record has gone to the sink.
        """
        try:
            while self._reader.is_alive():
                self._reader.join(0.1)
                if stopped():
                    self._stop()
                else:
                    self._notice_early_deaths()
                tick()
        finally:
            self._end_children()
        self._reader.join()
        if self._outcome is None:
            self._outcome = Outcome("broken", self._last_t_ns, None, self._why_broken())
            self._sink(self._outcome)
        return self._outcome

    def _read(self) -> None:
        assert self.plant.stdout is not None
        for record in read(self.plant.stdout):  # type: ignore[arg-type]
            self._take(record)

    def _take(self, record: Record) -> None:
        if isinstance(record, Outcome):
            self._outcome = record
        elif isinstance(record, Event):
            self._last_t_ns = record.t_ns
        self._sink(record)

    def _stop(self) -> None:
        """Let go of the plant's leash: it tells the robots, reports and ends. Then force."""
        if not self._stopping:
            self._stopping = True
            self._kill_at = time.monotonic() + GRACE_S
            _release(self.plant)
        elif time.monotonic() > self._kill_at:
            self.plant.kill()

    def _notice_early_deaths(self) -> None:
        """A robot that died before the plant knew it is nobody's loss but ours to notice."""
        dead = [robot for robot, child in self.robots.items() if child.poll() not in (None, 0)]
        if dead and not self._stopping and self.plant.poll() is None:
            now = time.monotonic()
            if not hasattr(self, "_dead_since"):
                self._dead_since = now
            elif now - self._dead_since > GRACE_S and self._outcome is None:
                self._stop()

    def _why_broken(self) -> str:
        for robot, child in self.robots.items():
            if child.returncode not in (0, None) and not self._killed(child):
                return f"robot {robot} exited with code {child.returncode}: {self._log_end(f'robot-{robot}')}"
        code = self.plant.returncode
        how = f"was killed by signal {-code}" if code is not None and code < 0 else f"exited with code {code}"
        return f"the plant {how}: {self._log_end('plant')}"

    def _killed(self, child: "subprocess.Popen[bytes]") -> bool:
        return child.returncode is not None and child.returncode < 0

    def _log_end(self, name: str) -> str:
        path = self._logs / f"{name}.log"
        lines = path.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1] if lines else f"nothing in {path}"

    def _end_children(self) -> None:
        children = [self.plant, *self.robots.values()]
        for child in children:
            _release(child)
        deadline = time.monotonic() + GRACE_S
        for child in children:
            try:
                child.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()

    def _spawn(self, command: str, arguments: list[str], log: str = "plant") -> "subprocess.Popen[bytes]":
        with (self._logs / f"{log}.log").open("wb") as errors:
            return subprocess.Popen(
                [sys.executable, "-m", "lab.cli", command, *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE if command == "plant" else errors,
                stderr=errors,
                start_new_session=True,  # Ctrl-C reaches this process alone, which ends the others in order
            )


def _release(child: "subprocess.Popen[bytes]") -> None:
    if child.stdin is not None:
        with suppress(OSError):
            child.stdin.close()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])
