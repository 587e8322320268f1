"""A run's folder and what is in it.

``scenario.toml`` (fully resolved), ``events.jsonl`` (written as things happen),
``states.parquet``, ``links.parquet``, ``verdict.json``, ``figures/``, ``report.html``, ``logs/``.
"""

import hashlib
import sys
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from copy import copy
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from formnet.formation.plan.roster import Roster
from formnet.formation.plan.timeline import PlanEntry
from formnet.formation.records.events import Event, Extremes, Lost, Network
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.rows import LinkRow, LinkRows, Sample, Samples
from formnet.formation.records.stream import Record
from formnet.formation.scenario.loading import dumps
from formnet.formation.scenario.model import Scenario
from formnet.lab.runs import files
from formnet.lab.runs.events_file import EVENTS, written
from formnet.lab.runs.folders import forget, fresh_folder
from formnet.netem.files.tables import nanoseconds

if sys.platform != "win32":
    import fcntl

STATES_SCHEMA = pa.schema(
    [("t_ns", pa.int64()), ("robot", pa.int32())]
    + [(name, pa.float64()) for name in Sample._fields[2:]]
)
LINKS_SCHEMA = pa.schema(
    [
        ("t_sent_ns", pa.int64()),
        ("t_usable_ns", pa.int64()),
        ("source", pa.int32()),
        ("destination", pa.int32()),
        ("sequence", pa.int64()),
        ("fate", pa.dictionary(pa.int8(), pa.string())),
    ]
)
SCENARIO = "scenario.toml"
STATES, LINKS = "states.parquet", "links.parquet"


class Trajectories:
    """All samples of a run as arrays, robots in the scenario's order.

    ``t_s`` (n_samples,); ``states`` (n_samples, n_robots, 5) with columns x, y
    (m), heading (rad), speed (m/s), turn rate (rad/s); ``torques_nm``
    (n_samples, n_robots, 2), right and left, NaN at the kinematic level.
    """

    def __init__(self, samples: list[Sample], robots: int) -> None:
        table = np.array(samples, dtype=np.float64).reshape(-1, robots, len(Sample._fields))
        self.t_ns: NDArray[np.int64] = np.array(
            [sample.t_ns for sample in samples[::robots]], dtype=np.int64
        )
        self.t_s = self.t_ns / 1e9
        self.states = table[..., 2:7]
        self.torques_nm = table[..., 7:9]

    def first(self, count: int) -> "Trajectories":
        """The first ``count`` instants alone."""
        part = copy(self)
        part.t_ns, part.t_s = self.t_ns[:count], self.t_s[:count]
        part.states, part.torques_nm = self.states[:count], self.torques_nm[:count]
        return part

    @property
    def positions_m(self) -> NDArray[np.float64]:
        return self.states[..., :2]

    @property
    def headings_rad(self) -> NDArray[np.float64]:
        return self.states[..., 2]


def trajectory_sha256(samples: list[Sample]) -> str:
    """SHA-256 over all samples: two runs agree if and only if every bit of every sample does.

    The bytes are, per row and in order, t_ns and robot as little-endian int64
    and the seven remaining columns as little-endian doubles (NaN for none), so
    the hash can be computed from ``states.parquet`` by anyone.
    """
    rows = np.empty(len(samples), dtype=[("t", "<i8"), ("robot", "<i8"), ("values", "<f8", (7,))])
    if samples:
        rows["t"] = [sample.t_ns for sample in samples]
        rows["robot"] = [sample.robot for sample in samples]
        rows["values"] = np.array([sample[2:] for sample in samples], dtype=np.float64)
    return hashlib.sha256(rows.tobytes()).hexdigest()


class Collected:
    """A run's records in memory; a sink."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.samples: list[Sample] = []
        self.link_rows: list[LinkRow] = []
        self.events: list[Event] = []
        self.outcome: Outcome | None = None
        self._ahead: deque[PlanEntry] | None = None  # planned changes of the network still to come

    def __call__(self, record: Record) -> None:
        """Take one record."""
        if isinstance(record, Samples):
            self.samples.extend(record.rows)
            self._note_plan(record.rows[-1].t_ns if record.rows else 0)
        elif isinstance(record, LinkRows):
            self.link_rows.extend(record.rows)
        elif isinstance(record, Event):
            self.events.append(record)
        else:
            self.outcome = record

    def _note_plan(self, now_ns: int) -> None:
        """Put what was planned for links up to now among the events; robots' the plant reports."""
        if self._ahead is None:
            self._ahead = deque(entry for entry in self.scenario.plan if not entry.robots)
        while self._ahead and nanoseconds(self._ahead[0].at_s) <= now_ns:
            entry = self._ahead.popleft()
            self(Network(nanoseconds(entry.at_s), entry.what))

    @property
    def trajectories(self) -> Trajectories:
        """What was sampled so far."""
        return Trajectories(self.samples, len(self.scenario.robots))

    @property
    def sorted_link_rows(self) -> list[LinkRow]:
        """Fates of messages by when they were sent, source, destination, sequence; twins by fate.

        The order in which they are reported depends on the machine.
        """
        return sorted(
            self.link_rows,
            key=lambda row: (row.t_sent_ns, *row[2:], -1 if row[1] is None else row[1]),
        )

    @property
    def motion(self) -> dict[str, Any] | None:
        """The extremes of the motion (:class:`formation.records.events.Extremes`), once known."""
        return next((e.details for e in self.events if isinstance(e, Extremes)), None)

    @property
    def told(self) -> list[Event | Outcome]:
        """What happened and how it ended, in order of time."""
        found: list[Event | Outcome] = [*self.events]
        if self.outcome is not None:
            found.append(self.outcome)
        return sorted(found, key=lambda event: event.t_ns)

    def latest(self) -> Trajectories:
        """The newest sample of every robot alone (empty if there is none)."""
        robots = len(self.scenario.robots)
        return Trajectories(self.samples[-robots:], robots)

    def now_ns(self) -> int:
        """The time of the newest sample."""
        return self.samples[-1].t_ns if self.samples else 0

    def roster(self) -> Roster:
        """Who was down when: as planned, and as it came."""
        roster = self.scenario.roster()
        for event in self.events:
            if isinstance(event, Lost):
                roster.lose(event.robot, event.tick)
        return roster

    def up_at(self, t_ns: int) -> list[int]:
        """The robots that take part at an instant, in the scenario's order."""
        tick, roster = t_ns // self.scenario.clock.control_period_ns, self.roster()
        return [robot for robot in self.scenario.ids if roster.up(robot, tick)]


class Recording(Collected):
    """Collects a run's records; a sink. Events go to disk at once, tables with :meth:`save`.

    While the disk takes no events, they are kept in memory for :meth:`save`.

    Raises:
        RunExists: ``folder`` exists and is not empty.
        OSError: ``folder`` cannot be made, or ``scenario.toml`` not be written.
    """

    def __init__(self, folder: Path, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.folder = fresh_folder(folder, EVENTS)
        self._lines: list[str] = []
        self._behind = False  # the file lacks lines, or has half of one
        self._saved: set[str] = set()
        self._file = files.appending(folder / EVENTS)
        with suppress(OSError):  # a file system without locks
            _lock(self._file)
        try:
            files.write_new(folder / SCENARIO, dumps(scenario.without_hosts))
        except OSError:
            self._file.close()
            forget(folder, EVENTS)
            raise

    def __call__(self, record: Record) -> None:
        """Take one record."""
        super().__call__(record)
        if isinstance(record, Event | Outcome):
            self._write(written(record, datetime.now(UTC)))

    @classmethod
    def copy(cls, run: Collected, folder: Path) -> "Recording":
        """What is known of ``run``, for :meth:`save`; raises as the constructor does."""
        recording = cls(folder, run.scenario)
        for record in run.told:
            recording(record)
        recording.samples, recording.link_rows = run.samples, run.link_rows
        return recording

    def close(self) -> None:
        """Nothing more comes. What is in memory alone is let go, unless :meth:`save` follows."""
        with suppress(OSError):  # its last line could not be written
            self._file.close()

    def save(self) -> list[OSError]:
        """Write tables and events, each whole or not at all; returns what could not be written.

        Called again, it tries that alone.
        """
        self.close()
        problems = []
        for name, content in list(self._unsaved().items()):
            found = files.attempt(partial(files.replace, self.folder / name, content))
            problems += found
            if not found:
                self._saved.add(name)
        return problems

    def _unsaved(self) -> dict[str, bytes]:
        """What :meth:`save` has to write."""
        found = {
            name: _parquet(rows, schema)
            for name, rows, schema in (
                (STATES, self.samples, STATES_SCHEMA),
                (LINKS, self.sorted_link_rows, LINKS_SCHEMA),
            )
            if name not in self._saved
        }
        if self._behind and EVENTS not in self._saved:
            found[EVENTS] = "".join(self._lines).encode()
        return found

    def _write(self, line: str) -> None:
        self._lines.append(line)
        if self._behind:
            return
        try:
            self._file.write(line)
            self._file.flush()
        except OSError:
            self._behind = True


def being_written(folder: Path) -> bool:
    """Whether a process that lives on this machine is recording into ``folder``."""
    try:
        with files.reading(folder / EVENTS) as events:
            _lock(events)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def _lock(file: IO[Any]) -> None:
    """Hold ``file`` until it is closed or this process ends. Raises OSError if it is held."""
    if sys.platform != "win32":
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def table(rows: Sequence[tuple[Any, ...]], schema: pa.Schema) -> pa.Table:
    """Rows as a table of ``schema``, :data:`STATES_SCHEMA` or :data:`LINKS_SCHEMA`."""
    columns = zip(*rows, strict=True) if rows else [()] * len(schema)
    return pa.table(
        [pa.array(column, kind) for column, kind in zip(columns, schema.types, strict=True)],
        schema=schema,
    )


def _parquet(rows: Sequence[tuple[Any, ...]], schema: pa.Schema) -> bytes:
    """A table as a file holds it."""
    whole = pa.BufferOutputStream()
    pq.write_table(table(rows, schema), whole)
    return whole.getvalue().to_pybytes()  # type: ignore[no-any-return]
