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
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from math import inf
from typing import IO, Any, NamedTuple

import zenoh

from formation import bus
from formation.loading import dumps
from formation.messages import (
    KILL,
    PROTOCOL,
    Brief,
    CatchUp,
    Drive,
    End,
    Failed,
    Gone,
    Join,
    Links,
    Meet,
    Message,
    Ready,
    Rejected,
    Waiting,
    encode,
)
from formation.process import on_stop
from formation.record import Event, LinkRows, Outcome, Record, Samples, Stir, Streamed, writer
from formation.scenario import Scenario
from plant.world import DIVERGED, World

PATIENCE_S = 1.0
"""How long to wait before saying for whom."""
FAREWELL_S = 10.0
"""How long a silence is taken for slowness while robots hand in their last reports."""
HASTY_FAREWELL_S = 0.5
"""The same when the user has asked to stop."""
START_PATIENCE_S = 30.0
"""How long a started or restarted robot may take to be there, at least."""
_FLUSH_TICKS = 100
_MOST_UNREAD = 500
"""How many broadcasts may wait in the network's buffers (64 KiB, at least) for a paused robot."""


class _Ended(Exception):
    """Ends the run; carries the outcome."""

    def __init__(self, outcome: Outcome) -> None:
        self.outcome = outcome


class _Patience:
    """Runs out each time that nothing has changed for ``seconds``."""

    def __init__(self, seconds: float = PATIENCE_S) -> None:
        self._seconds = seconds
        self._mark: object = None
        self._since = time.monotonic()

    def lost(self, mark: object) -> bool:
        """Whether ``mark`` has been the same for so long (again, since the last time it was)."""
        now = time.monotonic()
        if mark != self._mark:
            self._mark, self._since = mark, now
        if now - self._since < self._seconds:
            return False
        self._since = now
        return True


_VANISHED = "its process is gone"


def _culprits(awaited: list[int], waiting: Mapping[int, Waiting], tick: int) -> list[int]:
    """On whom the run waits: not on those who wait for somebody themselves."""
    victims = {robot for robot, message in waiting.items() if message.tick == tick}
    silent = [robot for robot in awaited if robot not in victims]
    named = {robot for victim in victims for robot in waiting[victim].neighbours}
    return silent or sorted(named - victims) or awaited


class _Turn(NamedTuple):
    """For the main thread: something is planned for this tick, or nobody is up."""


class _Vanished(NamedTuple):
    """For the main thread: the connection of ``robot`` has ended."""

    robot: int


class PlantProcess:
    """Hosts run ``run`` of ``scenario`` on ``session`` and reports to ``sink``.

    If nothing new comes from the robots within ``start_patience_s`` before the first tick,
    the run ends; None waits for as long as it takes.
    """

    def __init__(
        self, session: zenoh.Session, scenario: Scenario, run: str,
        sink: Callable[[Streamed], None], start_patience_s: float | None = None,
    ) -> None:  # fmt: skip
        self._scenario = scenario
        self._start_patience_s = start_patience_s
        self._sink = sink
        self._world = World(scenario)
        self._inbox: queue.SimpleQueue[Message | Record | _Turn | _Vanished] = queue.SimpleQueue()
        self._brief = dumps(scenario)
        self._joined: set[int] = set()  # who has a process that takes part
        self._connected: set[int] = set()  # by liveliness
        self._gone: list[Gone] = []  # who was lost, unplanned
        self._paused: set[int] = set()
        self._stir_at = inf  # the tick at which they have to take in what they have been sent
        self._behind: set[int] = set()  # who is doing so
        self._ready: set[int] = set()  # who has met whom it had to meet before this tick
        self._begun = -1  # the tick whose senses were sent last
        self._lock = threading.Lock()  # guards the world and what follows
        self._running = False
        self._refused: Counter[tuple[int, str]] = Counter()
        keys = bus.Keys(run)
        self._to_robots = {
            robot: bus.publisher(session, keys.to_robot(robot)) for robot in scenario.ids
        }
        self._puts: list[tuple[int, Callable[[bytes], None]]] = []  # to those who are up
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
            self._turn()
            self._attend()
        except _Ended as end:
            outcome = end.outcome
        with self._lock:
            self._running = False
        if self._paused:  # to say their last they have to run
            self._sink(Stir(sorted(self._paused), True))
        self._sink(Event("ended", outcome.t_ns, {"outcome": outcome.kind}))
        self._farewell(outcome)
        self._sink(Samples(self._world.take_samples()))
        self._sink(LinkRows(self._world.take_down_rows()))
        self._sink(outcome)
        return outcome

    # --- the main thread -----------------------------------------------------------

    def _gather(self) -> None:
        """Brief every robot and wait until all of them hear their neighbours."""
        joined = self._joined
        ready: set[int] = set()
        everyone = set(self._scenario.ids)
        patience = _Patience()
        last_patience = _Patience(self._start_patience_s or inf)
        while ready != everyone:
            if last_patience.lost((len(joined), len(ready))):
                late = everyone - joined
                what = "join" if late else "be heard by its neighbours"
                robot = min(late or self._unheard(everyone - ready))
                raise _Ended(self._outcome("lost", robot, f"did not {what} in time"))
            if patience.lost((len(joined), len(ready))):
                if joined != everyone:
                    self._complain("join", sorted(everyone - joined))
                else:
                    self._complain("be heard", sorted(self._unheard(everyone - ready)))
            message = self._next()
            if isinstance(message, Join) and message.robot in everyone:
                if message.protocol != PROTOCOL:
                    raise _Ended(self._mismatch(message))
                if message.robot not in joined:
                    joined.add(message.robot)
                    met = self._scenario.neighbours_of[message.robot]
                    self._tell(message.robot, Brief(self._brief, 0, met))
            elif isinstance(message, Ready):
                ready.add(message.robot)
            elif isinstance(message, _Vanished):
                raise _Ended(self._outcome("lost", message.robot, _VANISHED))
            elif message is not None:
                self._handle(message)

    def _unheard(self, unready: set[int]) -> set[int]:
        """Of robots that have not heard all their neighbours, those whom no neighbour has heard."""
        neighbours = self._scenario.neighbours_of
        return {robot for robot in unready if unready.issuperset(neighbours[robot])} or unready

    def _attend(self) -> None:
        """Record what comes in until the run ends (by raising).

        While nothing moves, complain, and in the end go on without those who do not answer.
        """
        world = self._world
        waiting: dict[int, Waiting] = {}  # what each robot has said last of whom it waits for
        patience, last_patience = _Patience(), _Patience(self._scenario.run.patience_s)
        beat = _Patience()
        while True:
            tick, awaited = world.tick, world.awaited()
            if patience.lost(tick):
                self._complain("answer", _culprits(awaited, waiting, tick))
            if last_patience.lost((tick, awaited)):
                why = f"did not answer for {self._scenario.run.patience_s:g} s"
                for robot in _culprits(awaited, waiting, tick):
                    self._lose(robot, why)
                waiting.clear()
            if beat.lost(None):  # the launcher takes a silent plant for one that hangs
                with self._lock:
                    self._flush()
            message = self._next()
            if isinstance(message, Waiting):
                waiting[message.robot] = message
            elif isinstance(message, _Turn):
                self._turn()
            elif message is not None:
                self._handle(message)

    # --- robots that fail --------------------------------------------------------------

    def _turn(self) -> None:
        """See to what is planned for this tick, and begin it. Time stands still meanwhile."""
        world = self._world
        if world.tick <= self._begun and world.up and not world.finished:
            return  # it has begun already
        while not world.finished:
            restarted: list[int] = []
            for _, verb, robots in world.happenings if world.tick > self._begun else []:
                if verb == "kill":
                    self._dismiss(robots)
                self._sink(Event(verb, world.t_ns, {"robots": robots}))
                if verb == "kill":
                    self._paused.difference_update(robots)
                    self._wait("die", robots, self._is_dead, dying=True)
                elif verb == "restart":
                    restarted = robots
                elif verb == "pause":
                    self._paused.update(robots)
                else:
                    self._paused.difference_update(robots)
            if restarted:
                self._welcome(restarted)
            if world.up:
                break
            world.idle()
        self._stir()
        self._begin_tick()

    def _stir(self) -> None:
        """Have paused robots take in what their neighbours have sent, before it is too much."""
        world = self._world
        if world.tick >= self._stir_at:
            self._behind = {robot for robot in self._paused if robot in self._joined}
            stirred = sorted(self._behind)
            self._sink(Stir(stirred, True))
            for robot in stirred:
                self._tell(robot, CatchUp(robot, world.tick - 1))
            self._wait("catch up", stirred, self._has_caught_up)
            self._sink(Stir([robot for robot in stirred if robot in self._paused], False))
            self._stir_at = inf
        degree = max((len(self._scenario.neighbours_of[r]) for r in self._paused), default=0)
        if degree:
            ticks = max(1, _MOST_UNREAD // degree) * self._scenario.clock.broadcast_every
            self._stir_at = min(self._stir_at, world.tick + ticks)
        else:
            self._stir_at = inf

    def _is_dead(self, robot: int) -> bool:
        return robot not in self._connected

    def _has_joined(self, robot: int) -> bool:
        return robot in self._joined

    def _has_left(self, robot: int) -> bool:
        return robot not in self._joined

    def _has_caught_up(self, robot: int) -> bool:
        return robot not in self._behind

    def _is_ready(self, robot: int) -> bool:
        return robot in self._ready

    def _begin_tick(self) -> None:
        """Send the senses of this tick, or end the run after the last."""
        with self._lock:
            if self._world.finished:
                self._inbox.put(self._completed())
                return
            self._begun = self._world.tick
            up = self._world.up
            self._puts = [(robot, self._to_robots[robot].put) for robot in up]
            for robot, sense in self._world.senses():
                self._tell(robot, sense)

    def _dismiss(self, robots: list[int]) -> None:
        """Have robots that are to be killed hand in their last reports."""
        stopped = [robot for robot in robots if robot in self._paused]
        if stopped:  # to say their last they have to run
            self._sink(Stir(stopped, True))
        leaving = [robot for robot in robots if robot in self._joined]
        for robot in leaving:
            self._tell(robot, End(robot, KILL, self._world.tick - 1))
        self._wait("say its last", leaving, self._has_left, dying=True)
        self._joined.difference_update(robots)

    def _welcome(self, restarted: list[int]) -> None:
        """Brief new processes, and have them and their neighbours meet."""
        world, neighbours = self._world, self._scenario.neighbours_of
        self._ready.clear()
        self._wait("join", restarted, self._has_joined, least_s=START_PATIENCE_S)
        here = [robot for robot in world.up if robot in self._joined]
        meeting: list[int] = []
        for robot in here:
            new = robot in restarted
            met = [r for r in neighbours[robot] if r in here and (new or r in restarted)]
            if new:
                self._tell(robot, Brief(self._brief, world.tick, met))
                for gone in self._gone:
                    self._tell(robot, gone)
            elif met:
                self._tell(robot, Meet(world.tick, met))
            if new or met:
                meeting.append(robot)
        self._wait("meet its neighbours", meeting, self._is_ready, least_s=START_PATIENCE_S)

    def _wait(
        self, what: str, robots: list[int], done: Callable[[int], bool],
        *, least_s: float = 0.0, dying: bool = False,
    ) -> None:  # fmt: skip
        """Until ``done`` says yes of all ``robots``.

        Who takes too long is lost, unless it is ``dying`` anyway.
        """
        patience = _Patience()
        last_patience = _Patience(max(least_s, self._scenario.run.patience_s))
        while True:
            here = robots if dying else [*self._world.up, *self._paused]
            left = [robot for robot in robots if robot in here and not done(robot)]
            if not left:
                return
            if patience.lost(left):
                self._complain(what, left)
            if last_patience.lost(left):
                if dying:
                    return
                for robot in left:
                    self._lose(robot, f"did not {what} in time")
            message = self._next()
            if isinstance(message, Join) and message.robot in robots:
                self._joined.add(message.robot)
            elif isinstance(message, Ready):
                if message.tick == self._world.tick:
                    self._ready.add(message.robot)
            elif isinstance(message, CatchUp):
                self._behind.discard(message.robot)
            elif isinstance(message, End) or (
                dying and isinstance(message, _Vanished) and message.robot in robots
            ):
                self._joined.discard(message.robot)
            elif message is not None:
                self._handle(message)

    def _lose(self, robot: int, why: str) -> None:
        """Go on without ``robot``, or end the run."""
        world = self._world
        if self._scenario.run.on_unscheduled_loss == "abort":
            raise _Ended(self._outcome("lost", robot, why))
        with self._lock:
            tick, t_ns = world.tick, world.t_ns
            gone = Gone(robot, world.lose(robot))
        self._joined.discard(robot)
        self._paused.discard(robot)
        self._gone.append(gone)
        self._sink(Event("lost", t_ns, {"robot": robot, "reason": why, "tick": gone.tick}))
        for other in self._joined:
            self._tell(other, gone)
        if world.finished or world.tick > tick or not world.up:
            self._inbox.put(_Turn())

    def _next(self) -> Message | Record | _Turn | _Vanished | None:
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

    def _complain(self, what: str, robots: list[int]) -> None:
        """Say on whom the run waits."""
        self._sink(Event("waiting", self._world.t_ns, {"for": what, "robots": robots}))

    def _handle(self, message: Message | Record | _Turn | _Vanished) -> None:
        """Anything but the hot path. Raises _Ended when it ends the run."""
        if isinstance(message, Outcome):
            raise _Ended(message)
        if isinstance(message, _Vanished) and message.robot in self._joined:
            self._lose(message.robot, _VANISHED)
        if isinstance(message, Samples | LinkRows | Event):
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
        leaving = set(self._joined)
        if outcome.kind in ("failed", "lost") and outcome.robot is not None:
            leaving.discard(outcome.robot)
        for robot in leaving:
            self._tell(robot, End(robot, outcome.kind, self._world.tick - 1))
        hasty = outcome.kind == "interrupted"
        while leaving:
            patience_s = HASTY_FAREWELL_S if hasty else FAREWELL_S
            if not leaving & self._connected:  # what they said last may still be on its way
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
            elif not isinstance(message, _Turn | _Vanished):
                with suppress(_Ended):
                    self._handle(message)

    def _tell(self, robot: int, message: Message) -> None:
        self._to_robots[robot].put(encode(message))

    def _completed(self) -> Outcome:
        diverged = self._world.diverged
        if diverged is None:
            return self._outcome("completed", None, "")
        return self._outcome("diverged", diverged.robot, DIVERGED)

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
            self._inbox.put(self._completed())
        elif world.tick > drive.tick:
            if world.changed or world.tick >= self._stir_at:
                self._inbox.put(_Turn())
            else:
                self._begun = world.tick
                for robot, put in self._puts:
                    put(self._prepared[robot])
            if world.tick % _FLUSH_TICKS == 0:
                self._flush()

    def _flush(self) -> None:
        """Have the main thread report what is new; the caller holds the lock."""
        self._inbox.put(Samples(self._world.take_samples()))
        self._inbox.put(LinkRows(self._world.take_down_rows()))

    def _refuse(self, robot: int, reason: str) -> None:
        """Count a bad message; report it at the first and then at every doubling."""
        self._refused[robot, reason] += 1
        count = self._refused[robot, reason]
        if count & (count - 1) == 0:
            details = {"robot": "plant", "source": robot, "reason": reason, "times": count}
            self._inbox.put(Event("rejected", self._world.t_ns, details))

    def _on_robot_liveliness(self, sample: zenoh.Sample) -> None:
        robot = bus.last_number(sample.key_expr)
        if sample.kind == zenoh.SampleKind.DELETE:
            self._connected.discard(robot)
            self._inbox.put(_Vanished(robot))
        else:
            self._connected.add(robot)


def main(
    scenario: Scenario, *, run: str, listen: str, record: str | None, stop_at_end_of_input: bool,
    start_patience_s: float | None = None,
) -> int:  # fmt: skip
    """Host a run; returns 0, or 3 if the run did not end by itself.

    ``record`` is the file for the record stream, ``-`` for standard output;
    without it, only what happens is told, on standard error. ``start_patience_s`` is as in
    :class:`PlantProcess`.

    Raises:
        BusError: ``listen`` cannot be used.
        OSError: ``record`` exists already or cannot be written.
    """
    with _sink(record) as sink, bus.session(listen=listen) as session:
        plant = PlantProcess(session, scenario, run, sink, start_patience_s)
        on_stop(plant.stop, at_end_of_input=stop_at_end_of_input)
        outcome = plant.run()
    return 0 if outcome.kind in ("completed", "diverged") else 3


@contextmanager
def _sink(record: str | None) -> Iterator[Callable[[Streamed], None]]:
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


def _tell(record: Streamed) -> None:
    if isinstance(record, Event):
        print(f"t = {record.t_ns / 1e9:.3f} s: {record.kind} {record.details}", file=sys.stderr)
    elif isinstance(record, Outcome):
        print(f"t = {record.t_ns / 1e9:.3f} s: {record.kind} {record.reason}", file=sys.stderr)
