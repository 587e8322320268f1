"""What every plant has in common: it meets the robots, sees them off, and keeps the record.

:mod:`plant.lockstep` hosts the time between in virtual time, :mod:`plant.realtime` on the
wall clock.
"""

import gc
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from math import inf
from typing import ClassVar, NamedTuple

from mypy_extensions import mypyc_attr

from formnet.formation.briefing.plan import Plan
from formnet.formation.records import events
from formnet.formation.records.outcome import Outcome, OutcomeKind
from formnet.formation.records.rows import LinkRows, Samples
from formnet.formation.records.stream import Record, Streamed
from formnet.formation.wire.messages import (
    PLANT,
    PROTOCOL,
    Brief,
    End,
    Failed,
    Join,
    Links,
    Message,
    Ready,
    Rejected,
    encode,
)
from formnet.formation.wire.plant_bus import PlantBus
from formnet.plant.extremes import Extremes

PATIENCE_S = 1.0
"""How long to wait before saying for whom."""
FAREWELL_S = 10.0
"""How long a silence is taken for slowness while robots hand in their last reports, at most."""
HASTY_FAREWELL_S = 0.5
"""The same when the user has asked to stop."""
START_PATIENCE_S = 30.0
"""How long a started or restarted robot may take to be there, at least."""
_FLUSH_TICKS = 100


class Ended(Exception):
    """Ends the run; carries the outcome."""

    def __init__(self, outcome: Outcome) -> None:
        self.outcome = outcome


class Patience:
    """Runs out each time that nothing has changed for ``seconds`` of the clock ``now_s``."""

    def __init__(self, now_s: Callable[[], float], seconds: float = PATIENCE_S) -> None:
        self._now_s = now_s
        self._seconds = seconds
        self._mark: object = None
        self._since = now_s()

    def lost(self, mark: object) -> bool:
        """Whether ``mark`` has been the same for so long (again, since the last time it was)."""
        now = self._now_s()
        if mark != self._mark:
            self._mark, self._since = mark, now
        if now - self._since < self._seconds:
            return False
        self._since = now
        return True


VANISHED = "its process is gone"
MOST_COMPLAINTS = 10_000
"""How often one robot may tell of refused messages; then nobody listens any more."""


class Turn(NamedTuple):
    """For the main thread: something is planned for this tick, or nobody is up."""


class Vanished(NamedTuple):
    """For the main thread: the connection of ``robot`` has ended."""

    robot: int


Note = Message | Record | Turn | Vanished
"""What the main thread gets from the others."""


@mypyc_attr(allow_interpreted_subclasses=True)
class Mailbox:
    """What other threads leave for the main one, and the clock by which that waits."""

    def __init__(self) -> None:
        self._notes: queue.SimpleQueue[Note] = queue.SimpleQueue()

    def now_s(self) -> float:
        """Seconds on a clock that only goes forward."""
        return time.monotonic()

    def put(self, note: Note) -> None:
        """Leave a note, from any thread."""
        self._notes.put(note)

    def get(self, timeout_s: float) -> Note | None:
        """The next note; None if none comes within ``timeout_s``."""
        with suppress(queue.Empty):
            return self._notes.get(timeout=timeout_s)
        return None


class Host:
    """Hosts a run of ``plan`` on ``bus`` and reports to ``sink``.

    If nothing new comes from the robots within ``start_patience_s`` before the first tick,
    the run ends; None waits for as long as it takes.
    """

    blocking: ClassVar[bool] = True
    """Where the network is full, wait until robots have taken what is for them: do not drop it."""

    def __init__(
        self,
        bus: PlantBus,
        plan: Plan,
        sink: Callable[[Streamed], None],
        start_patience_s: float | None = None,
        mailbox: Mailbox | None = None,
    ) -> None:
        self._bus = bus
        self._plan = plan
        self._start_patience_s = start_patience_s
        self._sink = sink
        self._inbox = mailbox or Mailbox()
        self._joined: set[int] = set()  # who has a process that takes part
        self._connected: set[int] = set()  # by liveliness
        self._lock = threading.Lock()  # guards the world
        self._running = False
        self._refused: Counter[tuple[int, str]] = Counter()
        self._complaints: Counter[int] = Counter()  # how often each robot told of refusals
        self._to_robots = {robot: bus.sender(robot) for robot in plan.ids}

    def stop(self) -> None:
        """End the run soon, keeping what was recorded."""
        self._inbox.put(self._outcome("interrupted", None, "stopped by the user"))

    def run(self) -> Outcome:
        """Host the run from the handshake to the last report."""
        self._bus.listen(self._plan.ids, self._on_message, self._refuse, self._on_liveliness)
        began = False
        try:
            self._gather()
            began = True
            self._sink(events.Started(0, self._plan.ids))
            gc.freeze()  # what start-up has made stays; do not scan it again and again
            self._go()
            raise AssertionError("a run ends by raising")
        except Ended as end:
            outcome = end.outcome
        with self._lock:
            self._running = False
        self._wind_up()
        self._sink(events.LastTick(outcome.t_ns))
        outcome = self._farewell(outcome)
        self._report()
        self._last_words()
        if began:
            with self._lock:
                extremes = self._extremes().event(outcome.t_ns)
            self._sink(extremes)
        self._sink(outcome)
        return outcome

    # --- what time is, and what happens in it -----------------------------------------

    def _t_ns(self) -> int:
        """The run's time."""
        raise NotImplementedError

    def _last_tick(self) -> int:
        """The last tick whose broadcasts were all sent, if there is such a thing; else -1."""
        raise NotImplementedError

    def _go(self) -> None:
        """From the first tick to the end, which raises Ended."""
        raise NotImplementedError

    def _wind_up(self) -> None:
        """Before the end is told."""
        raise NotImplementedError

    def _report(self) -> None:
        """Send to the sink what has not been yet."""
        raise NotImplementedError

    def _extremes(self) -> Extremes:
        """Those of the motion."""
        raise NotImplementedError

    def _last_words(self) -> None:
        """After the robots' last reports."""

    def _miss(self, robots: list[int], outcome: Outcome) -> Outcome:
        """These have not handed in their last reports; how the run really ended."""
        return outcome

    def _lose(self, robot: int, why: str) -> None:
        """Go on without ``robot``, or end the run."""
        raise NotImplementedError

    def _on_message(self, robot: int, message: Message) -> None:
        """A message of a robot, on a thread of the bus."""
        raise NotImplementedError

    # --- the main thread -----------------------------------------------------------

    def _gather(self) -> None:
        """Brief every robot and wait until all of them hear their neighbours."""
        joined = self._joined
        ready: set[int] = set()
        everyone = set(self._plan.ids)
        patience, last_patience = self._patience(), self._patience(self._start_patience_s or inf)
        while ready != everyone:
            if last_patience.lost((len(joined), len(ready))):
                late = everyone - joined
                what = "join" if late else "be heard by its neighbours"
                robot = min(late or self._unheard(everyone - ready))
                raise Ended(self._outcome("lost", robot, f"did not {what} in time"))
            if patience.lost((len(joined), len(ready))):
                if joined != everyone:
                    self._complain("join", sorted(everyone - joined))
                else:
                    self._complain("be heard", sorted(self._unheard(everyone - ready)))
            message = self._next()
            if isinstance(message, Join) and message.robot in everyone:
                if message.protocol != PROTOCOL:
                    raise Ended(self._mismatch(message))
                if message.robot not in joined:
                    joined.add(message.robot)
                    met = self._plan.neighbours_of[message.robot]
                    self._tell(message.robot, self._brief(message.robot, 0, met))
            elif isinstance(message, Ready):
                ready.add(message.robot)
            elif isinstance(message, Vanished):
                raise Ended(self._outcome("lost", message.robot, VANISHED))
            elif message is not None:
                self._handle(message)

    def _unheard(self, unready: set[int]) -> set[int]:
        """Of robots that have not heard all their neighbours, those whom no neighbour has heard."""
        neighbours = self._plan.neighbours_of
        return {robot for robot in unready if unready.issuperset(neighbours[robot])} or unready

    def _next(self, seconds: float = PATIENCE_S / 4) -> Note | None:
        return self._inbox.get(seconds)

    def _patience(self, seconds: float = PATIENCE_S) -> Patience:
        return Patience(self._inbox.now_s, seconds)

    def _mismatch(self, join: Join) -> Outcome:
        return self._outcome(
            "failed",
            join.robot,
            f"speaks protocol {join.protocol}, the plant {PROTOCOL}: install the same version of "
            "formnet everywhere",
        )

    def _complain(self, what: str, robots: list[int]) -> None:
        """Say on whom the run waits."""
        self._sink(events.Waiting(self._t_ns(), what, tuple(robots)))

    def _brief(self, robot: int, tick: int, neighbours: list[int]) -> Brief:
        """What a robot is told that takes part from ``tick`` on."""
        return Brief(self._plan.robot(robot).pack(), tick, neighbours)

    def _handle(self, message: Note) -> None:
        """Anything but the hot path. Raises Ended when it ends the run."""
        if isinstance(message, Outcome):
            raise Ended(message)
        if isinstance(message, Vanished) and message.robot in self._joined:
            self._lose(message.robot, VANISHED)
        if isinstance(message, Samples | LinkRows | events.Event):
            self._sink(message)
        elif isinstance(message, Links):
            heard = self._plan.neighbours_of[message.robot]
            if all(
                row.destination == message.robot and row.source in heard for row in message.rows
            ):
                self._sink(LinkRows(message.rows))
            else:
                self._refuse(message.robot, "tells fates on others' links")
        elif isinstance(message, Rejected):
            self._complaints[message.robot] += 1
            if self._complaints[message.robot] > MOST_COMPLAINTS:
                return
            if message.source not in self._to_robots and message.source != PLANT:
                self._refuse(message.robot, "tells of messages from nobody")
                return
            self._sink(
                events.Rejected(
                    self._t_ns(),
                    robot=message.robot,
                    source="plant" if message.source == PLANT else message.source,
                    reason=message.reason,
                    times=message.times,
                )
            )
        elif isinstance(message, Failed):
            raise Ended(self._outcome("failed", message.robot, message.error))

    def _farewell(self, outcome: Outcome) -> Outcome:
        """Tell every robot that it is over, and take their last reports; how it really ended."""
        leaving = set(self._joined)
        if outcome.kind == "lost":
            leaving.discard(outcome.robot or 0)
        for robot in leaving:
            self._tell(robot, End(robot, outcome.kind, self._last_tick()))
        if outcome.kind == "failed":
            leaving.discard(outcome.robot or 0)
        hasty = outcome.kind == "interrupted"
        patience, now_s = self._patience(), self._inbox.now_s
        since, heard = now_s(), 0
        while leaving:
            patience_s = min(FAREWELL_S, self._plan.run.patience_s)
            if hasty or not leaving & self._connected:  # what they said last may be on its way
                patience_s = HASTY_FAREWELL_S
            if patience.lost(heard):
                self._complain("hand in a last report", sorted(leaving))
            message = self._next(min(patience_s, PATIENCE_S / 4))
            if message is None:
                if now_s() - since < patience_s:
                    continue
                self._sink(events.SilentAtTheEnd(self._t_ns(), tuple(sorted(leaving))))
                return self._miss(sorted(leaving), outcome)
            since, heard = now_s(), heard + 1
            if isinstance(message, End):
                leaving.discard(message.robot)
            elif isinstance(message, Failed):  # it says nothing more
                leaving.discard(message.robot)
                if outcome.kind == "failed" and self._is_before(message.robot, outcome.robot):
                    outcome = replace(outcome, robot=message.robot, reason=message.error)
            elif isinstance(message, Outcome):
                hasty = hasty or message.kind == "interrupted"
            elif not isinstance(message, Turn | Vanished):
                with suppress(Ended):
                    self._handle(message)
        return outcome

    def _is_before(self, robot: int, other: int | None) -> bool:
        """Whether a robot comes first in the scenario's file."""
        ids = self._plan.ids
        return other in ids and ids.index(robot) < ids.index(other)

    def _tell(self, robot: int, message: Message) -> None:
        self._to_robots[robot](encode(message))

    def _outcome(self, kind: OutcomeKind, robot: int | None, reason: str) -> Outcome:
        return Outcome(kind, self._t_ns(), robot, reason)

    # --- the bus's threads ----------------------------------------------------------

    def _pass_on(self, robot: int, message: Message) -> None:
        """To the main thread."""
        if getattr(message, "robot", robot) == robot:
            self._inbox.put(message)
        else:
            self._refuse(robot, f"claims to be robot {getattr(message, 'robot', None)}")

    def _refuse(self, robot: int, reason: str) -> None:
        """Count a bad message; report it at the first and then at every doubling."""
        self._refused[robot, reason] += 1
        count = self._refused[robot, reason]
        if count & (count - 1) == 0:
            self._inbox.put(events.Rejected(self._t_ns(), "plant", robot, reason, count))

    def _on_liveliness(self, robot: int, here: bool) -> None:
        if here:
            self._connected.add(robot)
        else:
            self._connected.discard(robot)
            self._inbox.put(Vanished(robot))
