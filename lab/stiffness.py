"""Whether gains and control period get along: how stiff the law makes the loop on the way in.

A command is held for a control period h. Where the closed loop, linearised, has an eigenvalue
λ with h |λ| beyond 2, a held command overshoots by more than it corrects: the robot chatters
or diverges. Far from the pattern the law is stiffest, and at speed stiffer still, so the way in
is followed from the starting poses, by steps that are short enough. It is an estimate: what
links lose, and when they change, is left out.
"""

import time
from collections import deque
from collections.abc import Iterator
from math import ceil, cos, floor, inf, log10, sin

import numpy as np
from numpy.typing import NDArray

from agent.law import Law, make
from formation.messages import Stamped, State
from formation.scenario import Scenario
from formation.theory import assess
from netem.tables import nanoseconds
from plant.body import Body, driven, steered

LIMIT = 2.0
"""h |λ| at which a held command turns a decay 1 − h |λ| into a growth."""
SHORTEST_S = 1e-5
"""No shorter period is suggested: a second would have more than 100,000 of them."""
MARGIN = 0.5
"""Of the longest period that works, what is suggested."""
SHARE = 0.2
"""Of the fastest time constant, the length of a step on the way in."""
HORIZON_S = 10.0
"""How much of the way is followed, at most."""
LOOKS = 400
"""At most so many looks at the eigenvalues; then the way ends earlier."""
MOST_S = 3.0
"""A law that takes its time is not followed for longer before a run, in wall time."""
STEPS = 5
"""Steps from one look to the next."""

Course = list[tuple[float, float]]
"""The largest |λ| (1/s) of all robots, and for how long (s) it lasts, again and again."""


def warnings(scenario: Scenario) -> list[str]:
    """What theory and sampling have against a valid scenario whose law can be had."""
    return [*assess(scenario).warnings, *_sampling(scenario)]


def course(scenario: Scenario, most_s: float = inf) -> Course:
    """How fast the closed loop is on the way in; empty if the law does not lead there.

    Where that takes longer than ``most_s``, as far as it was followed.
    """
    try:
        found = list(_Way(scenario).looks(time.monotonic() + most_s))
    except Exception:  # a plug-in may raise anything; the run will say what
        return []
    return found if all(rate < inf for rate, _ in found) else []


def longest_period_s(course: Course) -> float:
    """The longest control period that keeps h |λ| below 2, but for less than one period."""
    above_s = 0.0
    for rate, lasts_s in sorted(course, reverse=True):
        above_s += lasts_s
        if above_s * rate >= LIMIT:
            return LIMIT / rate
    return inf


def _sampling(scenario: Scenario) -> Iterator[str]:
    period_s = scenario.clock.control_period_s
    longest_s = longest_period_s(course(scenario, MOST_S))
    if period_s <= longest_s:
        return
    if longest_s >= SHORTEST_S:
        suggested_s = _part_of(scenario.clock.broadcast_period_s, longest_s)
        advice = [f"control_period_s <= {suggested_s:g}"]
    else:
        advice = ["smaller gains", "a larger law.length_scale_m"]
    beta = _softer(scenario)
    if beta is not None:
        advice.append(f"law.beta <= {beta:g}")
    yield (
        f"clock.control_period_s = {period_s:g}: too long for these gains; from these starts the "
        f"closed loop is as fast as {LIMIT / longest_s:.3g} 1/s, so commands held for more than "
        f"about {longest_s:.2g} s chatter or diverge. Try {', or '.join(advice)}"
    )


def _part_of(broadcast_period_s: float, longest_s: float) -> float:
    """A control period well below the longest of which the broadcast period is a multiple."""
    parts = broadcast_period_s / (MARGIN * longest_s)
    tens = 10 ** max(0, floor(log10(parts))) if parts > 1.0 else 1
    return broadcast_period_s / min(k * tens for k in (1, 2, 4, 5, 8, 10) if k * tens >= parts)


def _softer(scenario: Scenario) -> float | None:
    """The largest β (two digits) that goes well with the period, if one does without harm."""
    if scenario.law.kind != "cooperative":
        return None
    known = assess(scenario).warnings
    beta = scenario.law.beta
    for _ in range(10):
        beta = _two_digits(0.75 * beta)
        law = scenario.law.model_copy(update={"beta": beta})
        changed = scenario.model_copy(update={"law": law})
        if assess(changed).warnings != known:
            return None
        if scenario.clock.control_period_s <= MARGIN * longest_period_s(course(changed, MOST_S)):
            return beta
    return None


def _two_digits(value: float) -> float:
    """``value`` rounded down to two significant digits."""
    unit = 10.0 ** (floor(log10(value)) - 1)
    return float(f"{floor(value / unit) * unit:.2g}")


class _Way:
    """All robots on the way in, each with its law, its body and its neighbours.

    What is heard comes when it is broadcast, and as late as half of the messages do.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._end_ns = nanoseconds(min(HORIZON_S, scenario.duration_s))
        self._dynamic = scenario.law.level == "dynamic"
        self._every_ns = scenario.clock.broadcast_period_ns
        self._delays_ns = {link: _delay_ns(scenario, *link) for link in scenario.directed_links}
        self._neighbours = scenario.neighbours_of
        self._laws: dict[int, Law] = {robot: make(scenario, robot) for robot in scenario.ids}
        self._bodies = {robot: Body.of(scenario.vehicles[robot]) for robot in scenario.ids}
        self._states = {robot: scenario.start_state(robot) for robot in scenario.ids}
        self._broadcasts: deque[tuple[int, dict[int, State]]] = deque()

    def looks(self, until_s: float) -> Iterator[tuple[float, float]]:
        """One entry of a :data:`Course` after the other, until :func:`time.monotonic` is there."""
        now_ns = 0
        for _ in range(LOOKS):
            if now_ns >= self._end_ns or time.monotonic() > until_s:
                return
            rate = self._rate(now_ns)
            step_ns = min(ceil(SHARE / max(rate, 1e-3) * 1e9), ceil(self._end_ns / 200))
            yield rate, STEPS * step_ns / 1e9
            for _ in range(STEPS):
                self._step(now_ns, step_ns)
                now_ns += step_ns

    def _step(self, now_ns: int, step_ns: int) -> None:
        heard = self._heard(now_ns)
        reached = {}
        for robot, state in self._states.items():
            first, second = self._laws[robot].command(now_ns, state, heard[robot])
            if self._dynamic:
                reached[robot] = driven(self._bodies[robot], state, first, second, step_ns / 1e9)
            else:
                reached[robot] = steered(state, first, second, step_ns / 1e9)
        self._states = reached

    def _heard(self, now_ns: int) -> dict[int, tuple[Stamped, ...]]:
        sent = self._broadcasts
        if not sent or now_ns >= sent[-1][0] + self._every_ns:
            sent.append((now_ns, self._states))
        oldest_ns = now_ns - max(self._delays_ns.values(), default=0)
        while len(sent) > 1 and sent[1][0] <= oldest_ns:
            sent.popleft()
        return {
            robot: tuple(
                message
                for other in others
                for message in self._newest(other, now_ns - self._delays_ns[other, robot])
            )
            for robot, others in self._neighbours.items()
        }

    def _newest(self, robot: int, until_ns: int) -> list[Stamped]:
        """The newest broadcast of ``robot`` up to an instant; none if there is none."""
        for stamp_ns, states in reversed(self._broadcasts):
            if stamp_ns <= until_ns:
                return [Stamped(robot, stamp_ns, states[robot])]
        return []

    def _rate(self, now_ns: int) -> float:
        """The largest |λ| of all robots now."""
        heard = self._heard(now_ns)
        jacobians = [self._jacobian(robot, now_ns, heard[robot]) for robot in self._states]
        if not np.all(np.isfinite(jacobians)):
            return inf
        return float(np.abs(np.linalg.eigvals(np.array(jacobians))).max())

    def _jacobian(self, robot: int, now_ns: int, heard: tuple[Stamped, ...]) -> NDArray[np.float64]:
        """The closed loop of one robot, linearised, its neighbours standing still."""
        state = self._states[robot]
        columns = []
        for axis in range(5 if self._dynamic else 3):
            step = 1e-6 * max(1.0, abs(state[axis]))
            ahead, behind = (
                self._derivative(robot, now_ns, _shifted(state, axis, by), heard)
                for by in (step, -step)
            )
            columns.append((ahead - behind) / (2.0 * step))
        return np.array(columns).T

    def _derivative(
        self, robot: int, now_ns: int, state: State, heard: tuple[Stamped, ...]
    ) -> NDArray[np.float64]:
        """How the state changes under the law's command: (5,), kinematic (3,)."""
        first, second = self._laws[robot].command(now_ns, state, heard)
        c, s = cos(state.heading_rad), sin(state.heading_rad)
        if not self._dynamic:
            return np.array([first * c, first * s, second])
        body, v, omega = self._bodies[robot], state.speed_mps, state.turn_rate_radps
        right, left = body.saturated(first), body.saturated(second)
        force = (right + left) / body.wheel_radius_m
        yaw = body.half_axle_m * (right - left) / body.wheel_radius_m
        return np.array([v * c, v * s, omega, *body.accelerations(v, omega, force, yaw)])


def _shifted(state: State, axis: int, by: float) -> State:
    return State(*(value + by if place == axis else value for place, value in enumerate(state)))


def _delay_ns(scenario: Scenario, source: int, destination: int) -> int:
    """How late half of the messages on a link are, but for what its rate adds."""
    settings = scenario.link_settings(source, destination)
    return nanoseconds(settings.playout_s or settings.delay.quantile_s(0.5))
