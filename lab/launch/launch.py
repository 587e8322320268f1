"""A distributed run: one process per robot, one for the plant, and this one around them.

Every child is started anew (never forked), with its standard input as a leash:
when this process closes it, or dies, the child ends. The plant's record stream
comes through a pipe, so all that was sent before a death can still be read; what it
says befalls robots (kill, restart, pause, resume) is done to their processes here.
"""

import os
import queue
import signal
import socket
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

from formnet.agent.law_file import LawFile
from formnet.formation.briefing.plan import Plan
from formnet.formation.machines.generations import Generations
from formnet.formation.records.checked import Malformed
from formnet.formation.records.events import (
    Event,
    Kill,
    Lost,
    Pause,
    Restart,
    Resume,
    Started,
)
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.rows import Samples
from formnet.formation.records.stream import Sink, Stir, read
from formnet.formation.wire.bus import LEASE_S, LOOPBACK
from formnet.formation.wire.process import END_OF_PLAN
from formnet.lab.launch.hub_log import LOG_FILTER, HubLog
from formnet.lab.launch.interpreter import module
from formnet.lab.launch.logs import keep
from formnet.lab.launch.signals import GRACE_S
from formnet.plant.host import FAREWELL_S, START_PATIENCE_S

_LOOK_S = 0.1


class Child(Protocol):
    """A process that was started: here (:class:`LocalChild`) or on another host."""

    returncode: int | None

    def poll(self) -> int | None:
        """Its exit code; None while it runs."""

    def wait(self, timeout: float | None = None) -> int:
        """Its exit code, once it has ended. Raises TimeoutError, subprocess.TimeoutExpired."""

    def send_signal(self, number: int) -> None:
        """Send it a signal, unless it has ended."""

    def kill(self) -> None:
        """End it by force."""

    def release(self) -> None:
        """Let go of its leash: it ends in order."""


class LocalChild(subprocess.Popen[bytes]):
    """A child on this machine."""

    def tell(self, data: bytes) -> None:
        """Write ``data`` to its standard input, which stays open, on a thread of its own."""
        assert self.stdin is not None
        stream = open(os.dup(self.stdin.fileno()), "wb", buffering=0)  # noqa: SIM115

        def write() -> None:
            left = memoryview(data)
            with stream, suppress(OSError):  # it has ended
                while left:
                    left = left[stream.write(left) :]

        threading.Thread(target=write, daemon=True).start()

    def release(self) -> None:
        """See :class:`Child`."""
        if self.stdin is not None:
            with suppress(OSError):
                self.stdin.close()


StartElsewhere = Callable[[int, list[str], Path], Child | None]
"""Starts a robot's process with these arguments on its host, logging to a file; None: not there."""


@dataclass(frozen=True)
class Place:
    """Where a run's processes meet, and how they know each other.

    ``endpoint`` is where the plant listens (None: a free port on loopback) or, with ``routed``,
    a Zenoh router that is there already. ``keys`` is the folder of this machine's keys,
    ``plaintext`` whether an endpoint off loopback may go without; ``elsewhere`` starts robots that
    are not to run here; ``private``, if given, takes what it tells of machines from a log's line.
    """

    endpoint: str | None = None
    keys: Path | None = None
    plaintext: bool = False
    routed: bool = False
    elsewhere: StartElsewhere = lambda *_: None
    private: Callable[[str], str] | None = None

    @property
    def options(self) -> list[str]:
        """What every process on this machine is told."""
        found = [] if self.keys is None else ["--keys", str(self.keys)]
        return found + (["--plaintext"] if self.plaintext else [])


Begun = Callable[[str, str], None]
"""Is told a run's endpoint and its name on the bus, before its robots are started."""
HERE = Place()
"""All on this machine, on loopback."""


class Launch:
    """The processes of one run; the plant's records go to ``sink`` on a thread of its own.

    The plant is told ``plan`` through its leash; nothing is read from a file. ``name`` is the
    run's id on the bus, ``logs`` where each child's standard error goes. ``endpoint`` is where the
    plant listens; ``begun`` is told before the robots are started. ``law`` is a file whose law
    robots on this machine execute, if it is still what was read.

    Raises:
        OSError: ``logs`` cannot be made, or a process not be started.
        Exception: what ``place.elsewhere`` or ``begun`` raised; nothing is left running then.
    """

    def __init__(
        self,
        plan: Plan,
        name: str,
        sink: Sink,
        logs: Path,
        place: Place = HERE,
        begun: Begun = lambda *_: None,
        law: LawFile | None = None,
    ) -> None:
        self._place = place
        self._sink = sink
        self._robot_ids = plan.ids
        self._logs = logs
        self._outcome: Outcome | None = None
        self._blame: Outcome | None = None  # what the launcher saw and the plant cannot
        self._t_ns = 0
        self._hung = False  # the plant, by all appearances
        self._nonsense: str | None = None  # an invalid record of the plant
        self._asked = False  # to end, by the user
        self._kill_at: float | None = None  # set once the run is being stopped
        self._todo: queue.SimpleQueue[Event | Stir | None] = queue.SimpleQueue()
        self._quiet = 0  # how often this process has looked since the plant's last record
        self._patience_s = START_PATIENCE_S + plan.run.patience_s  # with the plant, ...
        self._later_patience_s = FAREWELL_S + 3.0 * plan.run.patience_s  # ... once it runs
        self._written_off: set[int] = set()  # killed as planned, or lost: no cause for alarm
        self._lives: Counter[int] = Counter()
        self._law = ["--law", law.argument, "--law-sha256", law.sha256] if law else []
        self._log_readers: dict[str, threading.Thread] = {}
        self._hub_log: HubLog | None = None  # of the plant, if it is the hub
        if place.keys is not None and not place.routed:
            self._hub_log = HubLog(plan, name, Generations.read(place.keys))
        self._common = common = ["--run", name, "--leash"]
        paused = any(some.verb == "pause" for some in plan.roster().happenings())
        if place.endpoint is not None and not paused:  # a stopped process says nothing either
            common += ["--lease", str(LEASE_S)]
        logs.mkdir(parents=True, exist_ok=True)
        scheme = "tcp" if place.keys is None else "tls"
        self.endpoint = endpoint = place.endpoint or f"{scheme}/{LOOPBACK}:{free_port()}"
        self.plant = self._spawn(
            "plant",
            [
                "plant",
                "-",
                "--connect" if place.routed else "--listen",
                endpoint,
                "--record",
                "-",
                "--start-patience",
                str(START_PATIENCE_S),
                *common,
                *place.options,
            ],
        )
        self.plant.tell(plan.pack().encode() + END_OF_PLAN)
        self.robots: dict[int, Child] = {}
        try:
            begun(endpoint, name)
            for robot in plan.ids:
                self.robots[robot] = self._spawn_robot(robot)
        except Exception:
            end([self.plant, *self.robots.values()], time.monotonic() + GRACE_S)
            raise
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def wait(self, stopped: Callable[[], bool]) -> Outcome:
        """Until the run has ended one way or another.

        Once ``stopped``, which is asked about ten times a second, says so, the run is ended in
        order within GRACE_S, or else by force. On return no child is left and every record has
        gone to the sink.
        """
        dead_since: float | None = None
        try:
            while self._reader.is_alive():
                self._do_next()
                self._quiet += 1
                now, asked = time.monotonic(), stopped()
                dead = self._dead_robots()
                if not dead:
                    dead_since = None
                elif dead_since is None:
                    dead_since = now
                if self._kill_at is not None:
                    if now > self._kill_at:
                        self.plant.kill()
                elif asked:
                    self._asked = True
                    self._stop()
                elif dead_since is not None and now - dead_since > GRACE_S and not self._outcome:
                    # The plant notices the death of a robot that has joined; this one had not.
                    self._blame = self._failure(dead[0])
                    self._stop()
                elif self._quiet * _LOOK_S > self._patience_s:
                    self._hung = True
                    self.plant.kill()
        finally:
            deadline = self._kill_at or time.monotonic() + GRACE_S
            end([self.plant, *self.robots.values()], deadline)
        self._reader.join()
        for thread in self._log_readers.values():
            thread.join(GRACE_S)
        if self._outcome is None and self._asked:  # the plant was not there yet, to say so
            self._outcome = Outcome("interrupted", self._t_ns, None, "stopped by the user")
            self._sink(self._outcome)
        elif self._outcome is None or self._outcome.kind == "broken":
            code = self.plant.returncode
            how = f"was killed by signal {-code}" if code < 0 else f"exited with code {code}"
            if self._nonsense is not None:
                how = f"{self._nonsense} and was killed"
            elif self._hung:
                how = f"reported nothing for {self._patience_s:g} s and was killed"
            reason = f"the plant {how}{self._last_words('plant')}"
            self._outcome = Outcome("broken", self._t_ns, None, reason)
            self._sink(self._outcome)
        return self._outcome

    def _read(self) -> None:
        try:
            self._read_records()
        except Malformed as error:  # nothing that follows can be trusted
            self._nonsense = f"sent an invalid record ({error})"
            self.plant.kill()
        self._todo.put(None)

    def _read_records(self) -> None:
        assert self.plant.stdout is not None
        for record in read(self.plant.stdout, self._robot_ids):
            if isinstance(record, Outcome):
                record = self._outcome = self._blame or record
            elif isinstance(record, Samples) and record.rows:
                self._t_ns = record.rows[-1].t_ns
            self._quiet = 0
            if not isinstance(record, Stir):
                self._sink(record)
            if isinstance(record, Started):
                self._patience_s = self._later_patience_s
            if isinstance(record, Event | Stir):
                self._todo.put(record)

    def _logged(self, line: str, hub_log: HubLog | None = None) -> str | None:
        """What a log keeps of a line; the sink is told whom the hub refuses or disconnects."""
        kept: str | None = line
        if hub_log is not None:
            kept, event = hub_log.read(line, self._t_ns)
            if event is not None:
                self._sink(event)
        private = self._place.private
        return kept if kept is None or private is None else private(kept)

    def _do_next(self) -> None:
        """Do to robots' processes what the plant says has happened, as soon as it says so."""
        try:
            event = self._todo.get(timeout=_LOOK_S)
        except queue.Empty:
            return
        match event:
            case None:
                self._reader.join()
            case Stir(robots=robots, running=running):
                self._signal(robots, signal.SIGCONT if running else signal.SIGSTOP)
            case Lost(robot=robot):
                self._kill([robot])
            case Kill(robots=robots):
                self._kill(robots)
            case Restart(robots=robots):
                for robot in robots:
                    self.robots[robot].wait()
                    self._lives[robot] += 1
                    self.robots[robot] = self._spawn_robot(robot)
                self._written_off.difference_update(robots)
            case Pause(robots=robots):
                self._signal(robots, signal.SIGSTOP)
            case Resume(robots=robots):
                self._signal(robots, signal.SIGCONT)

    def _kill(self, robots: Iterable[int]) -> None:
        self._written_off.update(robots)
        for robot in robots:
            self.robots[robot].kill()

    def _signal(self, robots: Iterable[int], number: int) -> None:
        for robot in robots:
            self.robots[robot].send_signal(number)  # not to one that has ended

    def _stop(self) -> None:
        """Let go of the plant's leash: it tells the robots, reports and ends."""
        self._kill_at = time.monotonic() + 0.7 * GRACE_S
        self.plant.release()

    def _dead_robots(self) -> list[int]:
        return [
            robot
            for robot, child in self.robots.items()
            if robot not in self._written_off and child.poll() not in (None, 0)
        ]

    def _failure(self, robot: int) -> Outcome:
        code = self.robots[robot].returncode
        words = self._last_words(self._log_of(robot))
        return Outcome("failed", self._t_ns, robot, f"exited with code {code}{words}")

    def _last_words(self, name: str) -> str:
        if name in self._log_readers:
            self._log_readers[name].join(GRACE_S)
        text = (self._logs / f"{name}.log").read_text(encoding="utf-8", errors="replace")
        lines = text.strip().splitlines()
        return f": {lines[-1]}" if lines else ""

    def _spawn_robot(self, robot: int) -> Child:
        arguments = ["agent", "--robot", str(robot), "--connect", self.endpoint, *self._common]
        name = self._log_of(robot)
        child = self._place.elsewhere(robot, arguments, self._logs / f"{name}.log")
        return child or self._spawn(name, [*arguments, *self._place.options, *self._law])

    def _log_of(self, robot: int) -> str:
        life = self._lives[robot]
        return f"robot-{robot}" + (f"-life-{life}" if life else "")

    def _spawn(self, name: str, arguments: list[str]) -> LocalChild:
        plant = name == "plant"
        hub_log = self._hub_log if plant else None
        read = hub_log is not None or self._place.private is not None
        file = self._logs / f"{name}.log"
        with file.open("wb") as log:
            child = LocalChild(
                module("formnet", *arguments),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE if plant or read else log,
                stderr=(subprocess.PIPE if plant else subprocess.STDOUT) if read else log,
                env=None if hub_log is None else os.environ | {"RUST_LOG": LOG_FILTER},
                start_new_session=True,  # Ctrl-C reaches the launcher alone; it ends the others
            )
        stream = child.stderr if plant else child.stdout
        if stream is not None:
            line = partial(self._logged, hub_log=hub_log)
            self._log_readers[name] = keep(stream, file, line)
        return child


def end(children: Sequence[Child], deadline: float) -> None:
    """Release every child's leash; kill what is still there at ``deadline`` (monotonic seconds)."""
    for child in children:
        child.release()
    for child in children:
        try:
            child.wait(max(0.0, deadline - time.monotonic()))
        except (subprocess.TimeoutExpired, TimeoutError):
            child.kill()
            child.wait()


def free_port() -> int:
    """A TCP port that is free on loopback now."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])
