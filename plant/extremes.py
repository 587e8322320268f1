"""The extremes of the motion, over every control tick of a run: what no claim speaks of.

The smallest distance between two robots, the top speed, the top turn rate and the top command,
each with its robots and its instant. Of equal values the earliest counts, and at one instant
that of the robot, or of the pair, which is first in the scenario's file.

The smallest distance is that of all ticks and pairs, to the bit, without looking at all pairs
at every tick. What robots move by within a tick lies in a box, and no distance shrinks by more
than the box's diagonal. So a pair that is further apart than the smallest distance so far by
some slack is not looked at again before the diagonals have added up to its slack.
"""

from collections.abc import Mapping, Sequence
from heapq import heapify, heappop, heappush
from math import hypot, inf, isfinite, nextafter
from typing import Any, Final, NamedTuple

from formation.messages import State

_ROUNDING: Final = 4e-15
"""More than the relative error of any distance and diagonal here, some units of 2⁻⁵³."""
_TINY: Final = 1e-300
"""More than their error where numbers are subnormal, in metres."""
_MOST_MOTION_M: Final = 1e9
"""How far the diagonals may add up before all pairs are looked at anew."""


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
        self._due: list[tuple[float, int, int]] = []  # a heap: from which ``_moved_m`` on, a pair

    def at(self, t_ns: int, states: Mapping[int, State]) -> None:
        """All robots' states at a tick, later than the last one; finite, and not changed later."""
        before = self._before or states
        speed, turn_rate = self._speed.value, self._turn_rate.value
        low_x = low_y = inf
        high_x = high_y = -inf
        for robot in self._ids:
            state, old = states[robot], before[robot]
            if abs(state[3]) > speed:
                speed = abs(state[3])
                self._speed = Extreme(speed, t_ns, [robot])
            if abs(state[4]) > turn_rate:
                turn_rate = abs(state[4])
                self._turn_rate = Extreme(turn_rate, t_ns, [robot])
            step_x, step_y = state[0] - old[0], state[1] - old[1]
            if step_x < low_x:
                low_x = step_x
            if step_x > high_x:
                high_x = step_x
            if step_y < low_y:
                low_y = step_y
            if step_y > high_y:
                high_y = step_y
        first, self._before = not self._before, states
        # A step is known to a few units of its own last place, not of the box's.
        furthest = max(abs(low_x), abs(high_x)) + max(abs(low_y), abs(high_y))
        diagonal = hypot(high_x - low_x, high_y - low_y) + _ROUNDING * furthest
        if diagonal == 0.0 and not first:
            return
        self._moved_m = nextafter(self._moved_m + diagonal, inf)
        if first or not self._moved_m < _MOST_MOTION_M:  # also NaN
            self._look_at_all(t_ns)
        else:
            self._look_at_due(t_ns)

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

    def details(self) -> dict[str, Any]:
        """As in an event: instants in seconds; None for what there is not (a distance of one)."""
        closest = self._closest
        return {
            "closest": None if closest.value == inf else {
                "distance_m": closest.value, "robots": closest.robots, "t_s": closest.t_ns / 1e9,
            },
            "top_speed": _told("speed_mps", self._speed),
            "top_turn_rate": _told("turn_rate_radps", self._turn_rate),
            "top_command": _told("torque_nm" if self._dynamic else "speed_mps", self._command),
        }  # fmt: skip

    def _look_at_all(self, t_ns: int) -> None:
        self._moved_m = 0.0
        count = len(self._ids)
        self._due = []
        found = [
            (self._distance(one, other), one, other)
            for one in range(count)
            for other in range(one + 1, count)
        ]
        self._compare(t_ns, found)
        self._due = [(self._due_from(pair[0]), pair[1], pair[2]) for pair in found]
        heapify(self._due)

    def _look_at_due(self, t_ns: int) -> None:
        due, moved_m = self._due, self._moved_m
        found: list[tuple[float, int, int]] = []
        while due and due[0][0] < moved_m:
            pair = heappop(due)
            found.append((self._distance(pair[1], pair[2]), pair[1], pair[2]))
        if found:
            self._compare(t_ns, found)
            for pair in found:
                heappush(due, (self._due_from(pair[0]), pair[1], pair[2]))

    def _compare(self, t_ns: int, found: list[tuple[float, int, int]]) -> None:
        """Keep the smallest, if it is smaller than ever; of equal ones the first pair."""
        if not found:
            return
        distance_m, one, other = min(found)
        if distance_m < self._closest.value:
            self._closest = Extreme(distance_m, t_ns, [self._ids[one], self._ids[other]])

    def _due_from(self, distance_m: float) -> float:
        """At which ``_moved_m`` a pair may come closer than the smallest distance, at the least."""
        if distance_m == inf:  # a motion that makes it finite is beyond the most
            return inf
        slack_m = distance_m * (1.0 - _ROUNDING) - self._closest.value * (1.0 + _ROUNDING) - _TINY
        return max(nextafter(self._moved_m + slack_m, -inf), self._moved_m)

    def _distance(self, one: int, other: int) -> float:
        states, ids = self._before, self._ids
        here, there = states[ids[one]], states[ids[other]]
        return hypot(here[0] - there[0], here[1] - there[1])


def _told(name: str, extreme: Extreme) -> dict[str, Any] | None:
    if not extreme.robots:
        return None
    return {name: extreme.value, "robot": extreme.robots[0], "t_s": extreme.t_ns / 1e9}
