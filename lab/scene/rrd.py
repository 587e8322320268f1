"""``run.rrd``: the scene of a run as a file, written while it goes on.

``python -m formnet.lab.scene.rrd RUN`` writes it from what :mod:`formnet.lab.scene.writer` sends
on standard input. Rerun is given the end of a pipe rather than the file: what it writes into a
file of its own on a full disk is lost, and its stream never closes.
"""

import errno
import json
import os
import select
import signal
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import rerun as rr

from formnet.formation.records.checked import Malformed
from formnet.formation.records.stream import Record
from formnet.formation.scenario.loading import ScenarioError, load
from formnet.formation.scenario.model import Scenario
from formnet.formation.wire.process import to_end
from formnet.lab.runs import files
from formnet.lab.runs.exits import BROKEN
from formnet.lab.runs.files import as_text
from formnet.lab.runs.recording import SCENARIO
from formnet.lab.scene.scene import Scene
from formnet.lab.scene.writer import FILE, PATIENCE_S, Came, Lyapunov, Reader

_FRAMES = 300
_SECONDS = 2.0
_MOST_WRITES = 300
"""Every write has a cost in bytes: a long run is written in longer pieces."""
_PIECE = 2**16


class Outlet:
    """A new file that Rerun writes into through a pipe, whose end is at ``path``.

    ``error`` is why the file takes no more, if it does not: what comes after that is let go.
    ``made``: the file is there already, and empty.

    Raises:
        OSError: the file exists or cannot be made; with ``made``, it is not there.
    """

    def __init__(self, file: Path, *, made: bool = False) -> None:
        self.error: OSError | None = None
        self._place = file
        self._file = files.binary(file, made=made)
        self._from, self._to = os.pipe()
        self.path = Path(f"/dev/fd/{self._to}")
        self._writer = threading.Thread(target=self._write, daemon=True)
        self._writer.start()

    def handed_over(self) -> None:
        """Rerun has opened ``path``."""
        os.close(self._to)

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
    """Writes ``run.rrd`` in ``folder``.

    A crash of this process loses what came since the last :meth:`refresh` that wrote: two
    seconds, or the 300th part of a long run. ``made``: as for :class:`Outlet`.

    Raises:
        OSError: as :class:`Outlet`.
    """

    def __init__(self, folder: Path, scenario: Scenario, *, made: bool = False) -> None:
        self._stream = rr.RecordingStream("formnet", recording_id=as_text(folder.resolve()))
        self._outlet = Outlet(folder / FILE, made=made)
        self._stream.save(self._outlet.path)
        self._outlet.handed_over()
        self._scene = Scene(scenario, self._stream)
        self._every_s = max(_SECONDS, scenario.duration_s / _MOST_WRITES)
        self._written = time.monotonic()

    def take(self, record: Record, wall_ns: int) -> None:
        """Take one record, which came at ``wall_ns`` (nanoseconds since 1970)."""
        self._scene.take(record, wall_ns)

    def refresh(self) -> None:
        """Write what came, if it is time."""
        late = time.monotonic() - self._written >= self._every_s
        if late or self._scene.pending >= _FRAMES:
            self._scene.flush()
            self._written = time.monotonic()

    def close(self, lyapunov: Lyapunov | None) -> None:
        """Write the rest, and V.

        Raises:
            OSError: the file could not be written, and is away.
        """
        self._scene.flush(last=True)
        if lyapunov is not None:
            self._scene.lyapunov(*lyapunov)
        self._stream.flush()
        self._stream.disconnect()  # without it, Rerun waits at the end of the program for who reads
        self._outlet.close()


def write(folder: Path, source: int) -> None:
    """Write the file of the run in ``folder`` from the stream ``source`` (a file descriptor).

    Raises:
        OSError: the file could not be written, and is away.
        Malformed, ScenarioError: what is read is no such stream, or of no such run.
    """
    scenario = load(folder / SCENARIO, follow=False)
    reader, file = Reader(scenario.ids), RunFile(folder, scenario, made=True)
    lyapunov: Lyapunov | None = None
    while True:
        if select.select([source], [], [], _SECONDS)[0]:
            piece = os.read(source, _PIECE)
            if not piece:
                break
            for found in reader.take(piece):
                match found:
                    case Came():
                        file.take(*found)
                    case Lyapunov():
                        lyapunov = found
        file.refresh()
    end = threading.Timer(PATIENCE_S, os._exit, (BROKEN,))  # also if the launcher is gone
    end.daemon = True
    end.start()
    file.close(lyapunov)


def main() -> None:
    """Write ``run.rrd`` of the run folder in the first argument; why not, on standard output."""
    for kind in to_end():
        signal.signal(kind, signal.SIG_IGN)  # it ends with its input
    try:
        write(Path(sys.argv[1]), sys.stdin.fileno())
    except OSError as error:
        problem = error.errno, error.strerror
    except (Malformed, ScenarioError) as error:
        problem = errno.EIO, str(error)
    else:
        return
    with suppress(OSError):  # the launcher is gone
        os.write(sys.stdout.fileno(), json.dumps(problem).encode())
    sys.exit(BROKEN)


if __name__ == "__main__":
    main()
