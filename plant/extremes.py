"""The extremes of the motion, over every control tick of a run: what no claim speaks of.

The smallest distance between two robots, the top speed, the top turn rate and the top command,
each with its robots and its instant. Of equal values the earliest counts, and at one instant
that of the robot, or of the pair, which is first in the scenario's file.

The smallest distance is that of all ticks and pairs, to the bit, without looking at all pairs
at every tick. What robots move by within a tick lies in a box, and no distance shrinks by more
than the box's diagonal. So while the diagonals add up to less than what the nearest pair is
further apart than the smallest distance so far, there is nothing to look at; and while they add
up to less than a reach beyond it, only pairs within that reach. Those are found by a sweep along
the longer side of the formation (Verlet's neighbour list, Phys. Rev. 159 (1967) 98, with sort and
sweep).
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import inf, isfinite, nextafter
from typing import Final, NamedTuple

from formnet.exact.trigonometry import hypot
from formnet.formation.records import events
from formnet.formation.records.motion import Closest, TopSpeed, TopTorque, TopTurnRate
from formnet.formation.wire.state import State

_ROUNDING: Final = 4e-15
"""More than the relative error of any distance and diagonal here, some units of 2⁻⁵³."""
_MOST_MOTION_M: Final = 1e9
"""How far the diagonals may add up before they are counted from 0 again."""
_LISTED_TICKS: Final = 8.0
"""For how many ticks like the last one pairs are listed, at the most."""


class Extreme(NamedTuple):
    """A value, when it was, and whose."""

    value: float
    t_ns: int
    robots: list[int]


_NONE_YET: Final = Extreme(-1.0, 0, [])


class Extremes:
    """Tell it of every tick with :meth:`at` and of every command with :meth:`asked`.

    ``ids`` are the robots in the order of the file. ``dynamic``: a command is the right and the
    left wheel's torque (N m); else a speed (m/s) and a turn rate (rad/s).
    """

    def __init__(self, ids: Sequence[int], *, dynamic: bool) -> None:
        self._ids = list(ids)
        self._place = {robot: place for place, robot in enumerate(self._ids)}
        self._dynamic = dynamic
        self._speed = self._turn_rate = self._command = _NONE_YET
        self._closest = Extreme(inf, 0, [])
        self._before: Mapping[int, State] = {}  # the states of the tick before
        self._moved_m = 0.0  # the diagonals of all ticks, added up; rounded up
        self._near: list[tuple[int, int]] = []  # pairs that may come closest, by their places
        self._listed_until_m = self._quiet_until_m = -1.0  # up to which ``_moved_m`` that holds

    def at(self, t_ns: int, states: Mapping[int, State]) -> None:
        """All robots' states at a tick, later than the last one; finite, and not changed later."""
        before = self._before or states
        speed, turn_rate = self._speed.value, self._turn_rate.value
        low_x = low_y = inf
        high_x = high_y = -inf
        for robot in self._ids:
            x, y, _, v, w = states[robot]
            if abs(v) > speed:
                speed = abs(v)
                self._speed = Extreme(speed, t_ns, [robot])
            if abs(w) > turn_rate:
                turn_rate = abs(w)
                self._turn_rate = Extreme(turn_rate, t_ns, [robot])
            old = before[robot]
            step_x, step_y = x - old[0], y - old[1]
            if step_x < low_x:
                low_x = step_x
            if step_x > high_x:
                high_x = step_x
            if step_y < low_y:
                low_y = step_y
            if step_y > high_y:
                high_y = step_y
        self._before = states
        # A step is known to a few units of its own last place, not of the box's.
        furthest = max(abs(low_x), abs(high_x)) + max(abs(low_y), abs(high_y))
        diagonal_m = hypot(high_x - low_x, high_y - low_y) + _ROUNDING * furthest
        if diagonal_m != 0.0:
            self._moved_m = nextafter(self._moved_m + diagonal_m, inf)
        if not self._moved_m < _MOST_MOTION_M:  # also NaN
            self._moved_m, self._listed_until_m, self._quiet_until_m = 0.0, -1.0, -1.0
            diagonal_m = inf
        if self._moved_m > self._quiet_until_m:
            self._look(t_ns, diagonal_m)

    def asked(self, t_ns: int, robot: int, first: float, second: float) -> None:
        """The command of ``robot``'s law at ``t_ns``; left out where it is not finite."""
        size = abs(first)
        if self._dynamic and abs(second) > size:
            size = abs(second)
        most = self._command
        if size < most.value or not (isfinite(first) and isfinite(second)):
            return
        if size == most.value:
            here, there = self._place[robot], self._place[most.robots[0]]
            if (t_ns, here) >= (most.t_ns, there):
                return
        self._command = Extreme(size, t_ns, [robot])

    def event(self, t_ns: int) -> events.Extremes:
        """As an event at ``t_ns``; None for what there is not (a distance of one)."""
        closest, speed, turn_rate, command = (
            self._closest,
            self._speed,
            self._turn_rate,
            self._command,
        )
        top_command: TopTorque | TopSpeed | None = None
        if command.robots and self._dynamic:
            top_command = TopTorque(command.value, command.robots[0], command.t_ns / 1e9)
        elif command.robots:
            top_command = TopSpeed(command.value, command.robots[0], command.t_ns / 1e9)
        return events.Extremes(
            t_ns,
            closest=None
            if closest.value == inf
            else Closest(closest.value, (closest.robots[0], closest.robots[1]), closest.t_ns / 1e9),
            top_speed=TopSpeed(speed.value, speed.robots[0], speed.t_ns / 1e9)
            if speed.robots
            else None,
            top_turn_rate=TopTurnRate(turn_rate.value, turn_rate.robots[0], turn_rate.t_ns / 1e9)
            if turn_rate.robots
            else None,
            top_command=top_command,
        )

    def _look(self, t_ns: int, diagonal_m: float) -> None:
        """Compare the pairs that may be closer than ever; of equal ones the first counts."""
        listed_m = -1.0
        if self._moved_m > self._listed_until_m:
            listed_m = self._list_near(_LISTED_TICKS * diagonal_m)
        nearest_m, pair = inf, (0, 0)
        for one, other in self._near:
            distance_m = self._distance(one, other)
            if distance_m < nearest_m:
                nearest_m, pair = distance_m, (one, other)
        if nearest_m < self._closest.value:
            self._closest = Extreme(nearest_m, t_ns, [self._ids[place] for place in pair])
        if listed_m >= 0.0:
            self._listed_until_m = self._until(listed_m)
        self._quiet_until_m = min(self._until(nearest_m), self._listed_until_m)

    def _list_near(self, more_m: float) -> float:
        """List pairs up to which distance, some ``more_m`` beyond the smallest; returns which."""
        states = [self._before[robot] for robot in self._ids]
        xs, ys = [state[0] for state in states], [state[1] for state in states]
        long = xs if max(xs) - min(xs) >= max(ys) - min(ys) else ys
        order = sorted(range(len(long)), key=long.__getitem__)
        beside_m = min((self._distance(a, b) for a, b in pairwise(order)), default=inf)
        reach_m = min(self._closest.value, beside_m) + min(more_m, beside_m)
        near: list[tuple[int, int]] = []
        for rank, one in enumerate(order):
            for later in range(rank + 1, len(order)):
                other = order[later]
                if long[other] - long[one] > reach_m:
                    break
                if self._distance(one, other) <= reach_m:
                    near.append((min(one, other), max(one, other)))
        near.sort()
        self._near = near
        return reach_m

    def _until(self, distance_m: float) -> float:
        """Up to which ``_moved_m`` a pair this far apart stays beyond the smallest distance."""
        if distance_m == inf:  # what makes it finite is beyond the most motion
            return inf
        slack_m = distance_m * (1.0 - _ROUNDING) - self._closest.value * (1.0 + _ROUNDING)
        return max(nextafter(self._moved_m + slack_m, -inf), self._moved_m)

    def _distance(self, one: int, other: int) -> float:
        states, ids = self._before, self._ids
        here, there = states[ids[one]], states[ids[other]]
        return hypot(here[0] - there[0], here[1] - there[1])
