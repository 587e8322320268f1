"""Somebody who watches from the first tick on: ``formnet run --view`` and ``--web``."""

import queue
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path

from formnet.lab.launch.interpreter import module
from formnet.lab.launch.launch import LocalChild, end
from formnet.lab.launch.logs import keep
from formnet.lab.launch.signals import GRACE_S
from formnet.lab.machines.place import Where

_START_S = 30.0


class Watcher:
    """A ``formnet monitor`` with the view ``"web"`` or ``"window"``, beside a run in ``folder``.

    It is a process of its own, of the lowest priority: what becomes of it is nothing to the run.
    ``private`` takes from its log what it tells of machines.
    """

    def __init__(
        self,
        view: str,
        folder: Path,
        where: Where,
        say: Callable[[str], None],
        private: Callable[[str], str],
    ) -> None:
        self._view, self._folder, self._where, self._say = view, folder, where, say
        self._private = private
        self._complaints: list[str] = []
        self._child: LocalChild | None = None
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()

    def join(self, endpoint: str, run: str) -> None:
        """Start it, and wait until it sees what happens; if it does not, say so and go on."""
        options = ["--connect", endpoint, "--run", run, "--leash"]
        options += ["--web"] if self._view == "web" else ["--view"]
        if self._where.keys is not None:
            options += ["--keys", str(self._where.keys)]
        options += ["--plaintext"] if self._where.plaintext else []
        self._child = LocalChild(
            module("formnet", "monitor", *options),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        assert self._child.stderr is not None
        log = keep(self._child.stderr, self._folder / "logs" / "monitor.log", self._logged)
        threading.Thread(target=self._read, args=(self._child,), daemon=True).start()
        try:
            said = self._lines.get(timeout=_START_S)
            if said is None:  # it has ended
                log.join(GRACE_S)
        except queue.Empty:
            said = None
        if said is not None:
            self._say(said)
            return
        text = "".join(self._complaints).strip()
        self._say("the monitor did not start: " + (text or f"no sign of it after {_START_S:g} s"))

    def stay(self, stopped: Callable[[], bool]) -> None:
        """After the run: keep the page until ``stopped``, or let the window have the rest."""
        child = self._child
        if child is None:
            return
        if self._view == "web" and child.poll() is None:
            self._say("the page stays until Ctrl-C")
        deadline = time.monotonic() + _START_S
        while child.poll() is None and not stopped():
            if self._view != "web" and time.monotonic() > deadline:
                break
            time.sleep(0.1)

    def close(self) -> None:
        """End it."""
        if self._child is not None:
            end([self._child], time.monotonic() + 2.0 * GRACE_S)

    def _logged(self, line: str) -> str:
        self._complaints = [*self._complaints[-20:], line]
        return self._private(line)

    def _read(self, child: LocalChild) -> None:
        assert child.stdout is not None
        for line in child.stdout:
            self._lines.put(line.decode(errors="replace").strip())
        self._lines.put(None)
