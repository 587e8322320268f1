"""All robots' bodies and the virtual time they share, as a pure core.

The plant owns virtual time. At tick k it measures every robot (``Sense``) and
integrates over [t_k, t_{k+1}) once it has every robot's answer (``Drive``). The
last tick is measured and answered but not integrated, so a run of N periods has
N + 1 samples and every sample has its command.
"""

import math
from typing import NamedTuple

from formation.messages import Drive, Sense, State, finite, make
from formation.record import Sample
from formation.scenario import Scenario
from plant.body import Body, driven, steered

DIVERGED = "its command, or the state it leads to, is not finite"


class Diverged(NamedTuple):
    """A robot's command at ``t_ns``, or where it leads, is not finite."""

    t_ns: int
    robot: int


class World:
    """Feed it drives; it returns the senses to send when a tick is complete."""

    def __init__(self, scenario: Scenario) -> None:
        self.ids = scenario.ids
        self.tick = 0
        self.finished = False
        self.diverged: Diverged | None = None
        self._count = len(self.ids)
        self._ticks = scenario.ticks
        self._period_ns = scenario.clock.control_period_ns
        self._period_s = self._period_ns * 1e-9
        self._record_every = scenario.clock.broadcast_every
        self._dynamic = scenario.law.level == "dynamic"
        self._bodies = {robot: Body.of(scenario.vehicles[robot]) for robot in self.ids}
        self._states = {robot: scenario.start_state(robot) for robot in self.ids}
        self._next: dict[int, State] = {}
        self._samples: list[Sample] = []
        self._row: dict[int, Sample] = {}
        self._recording = True  # whether this tick is
        self._blown: list[int] = []  # robots whose next state is not finite

    @property
    def t_ns(self) -> int:
        """Virtual time of the current tick."""
        return self.tick * self._period_ns

    def senses(self) -> list[tuple[int, Sense]]:
        """What to tell each robot at the current tick."""
        return [(robot, make(Sense, (self.tick, self._states[robot]))) for robot in self.ids]

    def awaited(self) -> list[int]:
        """Robots whose answer the current tick still lacks."""
        return [] if self.finished else [r for r in self.ids if r not in self._next]

    def on_drive(self, drive: Drive) -> Sense:
        """One robot's answer; returns what it will be told at the next tick.

        The last answer of a tick moves ``tick`` on, or sets ``finished``.

        Raises:
            ValueError: from an unknown robot, for another tick, or a second answer.
        """
        robot = drive.robot
        state = self._states.get(robot)
        if state is None or self.finished or drive.tick != self.tick or robot in self._next:
            raise ValueError(
                f"unexpected drive of robot {robot} for tick {drive.tick} (the plant is at "
                f"tick {self.tick} and awaits robots {self.awaited()})"
            )
        if self._recording:
            self._record(robot, state, drive)
        self._next[robot] = reached = self._moved(robot, state, drive)
        if not finite(reached):
            self._blown.append(robot)
        if len(self._next) == self._count:
            self._complete()
        return make(Sense, (drive.tick + 1, reached))

    def take_samples(self) -> list[Sample]:
        """Recorded samples since the last call, whole ticks only, in tick and file order."""
        samples, self._samples = self._samples, []
        return samples

    def _complete(self) -> None:
        if self._row:
            self._samples.extend(self._row[robot] for robot in self.ids)
            self._row = {}
        if self._blown:  # the first in file order: the order of arrival must not matter
            first = next(robot for robot in self.ids if robot in self._blown)
            self.diverged = Diverged(self.t_ns, first)
        if self.tick == self._ticks or self._blown:
            self.finished = True
            return
        self._states, self._next = self._next, {}
        self.tick += 1
        self._recording = self.tick % self._record_every == 0 or self.tick == self._ticks

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
