"""A bus in memory, with a clock of its own, for a plant and robots that do as they are told.

All is in one thread: the plant's main loop waits for its mailbox, and while it waits the bus hands
messages over and lets robots act, in order of time. A wait of a minute takes no time at all.
"""

import heapq
from collections import deque
from itertools import count

from formnet.formation.records import events
from formnet.formation.wire.messages import (
    KILL,
    PROTOCOL,
    Brief,
    CatchUp,
    Drive,
    End,
    Gone,
    Join,
    Meet,
    Ready,
    Sense,
    decode,
    encode,
)
from formnet.plant.host import Mailbox

RETRY_S = 0.1
"""How often a robot repeats what must not be lost."""
DELAY_S = 1e-6
"""How long a message is on its way."""


class MemoryMailbox(Mailbox):
    """The main thread's; its clock is hand-set by waiting."""

    def __init__(self):
        self._left = deque()
        self._events = []
        self._number = count()
        self._now_s = 0.0

    def now_s(self):
        return self._now_s

    def put(self, note):
        self._left.append(note)

    def get(self, timeout_s):
        deadline_s = self._now_s + timeout_s
        while not self._left:
            if not self._events or self._events[0][0] > deadline_s:
                self._now_s = deadline_s
                return None
            self._now_s, _, act = heapq.heappop(self._events)
            act()
        return self._left.popleft()

    def after(self, seconds, act):
        """Do something later."""
        heapq.heappush(self._events, (self._now_s + seconds, next(self._number), act))


class MemoryBus:
    """A plant's bus (:class:`formnet.formation.wire.plant_bus.PlantBus`) and all robots of a run.

    Also a sink, which does to robots what a launcher does to their processes. ``records`` is what
    the plant reported.
    """

    def __init__(self, ids):
        self.mailbox = MemoryMailbox()
        self.robots = {robot: Robot(self, robot) for robot in ids}
        self.records = []

    def sender(self, robot):
        return lambda data: self.mailbox.after(DELAY_S, lambda: self.robots[robot].take(data))

    def listen(self, robots, receive, refuse, connected):
        self.receive, self.refuse, self.connected = receive, refuse, connected
        assert list(robots) == list(self.robots)
        for robot in self.robots.values():
            robot.start()

    def overhear(self, source, receive):
        raise NotImplementedError

    def __call__(self, record):
        self.records.append(record)
        match record:
            case events.Kill(robots=robots):
                for robot in robots:
                    self.robots[robot].end()
            case events.Restart(robots=robots):
                for robot in robots:
                    self.robots[robot].start()

    def told(self, kind):
        """The events of a class, in order."""
        return [record for record in self.records if isinstance(record, kind)]


class Robot:
    """Meets everybody it has to, answers every sense with no torque, and says its last.

    It does not what ``deaf`` holds (classes of the plant's messages), and from tick ``silent_from``
    on nothing at all. ``at`` has what happens at a tick before it answers.
    """

    def __init__(self, bus, robot):
        self.robot = robot
        self.heard = []
        self.protocol = PROTOCOL
        self.deaf = ()
        self.silent_from = None
        self.at = {}
        self.late_s = 0.0  # how long it takes to be there
        self.absent = False  # never there, though started
        self._bus = bus
        self._life = 0
        self._alive = False
        self._repeated = None

    def start(self):
        """A new process."""
        self._life += 1
        if not self.absent:
            self._later(self.late_s, self._connect)

    def end(self):
        """The process ends, and its connection with it."""
        if self._alive:
            self._alive, self._repeated = False, None
            self._life += 1
            self._bus.mailbox.after(DELAY_S, lambda: self._bus.connected(self.robot, False))

    def say(self, message):
        """Send the plant a message."""
        data = encode(message)
        self._later(DELAY_S, lambda: self._bus.receive(self.robot, decode(data)))

    def take(self, data):
        """What the plant has sent."""
        if not self._alive:
            return
        message = decode(data)
        self.heard.append(message)
        if isinstance(message, self.deaf):
            return
        match message:
            case Brief() | Meet():
                self._repeat(Ready(self.robot, message.tick))
            case Sense(tick=tick):
                self._repeated = None
                if tick in self.at:
                    self.at.pop(tick)()
                if self._alive and (self.silent_from is None or tick < self.silent_from):
                    self.say(Drive(self.robot, tick, 0.0, 0.0))
            case CatchUp():
                self.say(message)
            case End(reason=reason):
                self.say(End(self.robot, "", message.tick))
                if reason != KILL:
                    self._later(2 * DELAY_S, self.end)

    def lost(self):
        """Whom it was told to go on without, and from which tick on."""
        return [(gone.robot, gone.tick) for gone in self.heard if isinstance(gone, Gone)]

    def _connect(self):
        self._alive = True
        self._bus.connected(self.robot, True)
        self._repeat(Join(self.robot, self.protocol))

    def _repeat(self, message):
        self._repeated = message

        def again():
            if self._repeated is message:
                self.say(message)
                self._later(RETRY_S, again)

        again()

    def _later(self, seconds, act):
        """Do something, if this process is still there by then."""
        life = self._life
        self._bus.mailbox.after(seconds, lambda: act() if life == self._life else None)
