"""One robot in lockstep, as a pure core: messages in, messages out.

No socket, clock, thread or file: the shells (:mod:`agent.process` over Zenoh,
:mod:`lab.launch.inline` in memory) carry the messages. The emulated links stand at the
receiving end: a neighbour's broadcast enters its link as it arrives and reaches
the law only when the link delivers it, so no law can see an undelayed state.

Conventions of the sampled loop (tick k at t_k = k h): sample the own state; if
k is a multiple of the broadcast period, broadcast it stamped t_k; a message
stamped t_s on a link with delay δ is usable at tick k if and only if
t_s + δ <= t_k; the law sees each neighbour's newest usable message by stamp,
unless it has been silent for longer than ``neighbours.silence_s``.
"""

from formnet.agent.base import Outgoing, RobotBase
from formnet.agent.law import Law
from formnet.formation.briefing.plan import RobotPlan
from formnet.formation.wire.broadcast import HELLO, Broadcast, Envelope
from formnet.formation.wire.message_error import MessageError
from formnet.formation.wire.messages import PLANT, Drive, Sense
from formnet.netem.settings.timeline import NEVER


class Robot(RobotBase):
    """Answers every ``Sense`` with a ``Drive``, as soon as it holds what it must have heard.

    It must have heard every neighbour's broadcast of the latest broadcast tick up to
    the one it is asked for, or of the last at which that neighbour was up; until then
    nothing comes out, and :meth:`awaited` names the neighbours.

    ``first_tick`` is that of its first ``Sense``: 0, or when its process was restarted.
    """

    def __init__(self, plan: RobotPlan, *, run: str, law: Law, first_tick: int = 0) -> None:
        super().__init__(plan, run, law, first_tick)
        self._down_tick = self._roster.next_down(self.robot, first_tick)
        self._most_ticks = NEVER // self._period_ns - 1
        # Tick of the newest arrival. What was sent before the process was there is not awaited.
        self._arrived = dict.fromkeys(self.neighbours, first_tick - 1)
        self._heard_up_to = first_tick - 1 if self.neighbours else NEVER  # the least of _arrived
        self._latest_possible = first_tick
        self._pending: Sense | None = None

    def on_sense(self, sense: Sense) -> tuple[Outgoing | None, Drive | None]:
        """The plant's measurement at a tick; returns the broadcast and the answer, if due.

        One of a tick before the first, or whose time is no 64-bit number of ns, is rejected.

        Raises:
            LawFailed: the law could not answer.
        """
        if not 0 <= sense.tick <= self._most_ticks:
            self._reject(PLANT, "a sense of an impossible tick")
            return None, None
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
        if source not in self._links:
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
        self._arrived[source] = note.tick
        self._heard_up_to = min(self._arrived.values())
        self._enter(source, note.tick * self._period_ns, note.sequence, payload)
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

    def _broadcast(self, sense: Sense) -> Outgoing:
        sequence = sense.tick // self._every
        stamp_ns = sense.tick * self._period_ns
        payload = Broadcast(self.tag, self.robot, sequence, stamp_ns, sense.state).pack()
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
        self._listen(now_ns)
        return self._driven(tick, now_ns, state)

    def _timely(self, stamp_ns: int, sent_ns: int) -> bool:
        return stamp_ns == sent_ns
