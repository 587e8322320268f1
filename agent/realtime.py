"""A robot's process in real time: a thin shell around :class:`agent.timed.TimedRobot`.

The main thread wakes once per control period of the robot's own clock and asks the plant where
the robot is; the answer is worked on in the Zenoh thread that brings it. What is late is
counted: a period for which this thread woke too late, or whose answer came after its end, is
missed.
"""

import queue
import threading
import time
from collections.abc import Callable

import zenoh

from formnet.agent.timed import TimedRobot
from formnet.formation.wire.messages import (
    Ask,
    End,
    Failed,
    Links,
    Measured,
    Message,
    Timing,
    encode,
)
from formnet.formation.wire.sync import RemoteClock, Spread
from formnet.netem.core.transit import IN_FLIGHT
from formnet.netem.core.wallclock import wake_punctually

_REPORT_S = 1.0
_MOST_ROWS = 200


class RealtimeLoop:
    """Runs ``robot`` on the wall clock, every ``period_ns``.

    ``send`` speaks to the plant, ``broadcast`` to the neighbours.
    """

    def __init__(
        self,
        robot: TimedRobot,
        period_ns: int,
        send: Callable[[bytes], None],
        broadcast: zenoh.Publisher,
    ) -> None:
        self._robot = robot
        self._id = robot.robot
        self._period_ns = period_ns
        self._send = send
        self._broadcast = broadcast
        self._lock = threading.Lock()  # guards what follows; answers and broadcasts have threads
        self._clock = RemoteClock()
        self._lateness_s = Spread()
        self._asked = -1  # the period that is going on, ...
        self._asked_ns = 0  # ... when it was asked for, ...
        self._answered = True  # ... and whether it was answered
        self._periods = self._missed = 0

    def run(self, inbox: "queue.SimpleQueue[Message]") -> End | Failed:
        """From now until the end."""
        wake_punctually()
        next_ns, report_at = time.monotonic_ns(), time.monotonic() + _REPORT_S
        while True:
            left_ns = next_ns - time.monotonic_ns()
            try:
                message = inbox.get(timeout=max(left_ns, 0) / 1e9)
            except queue.Empty:
                message = None
            if isinstance(message, End | Failed):
                return message
            now_ns = time.monotonic_ns()
            if now_ns < next_ns:
                continue
            next_ns = self._begin(next_ns, now_ns)
            if time.monotonic() > report_at:
                report_at = time.monotonic() + _REPORT_S
                self.report()

    def _begin(self, due_ns: int, now_ns: int) -> int:
        """Begin the period that was due; returns when the next one is."""
        skipped = (now_ns - due_ns) // self._period_ns
        with self._lock:
            self._lateness_s.add((now_ns - due_ns) / 1e9)
            self._periods += 1 + skipped
            if not (skipped and self._was_stopped(due_ns + self._period_ns)):
                self._missed += skipped + (not self._answered)
            self._asked += 1 + skipped
            self._answered = False
            self._asked_ns = time.monotonic_ns()
            number = self._asked
        self._send(encode(Ask(self._id, number)))
        return due_ns + (1 + skipped) * self._period_ns

    def _was_stopped(self, own_ns: int) -> bool:
        """Whether this process was stopped at ``own_ns`` by its clock, as planned."""
        clock = self._clock
        return clock.known and self._robot.was_down(own_ns + clock.offset_ns())

    def on_measured(self, measured: Measured) -> None:
        """The plant's answer, on a Zenoh thread. Raises LawFailed."""
        received_ns = time.monotonic_ns()
        with self._lock:
            if measured.number != self._asked or self._answered:
                return  # too late: the next period has begun
            self._clock.exchange(self._asked_ns, measured.t_ns, received_ns)
            outgoing, drive = self._robot.on_measured(measured)
            self._send(encode(drive))
            if outgoing is not None:
                self._broadcast.put(outgoing.payload, attachment=outgoing.envelope.pack())
            self._answered = True

    def on_broadcast(self, source: int, sample: zenoh.Sample) -> None:
        """A neighbour's broadcast, on a Zenoh thread."""
        received_ns, attachment = time.monotonic_ns(), sample.attachment
        with self._lock:
            if self._clock.known:  # until then, this robot does not know what time it is
                self._robot.on_broadcast(
                    source,
                    sample.payload.to_bytes(),
                    None if attachment is None else attachment.to_bytes(),
                    self._clock.at(received_ns),
                )

    def report(self, *, last: bool = False) -> None:
        """Tell the plant what became of messages, and how time went."""
        with self._lock:
            robot = self._robot
            rows = robot.take_last_link_rows(IN_FLIGHT) if last else robot.take_link_rows()
            rejections = robot.take_rejections()
            known, now_ns = self._clock.known, time.monotonic_ns()
            timing = (
                Timing(
                    self._id,
                    self._periods,
                    self._missed,
                    self._lateness_s.summary(),
                    robot.transit_s.summary(),
                    self._clock.offset_ns() / 1e9,
                    self._clock.uncertainty_ns(now_ns) / 1e9,
                )
                if known
                else None
            )
        for start in range(0, len(rows), _MOST_ROWS):
            self._send(encode(Links(self._id, rows[start : start + _MOST_ROWS])))
        for rejection in rejections:
            self._send(encode(rejection))
        if timing is not None:
            self._send(encode(timing))
