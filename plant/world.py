"""All robots' bodies and the virtual time they share, as a pure core.

The plant owns virtual time. At tick k it measures every robot that is up (``Sense``)
and integrates over [t_k, t_{k+1}) once it has the answer (``Drive``) of each. The body of
a robot that is down does what ``[plant] body_on_failure`` says. The last tick is measured
and answered but not integrated, so a run of N periods has N + 1 samples and every sample
has its command.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

from formnet.formation.briefing.plan import Plan
from formnet.formation.plan.roster import Happening, Roster
from formnet.formation.records.rows import LinkRow, Sample
from formnet.formation.wire.messages import Drive, Sense
from formnet.formation.wire.state import State, finite
from formnet.formation.wire.tuples import make
from formnet.netem.core.transit import LOST_DOWN
from formnet.netem.settings.timeline import NEVER
from formnet.plant.body import Body, driven, left_alone, steered
from formnet.plant.extremes import Extremes

BAD_COMMAND = "its command is not finite"
BAD_STATE = "the state that its command leads to is not finite"
RUNAWAY = 1e3
"""A robot that is faster (m/s or rad/s) has diverged, and takes with it whoever hears it."""


class Diverged(NamedTuple):
    """At ``t_ns`` a robot's command, or where it leads, was not finite, because of ``robot``."""

    t_ns: int
    robot: int
    reason: str


def diverged(t_ns: int, states: Mapping[int, State], blown: int, why: str) -> Diverged:
    """Who is to blame for what became of ``blown`` (and ``why``): who runs away fastest.

    ``states`` are those before, of all robots.
    """
    fastest = max(states, key=lambda robot: _pace(states[robot]))
    if not _pace(states[fastest]) > RUNAWAY:
        return Diverged(t_ns, blown, why)
    speed, turn_rate = states[fastest][3:]
    reason = f"it runs away, at {speed:.2g} m/s and {turn_rate:.2g} rad/s"
    return Diverged(t_ns, fastest, reason)


def _pace(state: State) -> float:
    return max(abs(state.speed_mps), abs(state.turn_rate_radps))


class World:
    """Feed it drives; it returns the senses to send when a tick is complete.

    Attributes:
        tick: the current one.
        up: the robots that take part in it, in the order of the file.
        finished: whether the last tick is complete.
        changed: whether ``up`` is not what it was at the tick before.
        happenings: what is planned for this tick; the shell sees to it before it sends senses.
        extremes: those of the motion, over the ticks that are complete.
    """

    def __init__(self, plan: Plan) -> None:
        self.ids = list(plan.ids)
        self.tick = 0
        self.finished = False
        self.diverged: Diverged | None = None
        self._roster: Roster = plan.roster()
        self._neighbours = plan.neighbours_of
        self._plant = plan.plant
        self._down_rows: list[LinkRow] = []
        self.up: list[int] = []
        self.changed = True
        self.happenings: list[Happening] = []
        self._open: set[int] = set()  # who has not answered yet
        self._next_change = 0  # the next tick at which somebody goes down or comes back
        self._ticks = plan.ticks
        self._period_ns = plan.clock.control_period_ns
        self._period_s = self._period_ns * 1e-9
        self._record_every = plan.clock.broadcast_every
        self._dynamic = plan.law.level == "dynamic"
        self._bodies = {robot: Body.of(plan.vehicles[robot]) for robot in self.ids}
        self._states = {robot: plan.starts[robot] for robot in self.ids}
        self._next: dict[int, State] = {}
        self._drives: dict[int, Drive] = {}  # of this tick
        self.extremes = Extremes(self.ids, dynamic=self._dynamic)
        self._samples: list[Sample] = []
        self._row: dict[int, Sample] = {}
        self._recording = True  # whether this tick is
        self._blown: dict[int, str] = {}  # robots whose next state is not finite, and why
        self._enter(0)

    @property
    def t_ns(self) -> int:
        """Virtual time of the current tick."""
        return self.tick * self._period_ns

    def senses(self) -> list[tuple[int, Sense]]:
        """What to tell each robot that takes part in the current tick."""
        return [(robot, make(Sense, (self.tick, self._states[robot]))) for robot in self.up]

    def awaited(self) -> list[int]:
        """Robots whose answer the current tick still lacks."""
        return [] if self.finished else [r for r in self.up if r in self._open]

    def on_drive(self, drive: Drive) -> Sense:
        """One robot's answer; returns what it will be told at the next tick.

        The last answer of a tick moves ``tick`` on, or sets ``finished``.

        Raises:
            ValueError: from a robot that is unknown or down, for another tick, or a second
                answer.
        """
        robot = drive.robot
        if drive.tick != self.tick or robot not in self._open:
            raise ValueError(
                f"unexpected drive of robot {robot} for tick {drive.tick} (the plant is at "
                f"tick {self.tick} and awaits robots {self.awaited()})"
            )
        state = self._states[robot]
        if self._recording:
            self._record(robot, state, drive)
        self._drives[robot] = drive
        self._next[robot] = reached = self._moved(robot, state, drive)
        if not finite(reached):
            commanded = math.isfinite(drive.right) and math.isfinite(drive.left)
            self._blown[robot] = BAD_STATE if commanded else BAD_COMMAND
        self._open.discard(robot)
        if not self._open:
            self._complete()
        return make(Sense, (drive.tick + 1, reached))

    def idle(self) -> None:
        """Move on to the next tick with somebody up, or with something planned, or to the end."""
        while not (self.up or self.finished):
            self._complete()
            if self.happenings:
                break

    def lose(self, robot: int) -> int:
        """``robot`` is gone, unplanned; returns from which tick on: this one unless it answered."""
        answered = robot not in self._open
        gone = self.tick + answered
        self._roster.lose(robot, gone)
        self._next_change = min(self._next_change, self.tick + 1)
        if not answered:
            self.up.remove(robot)
            self._open.discard(robot)
            if self.up and not self._open:
                self._complete()
        return gone

    def take_samples(self) -> list[Sample]:
        """Recorded samples since the last call, whole ticks only, in tick and file order."""
        samples, self._samples = self._samples, []
        return samples

    def take_down_rows(self) -> list[LinkRow]:
        """Fates of messages to robots without a process since the last call."""
        rows, self._down_rows = self._down_rows, []
        return rows

    def _complete(self) -> None:
        if len(self._next) < len(self.ids):
            self._leave_the_others()
        self._note_extremes()
        if self._row:
            self._samples.extend(self._row[robot] for robot in self.ids)
            self._row = {}
        if self._blown:  # the first in file order: the order of arrival must not matter
            first = next(robot for robot in self.ids if robot in self._blown)
            self.diverged = diverged(self.t_ns, self._states, first, self._blown[first])
        if self.tick == self._ticks or self._blown:
            self.finished = True
            self.happenings = []
            return
        self._states, self._next = self._next, {}
        self._enter(self.tick + 1)

    def _note_extremes(self) -> None:
        t_ns, drives = self.t_ns, self._drives
        self.extremes.at(t_ns, self._states)
        for robot, drive in drives.items():
            self.extremes.asked(t_ns, robot, drive.right, drive.left)
        drives.clear()

    def _enter(self, tick: int) -> None:
        self.tick = tick
        self._recording = tick % self._record_every == 0 or tick == self._ticks
        self.changed = tick >= self._next_change
        if self.changed:
            self._change()
        elif self.happenings:
            self.happenings = []
        self._open.update(self.up)

    def _change(self) -> None:
        planned = self._roster.happenings()
        self.happenings = [some for some in planned if some.tick == self.tick]
        self._next_change = min(
            (some.tick for some in planned if some.tick > self.tick), default=NEVER
        )
        self.up = [robot for robot in self.ids if self._roster.up(robot, self.tick)]

    def _leave_the_others(self) -> None:
        """What happens to robots that are down, and to messages to those without a process."""
        over = self.tick == self._ticks
        for robot in self.ids:
            if robot in self._next:
                continue
            state = self._states[robot]
            if self._recording:
                torque = 0.0 if self._dynamic and self._plant.body_on_failure == "coast" else None
                self._row[robot] = make(Sample, (self.t_ns, robot, *state, torque, torque))
            body = self._bodies[robot] if self._dynamic else None
            reached = state if over else left_alone(self._plant, body, state, self._period_s)
            self._next[robot] = reached
            if not finite(reached):
                self._blown[robot] = BAD_STATE
        if self.tick % self._record_every:
            return
        for source in self.up:
            for robot in self._neighbours[source]:
                if self._roster.killed(robot, self.tick):
                    row = (
                        self.t_ns,
                        None,
                        source,
                        robot,
                        self.tick // self._record_every,
                        LOST_DOWN,
                    )
                    self._down_rows.append(make(LinkRow, row))

    def _moved(self, robot: int, state: State, drive: Drive) -> State:
        """Where the drive takes the robot; not finite if the drive is not."""
        if self.tick == self._ticks:
            return state
        if not (math.isfinite(drive.right) and math.isfinite(drive.left)):
            return State(*[math.nan] * 5)
        if self._dynamic:
            return driven(self._bodies[robot], state, drive.right, drive.left, self._period_s)
        return steered(state, drive.right, drive.left, self._period_s)

    def _record(self, robot: int, state: State, drive: Drive) -> None:
        body = self._bodies[robot]
        torques: tuple[float | None, float | None] = (None, None)
        if self._dynamic:
            torques = body.saturated(drive.right), body.saturated(drive.left)
        self._row[robot] = make(Sample, (self.t_ns, robot, *state, *torques))
