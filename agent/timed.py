"""One robot in real time, as a pure core: it is told what time it is.

Like :class:`agent.robot.Robot`, without anybody who waits for anybody. All times are the
plant's, as far as this robot knows it (:mod:`formation.wire.sync`). A neighbour's broadcast enters
its emulated link when it arrives, so emulated delays come on top of what the real network does,
and is usable at the first control period from then on at which the link has delivered it.
"""

from formnet.agent.base import Outgoing, RobotBase
from formnet.agent.law import Law
from formnet.formation.briefing.plan import RobotPlan
from formnet.formation.wire.broadcast import HELLO, Broadcast, Envelope
from formnet.formation.wire.message_error import MessageError
from formnet.formation.wire.messages import Drive, Measured
from formnet.formation.wire.sync import Spread

MOST_AHEAD_NS = 1_000_000_000
"""A stamp further in the future than this is a lie, or a clock that is out of order."""
MOST_BEHIND_NS = 10_000_000_000
"""A stamp older than this on arrival is a replay."""


class TimedRobot(RobotBase):
    """Answers every ``Measured`` with a ``Drive`` and, when one is due, a broadcast."""

    def __init__(self, plan: RobotPlan, *, run: str, law: Law, first_tick: int = 0) -> None:
        super().__init__(plan, run, law, first_tick)
        self.transit_s = Spread()
        self._stamps = dict.fromkeys(self.neighbours, HELLO)
        self._next_broadcast = 0
        self._sent = first_tick // self._every  # so that a restarted robot's numbers go on

    def on_measured(self, measured: Measured) -> tuple[Outgoing | None, Drive]:
        """The plant's measurement; returns the broadcast, if one is due, and the answer.

        Raises:
            LawFailed: the law could not answer.
        """
        self._listen(measured.t_ns)
        outgoing = None
        if measured.number >= self._next_broadcast:
            self._next_broadcast = measured.number - measured.number % self._every + self._every
            outgoing = self._broadcast(measured)
        return outgoing, self._driven(measured.number, measured.t_ns, measured.state)

    def on_broadcast(
        self, source: int, payload: bytes, envelope: bytes | None, now_ns: int
    ) -> None:
        """A neighbour's broadcast has arrived at this robot's end of the link, at ``now_ns``.

        ``source`` is whose broadcasts the bus says these are.
        """
        if source not in self._links:
            self._reject(source, "not a neighbour")
            return
        try:
            note = Envelope.unpack(envelope if envelope is not None else b"")
        except MessageError as error:
            self._reject(source, str(error))
            return
        if note.tick == HELLO:
            return
        if note.robot != source:
            self._reject(source, "envelope names another robot")
        elif note.sequence <= self._sequences[source] or note.tick <= self._stamps[source]:
            self._reject(source, "replayed: sequence or stamp is not newer")
        elif note.tick > now_ns + MOST_AHEAD_NS:
            self._reject(source, "stamped in the future")
        elif note.tick < now_ns - MOST_BEHIND_NS:
            self._reject(source, "stamped long ago")
        else:
            self._stamps[source] = note.tick
            self.transit_s.add((now_ns - note.tick) / 1e9)
            self._enter(source, now_ns, note.sequence, payload)

    def was_down(self, t_ns: int) -> bool:
        """Whether it was planned that this robot does not take part at ``t_ns``."""
        return not self._roster.up(self.robot, t_ns // self._period_ns)

    def _timely(self, stamp_ns: int, sent_ns: int) -> bool:
        return -MOST_BEHIND_NS <= stamp_ns - sent_ns <= MOST_AHEAD_NS

    def _broadcast(self, measured: Measured) -> Outgoing:
        sequence, self._sent = self._sent, self._sent + 1
        stamp_ns = measured.t_ns
        payload = Broadcast(self.tag, self.robot, sequence, stamp_ns, measured.state).pack()
        return Outgoing(payload, Envelope(self.robot, sequence, stamp_ns))
