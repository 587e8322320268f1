"""The plant's process: a thin shell around :class:`plant.world.World`.

Drives arrive on one Zenoh thread, which integrates, and sends the next senses
when a tick is complete; the main thread does the handshake, the record stream,
and everything that goes wrong.
"""

import gc
import os
import queue
import sys
import threading
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO, Any

import zenoh

from formation import bus
from formation.loading import dumps
from formation.messages import (
    PROTOCOL,
    Brief,
    Drive,
    End,
    Failed,
    Join,
    Links,
    Message,
    Ready,
    Rejected,
    Waiting,
    encode,
)
from formation.process import on_stop
from formation.record import Event, LinkRows, Outcome, Record, Samples, Sink, writer
from formation.scenario import Scenario
from plant.world import DIVERGED, World

PATIENCE_S = 1.0
"""How long to wait before saying for whom."""
FAREWELL_S = 10.0
"""How long a silence is taken for slowness while robots hand in their last reports."""
HASTY_FAREWELL_S = 0.5
"""The same when the user has asked to stop."""
_FLUSH_TICKS = 100


class _Ended(Exception):
    """Ends the run; carries the outcome."""

    def __init__(self, outcome: Outcome) -> None:
        self.outcome = outcome


class _Patience:
    """Runs out each time that nothing has changed for PATIENCE_S."""

    def __init__(self) -> None:
        self._mark: object = None
        self._since = time.monotonic()

    def lost(self, mark: object) -> bool:
        """Whether ``mark`` has been the same for so long (again, since the last time it was)."""
        now = time.monotonic()
        if mark != self._mark:
            self._mark, self._since = mark, now
        if now - self._since < PATIENCE_S:
            return False
        self._since = now
        return True


class PlantProcess:
    """Hosts run ``run`` of ``scenario`` on ``session`` and reports to ``sink``."""

    def __init__(self, session: zenoh.Session, scenario: Scenario, run: str, sink: Sink) -> None:
        self._scenario = scenario
        self._sink = sink
        self._world = World(scenario)
        self._inbox: queue.SimpleQueue[Message | Record] = queue.SimpleQueue()
        self._joined: set[int] = set()
        self._lost: set[int] = set()
        self._lock = threading.Lock()  # guards the world and what follows
        self._running = False
        self._refused: Counter[tuple[int, str]] = Counter()
        keys = bus.Keys(run)
        self._to_robots = {
            robot: bus.publisher(session, keys.to_robot(robot)) for robot in scenario.ids
        }
        self._puts = [(robot, publisher.put) for robot, publisher in self._to_robots.items()]
        self._prepared: dict[int, bytes] = {}  # each robot's next sense, as soon as it is known
        self._subscriptions: list[Any] = [
            session.liveliness().declare_token(keys.plant_alive),
            session.liveliness().declare_subscriber(
                keys.robots_alive, self._on_robot_liveliness, history=True
            ),
            bus.on_robots_message(session, keys, scenario.ids, self._from_robot, self._refuse),
        ]

    def stop(self) -> None:
        """End the run soon, keeping what was recorded."""
        self._inbox.put(self._outcome("interrupted", None, "stopped by the user"))

    def run(self) -> Outcome:
        """Host the run from the handshake to the last report."""
        try:
            self._gather()
            self._sink(Event("started", 0, {"robots": self._scenario.ids}))
            gc.freeze()  # what start-up has made stays; do not scan it again and again
            self._running = True
            for robot, sense in self._world.senses():
                self._tell(robot, sense)
            self._attend()
        except _Ended as end:
            outcome = end.outcome
        with self._lock:
            self._running = False
        self._sink(Event("ended", outcome.t_ns, {"outcome": outcome.kind}))
        self._farewell(outcome)
        self._sink(Samples(self._world.take_samples()))
        self._sink(outcome)
        return outcome

    # --- the main thread -----------------------------------------------------------

    def _gather(self) -> None:
        """Brief every robot and wait until all of them hear their neighbours."""
        brief = Brief(dumps(self._scenario))
        joined = self._joined
        ready: set[int] = set()
        everyone = set(self._scenario.ids)
        patience = _Patience()
        while ready != everyone:
            if patience.lost((len(joined), len(ready))):
                if joined != everyone:
                    self._complain("join", sorted(everyone - joined), set())
                else:
                    self._complain("hear its neighbours", sorted(everyone - ready), set())
            message = self._next()
            if isinstance(message, Join) and message.robot in everyone:
                if message.protocol != PROTOCOL:
                    raise _Ended(self._mismatch(message))
                if message.robot not in joined:
                    joined.add(message.robot)
                    self._tell(message.robot, brief)
            elif isinstance(message, Ready):
                ready.add(message.robot)
            elif message is not None:
                self._handle(message)

    def _attend(self) -> None:
        """Record what comes in until the run ends (by raising); complain while nothing moves."""
        blocked: dict[int, int] = {}  # robot: the tick at which it last said that it waits
        patience = _Patience()
        while True:
            if patience.lost(self._world.tick):
                tick = self._world.tick
                waiting = {robot for robot, at in blocked.items() if at == tick}
                self._complain("answer", self._world.awaited(), waiting)
            message = self._next()
            if isinstance(message, Waiting):
                blocked[message.robot] = message.tick
            elif message is not None:
                self._handle(message)

    def _next(self) -> Message | Record | None:
        with suppress(queue.Empty):
            return self._inbox.get(timeout=PATIENCE_S / 4)
        return None

    def _mismatch(self, join: Join) -> Outcome:
        return self._outcome(
            "failed",
            join.robot,
            f"speaks protocol {join.protocol}, the plant {PROTOCOL}: install the same version of "
            "formnet everywhere",
        )

    def _complain(self, what: str, awaited: list[int], blocked: set[int]) -> None:
        """Say on whom the run waits: not on those who wait for somebody themselves."""
        culprits = [robot for robot in awaited if robot not in blocked] or awaited
        self._sink(Event("waiting", self._world.t_ns, {"for": what, "robots": culprits}))

    def _handle(self, message: Message | Record) -> None:
        """Anything but the hot path. Raises _Ended when it ends the run."""
        if isinstance(message, Outcome):
            raise _Ended(message)
        if isinstance(message, Samples | Event):
            self._sink(message)
        elif isinstance(message, Links):
            self._sink(LinkRows(message.rows))
        elif isinstance(message, Rejected):
            self._sink(
                Event(
                    "rejected",
                    self._world.t_ns,
                    {
                        "robot": message.robot,
                        "source": message.source,
                        "reason": message.reason,
                        "times": message.times,
                    },
                )
            )
        elif isinstance(message, Failed):
            raise _Ended(self._outcome("failed", message.robot, message.error))

    def _farewell(self, outcome: Outcome) -> None:
        """Tell every robot that it is over, and take their last reports."""
        leaving = self._joined - self._lost
        if outcome.kind == "failed" and outcome.robot is not None:
            leaving.discard(outcome.robot)
        for robot in leaving:
            self._tell(robot, End(robot, outcome.kind))
        hasty = outcome.kind == "interrupted"
        while leaving:
            patience_s = HASTY_FAREWELL_S if hasty else FAREWELL_S
            if leaving <= self._lost:  # gone, but what they said last may still be on its way
                patience_s = HASTY_FAREWELL_S
            try:
                message = self._inbox.get(timeout=patience_s)
            except queue.Empty:
                details = {"robots": sorted(leaving)}
                self._sink(Event("silent at the end", self._world.t_ns, details))
                return
            if isinstance(message, End):
                leaving.discard(message.robot)
            elif isinstance(message, Outcome):
                hasty = hasty or message.kind == "interrupted"
            else:
                with suppress(_Ended):
                    self._handle(message)

    def _tell(self, robot: int, message: Message) -> None:
        self._to_robots[robot].put(encode(message))

    def _outcome(self, kind: str, robot: int | None, reason: str) -> Outcome:
        return Outcome(kind, self._world.t_ns, robot, reason)

    # --- Zenoh's threads -------------------------------------------------------------

    def _from_robot(self, robot: int, message: Message) -> None:
        if type(message) is not Drive:
            if getattr(message, "robot", robot) == robot:
                self._inbox.put(message)
            else:
                self._refuse(robot, f"claims to be robot {getattr(message, 'robot', None)}")
            return
        with self._lock:
            if self._running:
                self._on_drive(robot, message)

    def _on_drive(self, robot: int, drive: Drive) -> None:
        world = self._world
        try:
            if drive.robot != robot:
                raise ValueError(f"claims to be robot {drive.robot}")
            self._prepared[robot] = encode(world.on_drive(drive))
        except ValueError as error:
            self._refuse(robot, str(error))
            return
        except Exception as error:  # our own mistake: it must not hang the run
            traceback.print_exc()
            self._inbox.put(self._outcome("broken", robot, f"{type(error).__name__}: {error}"))
            return
        if world.finished:
            self._running = False
            diverged = world.diverged
            self._inbox.put(
                self._outcome("completed", None, "")
                if diverged is None
                else self._outcome("diverged", diverged.robot, DIVERGED)
            )
        elif world.tick > drive.tick:
            for robot, put in self._puts:
                put(self._prepared[robot])
            if world.tick % _FLUSH_TICKS == 0:
                self._inbox.put(Samples(world.take_samples()))

    def _refuse(self, robot: int, reason: str) -> None:
        """Count a bad message; report it at the first and then at every doubling."""
        self._refused[robot, reason] += 1
        count = self._refused[robot, reason]
        if count & (count - 1) == 0:
            details = {"robot": "plant", "source": robot, "reason": reason, "times": count}
            self._inbox.put(Event("rejected", self._world.t_ns, details))

    def _on_robot_liveliness(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            robot = bus.last_number(sample.key_expr)
            self._lost.add(robot)
            self._inbox.put(self._outcome("lost", robot, "its process is gone"))


def main(
    scenario: Scenario, *, run: str, listen: str, record: str | None, stop_at_end_of_input: bool
) -> int:
    """Host a run; returns 0, or 3 if the run did not end by itself.

    ``record`` is the file for the record stream, ``-`` for standard output;
    without it, only what happens is told, on standard error.

    Raises:
        BusError: ``listen`` cannot be used.
        OSError: ``record`` exists already or cannot be written.
    """
    with _sink(record) as sink, bus.session(listen=listen) as session:
        plant = PlantProcess(session, scenario, run, sink)
        on_stop(plant.stop, at_end_of_input=stop_at_end_of_input)
        outcome = plant.run()
    return 0 if outcome.kind in ("completed", "diverged") else 3


@contextmanager
def _sink(record: str | None) -> Iterator[Sink]:
    if record is None:
        yield _tell
        return
    if record == "-":  # the real standard output; stray prints go to standard error
        stream: IO[bytes] = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    else:
        stream = open(record, "xb")  # noqa: SIM115
    with stream:
        yield writer(stream)


def _tell(record: Record) -> None:
    if isinstance(record, Event):
        print(f"t = {record.t_ns / 1e9:.3f} s: {record.kind} {record.details}", file=sys.stderr)
    elif isinstance(record, Outcome):
        print(f"t = {record.t_ns / 1e9:.3f} s: {record.kind} {record.reason}", file=sys.stderr)
