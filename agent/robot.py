"""One robot in lockstep, as a pure core: messages in, messages out.

No socket, clock, thread or file: the shells (:mod:`agent.process` over Zenoh,
:mod:`lab.inline` in memory) carry the messages. The emulated links stand at the
receiving end: a neighbour's broadcast enters its link as it arrives and reaches
the law only when the link delivers it, so no law can see an undelayed state.

Conventions of the sampled loop (tick k at t_k = k h): sample the own state; if
k is a multiple of the broadcast period, broadcast it stamped t_k; a message
stamped t_s on a link with delay δ is usable at tick k if and only if
t_s + δ <= t_k; the law sees each neighbour's newest usable message by stamp,
unless it has been silent for longer than ``neighbours.silence_s``.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Set
from numbers import Real
from typing import Any, NamedTuple

from agent.law import Command, Law, LawFailed
from formation.messages import (
    HELLO,
    Broadcast,
    Drive,
    Envelope,
    MessageError,
    Rejected,
    Sense,
    Stamped,
    make,
)
from formation.record import LinkRow
from formation.roster import Roster
from formation.scenario import Scenario
from netem.link import IN_FLIGHT, Transit
from netem.tables import nanoseconds

_NEVER = 2**63 - 1


def _pair(command: Any) -> Command:
    """What a law returned, as two floats; a plug-in may return any two numbers."""
    if isinstance(command, str | bytes | Mapping | Set):
        raise TypeError(f"the law must return two numbers, not {command!r}")
    first, second = command
    if not (isinstance(first, Real) and isinstance(second, Real)):
        raise TypeError(f"the law must return two numbers, not {command!r}")
    return Command(float(first), float(second))


class Outgoing(NamedTuple):
    """A broadcast to put on the bus: what neighbours' links carry, and the runtime's note."""

    payload: bytes
    envelope: Envelope


class Robot:
    """Answers every ``Sense`` with a ``Drive``, as soon as it holds what it must have heard.

    It must have heard every neighbour's broadcast of the latest broadcast tick up to
    the one it is asked for, or of the last at which that neighbour was up; until then
    nothing comes out, and :meth:`awaited` names the neighbours.

    ``first_tick`` is that of its first ``Sense``: 0, or when its process was restarted.
    """

    def __init__(
        self, scenario: Scenario, robot: int, *, run: str, law: Law, first_tick: int = 0
    ) -> None:
        self.robot = robot
        self.run = run
        self._roster: Roster = scenario.roster()
        self._down_tick = self._roster.next_down(robot, first_tick)
        self.neighbours = scenario.neighbours_of[robot]
        self._command: Callable[..., Any] = law.command  # a plug-in may return anything
        self._period_ns = scenario.clock.control_period_ns
        self._every = scenario.clock.broadcast_every
        life = self._roster.lives(robot, first_tick)
        self._links = {source: scenario.link(source, robot, life) for source in self.neighbours}
        self._timelines = {
            source: scenario.timeline_of(source, robot, link)
            for source, link in self._links.items()
        }
        self._heard: dict[int, Stamped] = {}
        self._newest: tuple[Stamped, ...] = ()
        self._silence_ns = (
            nanoseconds(scenario.neighbours.silence_s)
            if scenario.neighbours.on_silence == "drop"
            else _NEVER
        )
        self._heard_at_ns: dict[int, int] = {}  # when something usable last came from whom
        self._silent_from_ns = _NEVER  # before that, nobody new is silent
        self._silent: set[int] = set()
        # Tick of the newest arrival. What was sent before the process was there is not awaited.
        self._arrived = dict.fromkeys(self.neighbours, first_tick - 1)
        self._heard_up_to = first_tick - 1 if self.neighbours else _NEVER  # the least of _arrived
        self._next_due_ns = min(  # when a link delivers or changes next
            (timeline.next_ns for timeline in self._timelines.values()), default=_NEVER
        )
        self._sequences = dict.fromkeys(self.neighbours, -1)
        self._latest_possible = first_tick
        self._pending: Sense | None = None
        self._rows: list[LinkRow] = []
        self._rejections: Counter[tuple[int, str]] = Counter()
        self._unreported: dict[tuple[int, str], int] = {}

    def on_sense(self, sense: Sense) -> tuple[Outgoing | None, Drive | None]:
        """The plant's measurement at a tick; returns the broadcast and the answer, if due.

        Raises:
            LawFailed: the law could not answer.
        """
        self._pending = sense
        self._latest_possible = sense.tick
        outgoing = None if sense.tick % self._every else self._broadcast(sense)
        return outgoing, self._answer()

    def on_broadcast(self, source: int, payload: bytes, envelope: bytes | None) -> Drive | None:
        """A neighbour's broadcast has arrived at this robot's end of the link.

        ``source`` is whose broadcasts the bus says these are. Returns the
        answer to the pending ``Sense`` if this was what it waited for.

        Raises:
            LawFailed: as in :meth:`on_sense`.
        """
        link = self._links.get(source)
        if link is None:
            self._reject(source, "not a neighbour")
            return None
        try:
            note = Envelope.unpack(envelope if envelope is not None else b"")
        except MessageError as error:
            self._reject(source, str(error))
            return None
        if note.tick == HELLO:
            return None
        if note.robot != source:
            self._reject(source, "envelope names another robot")
            return None
        if note.tick > self._latest_possible or note.tick % self._every != 0:
            self._reject(source, "envelope of an impossible tick")
            return None
        if note.sequence <= self._sequences[source] or note.tick <= self._arrived[source]:
            self._reject(source, "replayed: sequence or tick is not newer")
            return None
        if not self._roster.up(source, note.tick):
            self._reject(source, "broadcast at a tick at which it was down")
            return None
        self._sequences[source] = note.sequence
        self._arrived[source] = note.tick
        self._heard_up_to = min(self._arrived.values())
        sent_ns = note.tick * self._period_ns
        timeline = self._timelines[source]
        if timeline.ramping or timeline.next_ns <= sent_ns:
            self._note(source, timeline.advance(sent_ns))
        for copy in link.send(sent_ns, note.sequence, payload):
            if copy.lost:
                self._note(source, [copy])
        due_ns = link.next_due_ns
        if due_ns is not None and due_ns < self._next_due_ns:
            self._next_due_ns = due_ns
        return self._answer()

    def awaited(self) -> list[int]:
        """The neighbours whose broadcast the pending tick still lacks, ascending."""
        return [] if self._pending is None else self.lacking(self._pending.tick)

    def lacking(self, tick: int) -> list[int]:
        """The neighbours whose broadcast up to ``tick`` has not all come, ascending."""
        return [source for source in self.neighbours if self._lacks(source, tick)]

    def on_loss(self, robot: int, tick: int) -> Drive | None:
        """The plant says that ``robot`` is gone from ``tick`` on.

        Returns the answer to the pending ``Sense`` if it waited for nobody else.

        Raises:
            LawFailed: as in :meth:`on_sense`.
        """
        self._roster.lose(robot, tick)
        return self._answer()

    def _lacks(self, source: int, tick: int) -> bool:
        """Whether a broadcast of ``source`` that must come before ``tick`` is answered is missing.

        What was sent before this process was there is not awaited, and ``_arrived`` says so.
        """
        return self._arrived[source] < self._roster.last_up(source, tick, self._every)

    @property
    def arrivals(self) -> int:
        """A number that grows with every broadcast that comes."""
        return sum(self._arrived.values())

    @property
    def pending_tick(self) -> int | None:
        """The tick this robot has been asked for and has not answered yet."""
        return None if self._pending is None else self._pending.tick

    @property
    def unreported(self) -> int:
        """How many link rows and rejections wait to be taken."""
        return len(self._rows) + len(self._unreported)

    def take_link_rows(self) -> list[LinkRow]:
        """Fates of messages on incoming links that were decided since the last call."""
        rows, self._rows = self._rows, []
        return rows

    def take_last_link_rows(self, fate: str = IN_FLIGHT) -> list[LinkRow]:
        """Like :meth:`take_link_rows`, and all that is still in flight: nothing more will come.

        ``fate`` is what becomes of that: IN_FLIGHT, or LOST_DOWN with a robot that is killed.
        """
        for source, link in self._links.items():
            for copy in link.in_flight:
                copy.fate = fate
                self._note(source, [copy])
        return self.take_link_rows()

    def take_rejections(self) -> list[Rejected]:
        """Kinds of refused messages whose counts have changed since the last call."""
        changed, self._unreported = self._unreported, {}
        return [
            Rejected(self.robot, source, reason, count)
            for (source, reason), count in sorted(changed.items())
        ]

    def _broadcast(self, sense: Sense) -> Outgoing:
        sequence = sense.tick // self._every
        stamp_ns = sense.tick * self._period_ns
        payload = Broadcast(self.run, self.robot, sequence, stamp_ns, sense.state).pack()
        return Outgoing(payload, Envelope(self.robot, sequence, sense.tick))

    def _answer(self) -> Drive | None:
        sense = self._pending
        if sense is None:
            return None
        tick, state = sense
        if self._heard_up_to < tick - tick % self._every and any(
            self._lacks(source, tick) for source in self.neighbours
        ):
            return None
        self._pending = None
        # A neighbour may have been asked before this robot is, and while this one is paused.
        self._latest_possible = tick + 1
        if tick + 1 >= self._down_tick:
            self._latest_possible = self._roster.next_up(self.robot, tick + 1)
            self._down_tick = self._roster.next_down(self.robot, self._latest_possible)
        now_ns = tick * self._period_ns
        if self._next_due_ns <= now_ns:
            self._collect(now_ns)
        if now_ns > self._silent_from_ns:
            self._judge_silence(now_ns)
        try:
            command = self._command(now_ns, state, self._newest)
            if not (type(command) is Command and type(command[0]) is type(command[1]) is float):
                command = _pair(command)
            return make(Drive, (self.robot, tick, command[0], command[1]))
        except Exception as error:  # a law may raise anything
            failed = LawFailed(self.robot, f"{type(error).__name__}: {error}")
            failed.__cause__ = error  # mypyc leaves out what ``raise ... from`` says
            raise failed  # noqa: B904

    def _collect(self, now_ns: int) -> None:
        """Take from the links what is due, and keep each neighbour's newest by stamp."""
        changed = False
        self._next_due_ns = _NEVER
        for source, link in self._links.items():
            timeline = self._timelines[source]
            if timeline.next_ns <= now_ns:
                self._note(source, timeline.advance(now_ns))
            if timeline.next_ns < self._next_due_ns:
                self._next_due_ns = timeline.next_ns
            copies = link.deliver(now_ns)
            self._note(source, copies)
            for copy in copies:
                message = self._checked(source, copy.payload, copy.sent_ns)
                if message is None:
                    continue
                self._heard_at_ns[source] = now_ns
                known = self._heard.get(source)
                newer = known is None or message.stamp_ns > known.stamp_ns
                if newer:
                    self._heard[source] = message
                if newer or source in self._silent:
                    self._silent.discard(source)
                    changed = True
            due_ns = link.next_due_ns
            if due_ns is not None and due_ns < self._next_due_ns:
                self._next_due_ns = due_ns
        if changed:
            self._choose()
            if self._silent_from_ns == _NEVER and self._silence_ns != _NEVER:
                self._silent_from_ns = now_ns + self._silence_ns

    def _judge_silence(self, now_ns: int) -> None:
        """Drop whom nothing has come from for longer than the patience."""
        self._silent_from_ns = _NEVER
        for source, heard_ns in self._heard_at_ns.items():
            if now_ns - heard_ns > self._silence_ns:
                self._silent.add(source)
            else:
                self._silent_from_ns = min(self._silent_from_ns, heard_ns + self._silence_ns)
        self._choose()

    def _choose(self) -> None:
        """What the law hears: each neighbour's newest, of those that are not silent."""
        self._newest = tuple(
            self._heard[i] for i in self.neighbours if i in self._heard and i not in self._silent
        )

    def _note(self, source: int, copies: list[Transit]) -> None:
        """Record the fates of copies on the link from ``source``."""
        for copy in copies:
            arrives = not copy.lost and copy.fate != IN_FLIGHT
            usable_ns = copy.due_ns if arrives else None
            self._rows.append(
                make(
                    LinkRow,
                    (copy.sent_ns, usable_ns, source, self.robot, copy.sequence, copy.fate),
                )
            )

    def _checked(self, source: int, payload: bytes, sent_ns: int) -> Stamped | None:
        try:
            message = Broadcast.unpack(payload)
        except MessageError as error:
            self._reject(source, str(error))
            return None
        if message.run != self.run:
            self._reject(source, "another run")
        elif message.robot != source:
            self._reject(source, "claims to be another robot")
        elif message.stamp_ns != sent_ns:
            self._reject(source, "stamped at another time than it was sent")
        else:
            return make(Stamped, (source, message.stamp_ns, message.state))
        return None

    def _reject(self, source: int, reason: str) -> None:
        self._rejections[source, reason] += 1
        self._unreported[source, reason] = self._rejections[source, reason]
