"""``formnet monitor``: watch a run that goes on, from anywhere, without being noticed.

It only listens, and takes what it gets: where it is too slow, stopped or gone, the plant drops
what is for it (:mod:`plant.watch`). It runs at the lowest priority.
"""

import os
import queue
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import rerun as rr
import zenoh

from formnet.formation.records.checked import Malformed
from formnet.formation.records.events import Event
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.stream import Record
from formnet.formation.records.watching import unpack_history, unpack_numbered, unpack_shown
from formnet.formation.scenario.loading import ScenarioError, loads
from formnet.formation.scenario.model import Scenario
from formnet.formation.wire import bus
from formnet.formation.wire.security import MONITOR, Credentials
from formnet.lab.judge import lyapunov
from formnet.lab.runs.exits import ALL_HOLD, BROKEN, INTERRUPTED
from formnet.lab.runs.recording import Collected
from formnet.lab.scene.rrd import Outlet
from formnet.lab.scene.scene import LINKS_LATE_NS, Scene
from formnet.lab.scene.viewer import Viewer

_DRAW_S = 0.2
"""How often what came is drawn, at most."""
_SEARCH_S = 5.0
_LYAPUNOV_SHARE = 30
"""V, whose cost grows with the run, is worked out in a thirtieth of the time at most."""
_LYAPUNOV_S = 2.0


class NoRun(RuntimeError):
    """There is no such run to watch; the text says where, and what to do."""


class Source(NamedTuple):
    """Where a run goes on: endpoint, run (None: the only one there), and how to get in."""

    endpoint: str
    run: str | None
    keys: Path | None
    plaintext: bool


class Feed:
    """What is recorded of a run from now on, and its scenario; use :func:`feed`."""

    def __init__(self, session: zenoh.Session, run: str) -> None:
        self.run = run
        self._keys = bus.Keys(run)
        self._live: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._gone = threading.Event()
        self._subscriptions = [
            session.declare_subscriber(
                self._keys.watch, lambda sample: self._live.put(sample.payload.to_bytes())
            ),
            session.liveliness().declare_subscriber(
                self._keys.plant_alive, self._on_plant, history=True
            ),
        ]
        self.missed = 0
        """How many messages did not come, because this end was too slow."""
        self.refused: Counter[str] = Counter()
        """How many messages were no records, by what is wrong: anybody may be on the bus."""
        self.scenario, self._told, self._next = self._ask(session)

    def take(self) -> Iterator[Record]:
        """What came since the last call; first of all, the events before."""
        told, self._told = self._told, []
        for packed in told:
            try:
                yield unpack_shown(packed, self.scenario.ids)
            except Malformed as error:
                self.refused[str(error)] += 1
        with suppress(queue.Empty):
            while True:
                data = self._live.get_nowait()
                try:
                    number, record = unpack_numbered(data, self.scenario.ids)
                except Malformed as error:
                    self.refused[str(error)] += 1
                    continue
                if number >= self._next:
                    self.missed += number - self._next
                    self._next = number + 1
                elif isinstance(record, Event | Outcome):
                    continue  # it was among those before
                yield record

    def leave(self) -> None:
        """Take leave of the plant, which waits for that at the end, a little."""
        for subscription in self._subscriptions:
            subscription.undeclare()  # type: ignore[no-untyped-call]

    @property
    def over(self) -> bool:
        """Whether the plant is gone."""
        return self._gone.is_set()

    def _on_plant(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            self._gone.set()

    def _ask(self, session: zenoh.Session) -> tuple[Scenario, list[bytes], int]:
        deadline = time.monotonic() + _SEARCH_S
        while time.monotonic() < deadline:
            for reply in session.get(self._keys.history, timeout=1.0):
                if reply.ok is not None:
                    try:
                        text, told, number = unpack_history(reply.ok.payload.to_bytes())
                        return loads(text, "the run's scenario"), told, number
                    except (Malformed, ScenarioError) as error:
                        self.refused[str(error)] += 1
            time.sleep(_DRAW_S)
        why = "".join(f"; a reply was rejected: {problem}" for problem in self.refused)
        raise NoRun(
            f"no plant answers for run {self.run!r} here: is it over, or an older version?{why}"
        )


@contextmanager
def feed(source: Source) -> Iterator[Feed]:
    """The feed of a run.

    Raises:
        BusError: the endpoint cannot be reached, or not in this way.
        KeysError: the monitor's keys are not there.
        NoRun: there is no such run, or there are several and none was named.
    """
    credentials = None if source.keys is None else Credentials(source.keys, MONITOR)
    with bus.session(
        connect=source.endpoint,
        credentials=credentials,
        plaintext=source.plaintext,
        batching=True,
        patience_s=_SEARCH_S,
    ) as session:
        yield Feed(session, source.run or _only_run(session, source.endpoint))


def _only_run(session: zenoh.Session, endpoint: str) -> str:
    deadline = time.monotonic() + _SEARCH_S
    while time.monotonic() < deadline:
        replies = session.liveliness().get(bus.Keys("*").plant_alive, timeout=1.0)
        found = sorted({str(r.ok.key_expr).split("/")[1] for r in replies if r.ok is not None})
        if len(found) > 1:
            raise NoRun(
                f"{endpoint}: several runs in progress here; choose one with --run: "
                + ", ".join(found)
            )
        if found:
            return found[0]
        time.sleep(_DRAW_S)
    raise NoRun(f"{endpoint}: no run in progress here")


class Monitor:
    """Draws a feed into a viewer, a file, or both."""

    def __init__(self, source: Feed, *, url: str | None, file: Path | None) -> None:
        self._feed = source
        self._collected = Collected(source.scenario)
        self._stream = rr.RecordingStream("formnet", recording_id=source.run)
        self._outlet = None if file is None else Outlet(file)
        sinks = [] if url is None else [rr.GrpcSink(url)]
        if self._outlet is None:
            self._stream.set_sinks(*sinks)
        else:
            self._stream.set_sinks(*sinks, rr.FileSink(self._outlet.path))
            self._outlet.handed_over()
        self._scene = Scene(source.scenario, self._stream, live=True)
        self._lyapunov_ns, self._lyapunov_at = -1, time.monotonic() + _LYAPUNOV_S

    def run(self, stopped: threading.Event) -> bool:
        """Draw until the run has ended (True), its plant is gone, or ``stopped`` is set."""
        while True:
            gone = self._feed.over  # asked before what it said last is taken
            self._draw()
            if self._collected.outcome is not None or gone or stopped.is_set():
                break
            stopped.wait(_DRAW_S)
        self._feed.leave()
        self._scene.flush(last=True)
        self._draw_lyapunov(last=True)
        self._stream.flush()
        return self._collected.outcome is not None

    def close(self) -> None:
        """Take leave of the viewer, before it is gone, and of the file.

        Raises:
            OSError: the file could not be written, and is away.
        """
        self._stream.disconnect()
        if self._outlet is not None:
            self._outlet.close()

    def _draw(self) -> None:
        for record in self._feed.take():
            self._collected(record)
            self._scene.take(record, time.time_ns())
        self._scene.flush()
        if time.monotonic() >= self._lyapunov_at:
            begun = time.monotonic()
            self._draw_lyapunov()
            spent_s = time.monotonic() - begun
            self._lyapunov_at = begun + max(_LYAPUNOV_S, _LYAPUNOV_SHARE * spent_s)

    def _draw_lyapunov(self, *, last: bool = False) -> None:
        """V, where it is new and what was heard until then is known."""
        found = lyapunov.curve(self._collected)
        if found is None:
            return
        known_s = self._collected.now_ns() / 1e9 - (0.0 if last else LINKS_LATE_NS / 1e9)
        new = (found.t_s > self._lyapunov_ns / 1e9) & (found.t_s <= known_s)
        if new.any():
            self._scene.lyapunov(found.t_s[new], found.v[new])
            self._lyapunov_ns = round(found.t_s[new][-1] * 1e9)


def _step_back() -> None:
    """Run only while nobody else wants to, as sched(7) says of SCHED_IDLE; a viewer inherits it."""
    os.nice(19)
    if sys.platform == "linux":
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def watch(source: Source, *, view: str | None, file: Path | None, stopped: threading.Event) -> int:
    """Watch a run until it ends; a page is served on until ``stopped``. Returns the exit code.

    ``view`` is ``"web"``, ``"window"`` or None; ``file`` is where what is seen is kept.
    A line ``watching ...`` on standard output says that all from there on is seen.

    Raises:
        BusError, KeysError, NoRun, ViewerFailed: it cannot be watched.
    """
    _step_back()
    with ExitStack() as stack:
        from_run = stack.enter_context(feed(source))
        viewer = None if view is None else Viewer(web=view == "web")
        if viewer is not None and viewer.page is not None:
            stack.callback(viewer.close)
        monitor = Monitor(from_run, url=None if viewer is None else viewer.url, file=file)
        stack.callback(monitor.close)
        page = viewer.page if viewer is not None else None
        print(f"watching {from_run.run}" + (f" at {page}" if page else ""), flush=True)
        complete = monitor.run(stopped)
        if from_run.missed:
            print(f"too slow: {from_run.missed} messages were missed", flush=True)
        for problem, times in from_run.refused.most_common(3):
            print(f"rejected {times} messages: {problem}", flush=True)
        monitor.close()
        if file is not None:
            part = "the run" if complete else "what was seen of the run"
            print(f"{part} is in {file}", flush=True)
        if not complete:
            return INTERRUPTED if stopped.is_set() else BROKEN
        if page is not None:
            print("the run is over; the page stays until Ctrl-C", flush=True)
            stopped.wait()
    return ALL_HOLD
