"""``run.rrd``: the scene of a run as a file, written while it goes on.

Rerun is given the end of a pipe rather than the file: what it writes into a file of its own on a
full disk is lost, and its stream never closes.
"""

import errno
import os
import queue
import threading
import time
from contextlib import suppress
from pathlib import Path

import rerun as rr

from formnet.formation.records.stream import Record
from formnet.formation.scenario.model import Scenario
from formnet.lab.judge.lyapunov import Curve
from formnet.lab.runs.files import as_text
from formnet.lab.scene.scene import Scene

FILE = "run.rrd"
_FRAMES = 300
_SECONDS = 2.0
_MOST_WRITES = 300
"""Every write has a cost in bytes: a long run is written in longer pieces."""
_PIECE = 2**16


class Outlet:
    """A new file that Rerun writes into through a pipe, whose end is at ``path``.

    ``error`` is why the file takes no more, if it does not: what comes after that is let go.

    Raises:
        OSError: the file exists or cannot be made.
    """

    def __init__(self, file: Path) -> None:
        self.error: OSError | None = None
        self._place = file
        self._file = open(file, "xb", buffering=0)  # noqa: SIM115
        self._from, self._to = os.pipe()
        self.path = Path(f"/dev/fd/{self._to}")
        self._writer = threading.Thread(target=self._write, daemon=True)
        self._writer.start()

    def handed_over(self) -> None:
        """Rerun has opened ``path``."""
        os.close(self._to)

    def give_up(self) -> None:
        """Take no more, and give back the room."""
        self.error = self.error or OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        with suppress(OSError, ValueError):  # it is closed
            self._file.truncate(0)

    def close(self) -> None:
        """Rerun has closed its end: wait until all is written, or take the file away.

        Raises:
            OSError: what kept it from being written.
        """
        self._writer.join()
        if self.error is not None:
            with suppress(OSError):
                self._place.unlink()
            raise OSError(self.error.errno, self.error.strerror, str(self._place))

    def _write(self) -> None:
        with self._file, open(self._from, "rb", buffering=0) as pipe:
            while piece := memoryview(pipe.read(_PIECE)):
                while piece and self.error is None:
                    try:
                        piece = piece[self._file.write(piece) :]
                    except OSError as error:
                        self.error = error


class RunFile:
    """Writes ``run.rrd`` in ``folder``; a sink for any thread (:meth:`take`).

    A crash loses what came since the last :meth:`refresh` that wrote: two seconds, or the 300th
    part of a long run.

    Raises:
        OSError: there is such a file already, or it cannot be made.
    """

    def __init__(self, folder: Path, scenario: Scenario) -> None:
        self._records: queue.SimpleQueue[tuple[Record, int]] = queue.SimpleQueue()
        self._stream = rr.RecordingStream("formnet", recording_id=as_text(folder.resolve()))
        self._outlet = Outlet(folder / FILE)
        self._stream.save(self._outlet.path)
        self._outlet.handed_over()
        self._scene = Scene(scenario, self._stream)
        self._every_s = max(_SECONDS, scenario.duration_s / _MOST_WRITES)
        self._written = time.monotonic()

    def take(self, record: Record) -> None:
        """Take one record."""
        self._records.put((record, time.time_ns()))

    def refresh(self) -> None:
        """Write what came, if it is time."""
        self._take_in()
        late = time.monotonic() - self._written >= self._every_s
        if late or self._scene.pending >= _FRAMES:
            self._scene.flush()
            self._written = time.monotonic()

    def make_room(self) -> None:
        """Take the file away: what is recorded is worth more than how it is shown."""
        self._outlet.give_up()

    def close(self, found: Curve | None) -> None:
        """Write the rest, and V.

        Raises:
            OSError: the file could not be written, and is away.
        """
        self._take_in()
        self._scene.flush(last=True)
        if found is not None:
            self._scene.lyapunov(found.t_s, found.v)
        self._stream.flush()
        self.leave()
        self._outlet.close()

    def leave(self) -> None:
        """Write nothing more; without it, Rerun waits at the end of the program for who reads."""
        self._stream.disconnect()

    def _take_in(self) -> None:
        with suppress(queue.Empty):
            while True:
                self._scene.take(*self._records.get_nowait())
