"""What a robot in lockstep and one in real time have in common, as a pure core.

Its incoming links, each neighbour's newest message, who is silent, and the law. The emulated
links stand at the receiving end: a neighbour's broadcast enters its link as it arrives and
reaches the law only when the link delivers it, so no law can see an undelayed state.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Set
from numbers import Real
from typing import Any, NamedTuple

from formnet.agent.law import RAISED, Command, Law, failure
from formnet.formation.briefing.plan import RobotPlan
from formnet.formation.plan.roster import Roster
from formnet.formation.records.rows import LinkRow
from formnet.formation.wire.broadcast import Broadcast, Envelope, run_tag
from formnet.formation.wire.message_error import MessageError
from formnet.formation.wire.messages import Drive, Rejected
from formnet.formation.wire.state import Stamped, State
from formnet.formation.wire.tuples import make
from formnet.netem.core.transit import IN_FLIGHT, Transit
from formnet.netem.settings.timeline import NEVER


def pair(command: Any) -> Command:
    """What a law returned, as two floats; a plug-in may return any two numbers."""
    try:
        numbers = () if isinstance(command, str | bytes | Mapping | Set) else tuple(command)
    except TypeError:
        numbers = ()
    if not (len(numbers) == 2 and all(isinstance(number, Real) for number in numbers)):
        raise TypeError(f"the law must return two numbers, not {command!r}")
    return Command(float(numbers[0]), float(numbers[1]))


class Outgoing(NamedTuple):
    """A broadcast to put on the bus: what neighbours' links carry, and the runtime's note."""

    payload: bytes
    envelope: Envelope


class RobotBase:
    """The robot of ``plan`` in run ``run`` under ``law``, from ``first_tick`` on.

    Times are nanoseconds of the run's time.
    """

    def __init__(self, plan: RobotPlan, run: str, law: Law, first_tick: int) -> None:
        self.robot = robot = plan.robot
        self.tag = run_tag(run)
        self._law = law
        self._command: Callable[..., Any] = law.command  # a plug-in may return anything
        self._roster: Roster = plan.roster()
        self.neighbours = plan.neighbours
        self._period_ns = plan.clock.control_period_ns
        self._every = plan.clock.broadcast_every
        incoming = plan.incoming(self._roster.lives(robot, first_tick))
        self._links = {source: link for source, (link, _) in incoming.items()}
        self._timelines = {source: timeline for source, (_, timeline) in incoming.items()}
        self._heard: dict[int, Stamped] = {}
        self._newest: tuple[Stamped, ...] = ()
        self._silence_ns = plan.silence_ns
        self._heard_at_ns: dict[int, int] = {}  # when something usable last came from whom
        self._silent_from_ns = NEVER  # before that, nobody new is silent
        self._silent: set[int] = set()
        self._next_due_ns = min(  # when a link delivers or changes next
            (timeline.next_ns for timeline in self._timelines.values()), default=NEVER
        )
        self._sequences = dict.fromkeys(self.neighbours, -1)
        self._rows: list[LinkRow] = []
        self._rejections: Counter[tuple[int, str]] = Counter()
        self._unreported: dict[tuple[int, str], int] = {}

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

    def _enter(self, source: int, now_ns: int, sequence: int, payload: bytes) -> None:
        """A message enters the link from ``source``."""
        link = self._links[source]
        self._sequences[source] = sequence
        timeline = self._timelines[source]
        if timeline.ramping or timeline.next_ns <= now_ns:
            self._note(source, timeline.advance(now_ns))
        for copy in link.send(now_ns, sequence, payload):
            if copy.lost:
                self._note(source, [copy])
        due_ns = link.next_due_ns
        if due_ns is not None and due_ns < self._next_due_ns:
            self._next_due_ns = due_ns

    def _listen(self, now_ns: int) -> None:
        """Take what has come up to ``now_ns``, and see who has gone silent."""
        if self._next_due_ns <= now_ns:
            self._collect(now_ns)
        if now_ns > self._silent_from_ns:
            self._judge_silence(now_ns)

    def _driven(self, number: int, now_ns: int, state: State) -> Drive:
        """The law's answer to what was sensed at ``now_ns``; raises LawFailed."""
        try:
            command = self._command(now_ns, state, self._newest)
            kind: object = type(command)  # if mypyc knew it, it would take the two for floats
            if not (kind is Command and type(command[0]) is type(command[1]) is float):
                command = pair(command)
            return make(Drive, (self.robot, number, command[0], command[1]))
        except RAISED as error:
            failed = failure(self.robot, error, self._law)
            failed.__cause__ = error  # mypyc leaves out what ``raise ... from`` says
            raise failed  # noqa: B904

    def _collect(self, now_ns: int) -> None:
        """Take from the links what is due, and keep each neighbour's newest by stamp."""
        changed = False
        self._next_due_ns = NEVER
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
            if self._silent_from_ns == NEVER and self._silence_ns != NEVER:
                self._silent_from_ns = now_ns + self._silence_ns

    def _judge_silence(self, now_ns: int) -> None:
        """Drop whom nothing has come from for longer than the patience."""
        self._silent_from_ns = NEVER
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
        """What a message that entered its link at ``sent_ns`` says, if it can be believed."""
        try:
            message = Broadcast.unpack(payload)
        except MessageError as error:
            self._reject(source, str(error))
            return None
        if message.tag != self.tag:
            self._reject(source, "another run")
        elif message.robot != source:
            self._reject(source, "claims to be another robot")
        elif not self._timely(message.stamp_ns, sent_ns):
            self._reject(source, "stamped at another time than it was sent")
        else:
            return make(Stamped, (source, message.stamp_ns, message.state))
        return None

    def _timely(self, stamp_ns: int, sent_ns: int) -> bool:
        """Whether a message with this stamp may have entered its link at ``sent_ns``."""
        raise NotImplementedError

    def _reject(self, source: int, reason: str) -> None:
        self._rejections[source, reason] += 1
        self._unreported[source, reason] = self._rejections[source, reason]
