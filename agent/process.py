"""One robot's process: a thin shell that carries messages between Zenoh and the core.

This is lockstep, and what real time shares with it; :mod:`agent.realtime` is the rest.

Zenoh calls back on threads of its own; the hot path (sense in, drive out) runs
right there, because handing each message to another thread costs more than the
law itself. The main thread does everything slow: the start handshake, naming
who is waited for, and the end.
"""

import gc
import queue
import threading
import time
import traceback
from collections import Counter
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import zenoh

from formnet.agent.law import RAISED, LawFactory, LawFailed, make
from formnet.agent.realtime import RealtimeLoop
from formnet.agent.robot import Robot
from formnet.agent.timed import TimedRobot
from formnet.formation.briefing.plan import RobotPlan
from formnet.formation.wire import bus
from formnet.formation.wire.broadcast import HELLO, Envelope
from formnet.formation.wire.message_error import MessageError
from formnet.formation.wire.messages import (
    KILL,
    MOST_TEXT,
    PLANT,
    PROTOCOL,
    Begin,
    Brief,
    CatchUp,
    End,
    Failed,
    Gone,
    Join,
    Links,
    Measured,
    Meet,
    Message,
    Ready,
    Rejected,
    Sense,
    Waiting,
    decode,
    encode,
)
from formnet.formation.wire.process import on_stop
from formnet.formation.wire.security import Credentials, robot_name
from formnet.netem.core.transit import IN_FLIGHT, LOST_DOWN

RETRY_S = 0.05
"""How often an unanswered handshake message is repeated."""
PATIENCE_S = 0.25
"""A robot that waits for neighbours says so within twice this, before the plant complains."""
CATCH_UP_S = 2.0
"""How long nothing may come before a robot that ends gives up on messages that should be there."""
LEAVE_S = 5.0
"""How long a robot that has failed stays, at most, for the plant to hear of it."""
_POLL_S = 0.005
_FLUSH_ROWS = 200
_REPORT_NS = 500_000_000


class RobotProcess:
    """Joins run ``run`` at ``session``'s hub as robot ``robot`` and stays until its end.

    ``law`` makes its law: the one that the plan names, or another.
    """

    def __init__(
        self, session: zenoh.Session, robot: int, run: str, law: LawFactory = make
    ) -> None:
        self._session = session
        self._make = law
        self._id = robot
        self._run = run
        self._keys = bus.Keys(run)
        self._inbox: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self._lock = threading.Lock()  # guards the core: senses and broadcasts come on own threads
        self._robot: Robot | None = None  # in lockstep
        self._report_tick = 0  # when it reports next, at the latest
        self._report_ticks = 1
        self._loop: RealtimeLoop | None = None  # in real time
        self._started = threading.Event()
        self._broadcast: zenoh.Publisher | None = None
        self._heard: set[int] = set()
        self._refused: Counter[str] = Counter()
        self._to_plant = bus.publisher(session, self._keys.from_robot(robot))
        self._subscriptions: list[Any] = [
            session.declare_subscriber(self._keys.to_robot(robot), self._on_plant)
        ]

    def stop(self, reason: str = "stopped") -> None:
        """End the process soon; callable from any thread and from signal handlers."""
        self._inbox.put(End(self._id, reason, -1))

    def run(self) -> int:
        """Take part until the end; returns the exit code (0, or 3 if the robot failed)."""
        alive = self._session.liveliness().declare_token(self._keys.robot_alive(self._id))
        plant_watch = self._session.liveliness().declare_subscriber(
            self._keys.plant_alive, self._on_plant_liveliness, history=True
        )
        self._subscriptions += [alive, plant_watch]
        brief = self._until(Brief, Join(self._id, PROTOCOL))
        if not isinstance(brief, Brief):
            return 3
        try:
            plan = RobotPlan.unpack(brief.plan)
            timed = plan.clock.mode == "realtime"
            self._report_ticks = max(1, _REPORT_NS // plan.clock.control_period_ns)
            self._broadcast = broadcast = bus.publisher(
                self._session, self._keys.broadcast(self._id), blocking=not timed
            )
            law = self._make(plan.situation)
            if timed:
                core = TimedRobot(plan, run=self._run, law=law, first_tick=brief.tick)
                self._loop = RealtimeLoop(
                    core, plan.clock.control_period_ns, self._to_plant.put, broadcast
                )
            else:
                self._robot = Robot(plan, run=self._run, law=law, first_tick=brief.tick)
        except RAISED as error:  # a plug-in's constructor may
            self._fail(error)
            return self._take_leave()
        gc.freeze()  # what start-up has made stays; do not scan it again and again
        self._subscriptions += [
            self._session.declare_subscriber(
                self._keys.broadcast(neighbour), partial(self._on_broadcast, neighbour)
            )
            for neighbour in plan.neighbours
        ]
        end = self._meet(Meet(brief.tick, brief.neighbours))
        if self._loop is not None:
            return self._run_on(self._loop, end)
        robot = self._robot
        assert robot is not None
        end = end or self._attend(robot)
        if isinstance(end, End):
            self._catch_up(robot, end.tick)
        with self._lock:
            doomed = isinstance(end, End) and end.reason == KILL
            self._flush(robot, last=LOST_DOWN if doomed else IN_FLIGHT)
        if isinstance(end, Failed):
            return self._take_leave()
        self._send(End(self._id, end.reason, end.tick))
        if doomed:
            self._until_told(End)
        return 0

    def _run_on(self, loop: RealtimeLoop, end: End | Failed | None) -> int:
        """In real time, to the end."""
        end = end or loop.run(self._inbox)
        loop.report(last=True)
        if isinstance(end, Failed):
            return self._take_leave()
        self._send(End(self._id, end.reason, end.tick))
        return 0

    def _take_leave(self) -> int:
        """Having failed, wait until the plant knows: whose process is gone before that is lost."""
        deadline = time.monotonic() + LEAVE_S
        message: Message | None = None
        while not isinstance(message, End) and (left := deadline - time.monotonic()) > 0.0:
            with suppress(queue.Empty):
                message = self._inbox.get(timeout=left)
        return 3

    # --- the main thread -----------------------------------------------------------

    def _until(self, kind: type[Message], repeat: Message) -> Message:
        """Say ``repeat`` again and again until a message of ``kind``, or the end, arrives."""
        while True:
            self._send(repeat)
            try:
                message = self._inbox.get(timeout=RETRY_S)
            except queue.Empty:
                continue
            if isinstance(message, kind | End):
                return message

    def _catch_up(self, robot: Robot, tick: int) -> None:
        """Take in what was sent up to ``tick``: one that was paused has not yet."""
        arrivals, since = robot.arrivals, time.monotonic()
        while time.monotonic() - since < CATCH_UP_S:
            with self._lock:
                if not robot.lacking(tick):
                    return
                if robot.arrivals != arrivals:
                    arrivals, since = robot.arrivals, time.monotonic()
            with suppress(queue.Empty):
                message = self._inbox.get(timeout=_POLL_S)
                if isinstance(message, Gone):
                    self._lose(message)

    def _until_told(self, kind: type[Message]) -> None:
        while not isinstance(self._inbox.get(), kind):
            pass

    def _meet(self, meeting: Meet) -> End | Failed | None:
        """Say hello until all of ``meeting`` were heard and the next tick has come.

        A message put before its subscriber is known is lost silently, so every
        path of the run is proven by a message that has come through it. Returns the end, if
        that comes first.
        """
        hello = Envelope(self._id, -1, HELLO).pack()
        assert self._broadcast is not None
        while not self._started.is_set():
            self._broadcast.put(b"", attachment=hello)
            if self._heard.issuperset(meeting.neighbours):
                self._send(Ready(self._id, meeting.tick))
            try:
                message = self._inbox.get(timeout=RETRY_S)
            except queue.Empty:
                continue
            if isinstance(message, End | Failed):
                return message
            if isinstance(message, Gone):
                self._lose(message)
        return None

    def _lose(self, gone: Gone) -> None:
        """Go on without a robot."""
        if self._robot is None:
            return  # in real time silence tells; whoever says this is not the plant
        try:
            with self._lock:
                drive = self._robot.on_loss(gone.robot, gone.tick)
                if drive is not None:
                    self._to_plant.put(encode(drive))
        except LawFailed as error:
            self._fail(error)

    def _attend(self, robot: Robot) -> Any:
        """Wait for the end; meanwhile say for whom the robot waits, if it does."""
        last: int | None = None
        asked: CatchUp | None = None
        while True:
            try:
                message = self._inbox.get(timeout=_POLL_S if asked else PATIENCE_S)
            except queue.Empty:
                message = None
            if asked is not None:
                with self._lock:
                    caught_up = not robot.lacking(asked.tick)
                if caught_up:
                    self._send(asked)
                    asked = None
            if message is None:
                with self._lock:
                    tick, awaited = robot.pending_tick, robot.awaited()
                if tick is not None and tick == last and awaited:
                    self._send(Waiting(self._id, tick, awaited))
                last = tick
            elif isinstance(message, End | Failed):
                return message
            elif isinstance(message, Gone):
                self._lose(message)
            elif isinstance(message, CatchUp):
                asked = message
            elif isinstance(message, Meet):
                self._heard.difference_update(message.neighbours)
                self._started.clear()
                end = self._meet(message)
                if end is not None:
                    return end

    def _flush(self, robot: Robot, *, last: str | None = None) -> None:
        """Report fates and refusals; the caller holds the lock.

        ``last`` is what becomes of what is still in flight.
        """
        rows = robot.take_link_rows() if last is None else robot.take_last_link_rows(last)
        rejections = robot.take_rejections()
        for start in range(0, len(rows), _FLUSH_ROWS):
            self._send(Links(self._id, rows[start : start + _FLUSH_ROWS]))
        for rejection in rejections:
            self._send(rejection)

    def _send(self, message: Message) -> None:
        self._to_plant.put(encode(message))

    # --- Zenoh's threads -------------------------------------------------------------

    def _on_plant(self, sample: zenoh.Sample) -> None:
        try:
            message = decode(sample.payload.to_bytes())
        except MessageError as problem:  # mypyc: a name has one type
            self._refuse(str(problem))
            return
        if type(message) is Measured and self._loop is not None:
            try:
                self._loop.on_measured(message)
            except LawFailed as error:
                self._fail(error)
            return
        if type(message) is not Sense:
            if type(message) is Begin:
                self._started.set()
            self._inbox.put(message)
            return
        robot, broadcast = self._robot, self._broadcast
        if robot is None or broadcast is None:
            return
        if not self._started.is_set():
            self._started.set()
            self._inbox.put(Ready(self._id, message.tick))  # wakes the handshake
        try:
            with self._lock:
                outgoing, drive = robot.on_sense(message)
                if outgoing is not None:  # first: one that dies in between blocks nobody
                    broadcast.put(outgoing.payload, attachment=outgoing.envelope.pack())
                if drive is not None:
                    self._to_plant.put(encode(drive))
                if robot.unreported >= _FLUSH_ROWS or message.tick >= self._report_tick:
                    self._report_tick = message.tick + self._report_ticks
                    self._flush(robot)
        except LawFailed as error:
            self._fail(error)

    def _refuse(self, reason: str) -> None:
        """Count what came on the plant's key and is none of its; tell at every doubling."""
        self._refused[reason] += 1
        count = self._refused[reason]
        if count & (count - 1) == 0:
            self._send(Rejected(self._id, PLANT, reason, count))

    def _on_broadcast(self, source: int, sample: zenoh.Sample) -> None:
        self._heard.add(source)
        if self._loop is not None:
            self._loop.on_broadcast(source, sample)
            return
        robot, attachment = self._robot, sample.attachment
        assert robot is not None
        try:
            with self._lock:
                drive = robot.on_broadcast(
                    source,
                    sample.payload.to_bytes(),
                    None if attachment is None else attachment.to_bytes(),
                )
                if drive is not None:
                    self._to_plant.put(encode(drive))
        except LawFailed as error:
            self._fail(error)

    def _on_plant_liveliness(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            self.stop("the plant is gone")

    def _fail(self, error: BaseException) -> None:
        traceback.print_exc()
        what = str(error) if isinstance(error, LawFailed) else f"{type(error).__name__}: {error}"
        failed = Failed(self._id, what[:MOST_TEXT])
        self._send(failed)
        self._inbox.put(failed)


def main(
    *,
    robot: int,
    run: str,
    connect: str,
    stop_at_end_of_input: bool,
    keys: Path | None = None,
    plaintext: bool = False,
    lease_s: float = bus.LONG_LEASE_S,
    law: LawFactory = make,
) -> int:
    """Run robot ``robot`` of run ``run`` against the plant at ``connect``; returns the exit code.

    ``law`` makes its law: the one that the plan names, or another.
    ``keys``, ``plaintext`` and ``lease_s`` are as in :func:`formation.wire.bus.session`.

    Raises:
        BusError: the plant cannot be reached, or must not be in this way.
        KeysError: the robot's keys are not in ``keys``.
    """
    credentials = None if keys is None else Credentials(keys, robot_name(robot))
    opened = bus.session(
        connect=connect, credentials=credentials, plaintext=plaintext, lease_s=lease_s
    )
    with opened as session:
        process = RobotProcess(session, robot, run, law)
        on_stop(process.stop, at_end_of_input=stop_at_end_of_input)
        return process.run()
