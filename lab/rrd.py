"""``run.rrd``: the scene of a run as a file, written while it goes on."""

import queue
import time
from contextlib import suppress
from pathlib import Path

import rerun as rr

from formation.record import Record
from formation.scenario import Scenario
from lab.lyapunov import Curve
from lab.scene import Scene

FILE = "run.rrd"
_FRAMES = 300
_SECONDS = 2.0
_MOST_WRITES = 300
"""Every write has a cost in bytes: a long run is written in longer pieces."""


class RunFile:
    """Writes ``run.rrd`` in ``folder``; a sink for any thread (:meth:`take`).

    A crash loses what came since the last :meth:`refresh` that wrote: two seconds, or the 300th
    part of a long run.
    """

    def __init__(self, folder: Path, scenario: Scenario) -> None:
        self._records: queue.SimpleQueue[tuple[Record, int]] = queue.SimpleQueue()
        self._stream = rr.RecordingStream("formnet", recording_id=folder.resolve().name)
        self._stream.save(folder / FILE)
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

    def close(self, found: Curve | None) -> None:
        """Write the rest, and V."""
        self._take_in()
        self._scene.flush(last=True)
        if found is not None:
            self._scene.lyapunov(found.t_s, found.v)
        self._stream.flush()
        self._stream.disconnect()

    def _take_in(self) -> None:
        with suppress(queue.Empty):
            while True:
                self._scene.take(*self._records.get_nowait())
