"""Whether gains and control period get along: how stiff the law makes the loop on the way in.

A command is held for a control period h. Where the closed loop, linearised, has an eigenvalue
λ with h |λ| beyond 2, a held command overshoots by more than it corrects: the robot chatters
or diverges. Far from the pattern the law is stiffest, and at speed stiffer still, so the way in
is followed from the starting poses, by steps that are short enough, and past the planned return
of robots that are down: they come back late, to gains that grow with time. It is an estimate:
what links lose, and when they change, is left out.
"""

import time
from collections import deque
from collections.abc import Iterator
from math import ceil, cos, exp, floor, inf, log10, nan, sin
from typing import NamedTuple

import numpy as np

from formnet.agent.base import pair
from formnet.agent.law import RAISED, Law, LawFactory, LawFailed, failure, make
from formnet.formation.briefing.resolving import resolve
from formnet.formation.paper.theory import assess
from formnet.formation.plan.roster import Happening
from formnet.formation.scenario.model import Scenario
from formnet.formation.wire.state import Stamped, State, finite
from formnet.netem.files.tables import nanoseconds
from formnet.netem.settings.links import LinkSettings
from formnet.plant.body import Body, driven, left_alone, steered

LIMIT = 2.0
"""h |λ| at which a held command turns a decay 1 − h |λ| into a growth."""
SHORTEST_S = 1e-5
"""No shorter period is suggested: a second would have more than 100,000 of them."""
MARGIN = 0.5
"""Of the longest period that works, what is suggested."""
SHARE = 0.2
"""Of the fastest time constant, the length of a step on the way in."""
HORIZON_S = 10.0
"""How much of the way is followed, at most, from the start and from a robot's return."""
LOOKS = 400
"""At most so many looks at the eigenvalues; then the way ends earlier ..."""
LOOKS_BACK = 4000
"""... unless it is followed to where robots return."""
MOST_S = 3.0
"""A law that takes its time is not followed for longer before a run, in wall time, nor are
gentler gains looked for."""
_TRIES = {"beta": (0.75, 10), "gamma": (0.3, 4)}
"""By which factor a gain is made smaller, and how often."""
STEPS = 5
"""Steps from one look to the next."""


class Look(NamedTuple):
    """From ``at_s`` on, for ``lasts_s``, the largest |λ| of all robots is ``rate`` (1/s)."""

    at_s: float
    rate: float
    lasts_s: float


Course = list[Look]


def warnings(scenario: Scenario, law: LawFactory = make) -> list[str]:
    """What theory and sampling have against a valid scenario whose law, which ``law`` makes, can
    be had."""
    return [*assess(scenario).warnings, *_sampling(scenario, law)]


def course(scenario: Scenario, most_s: float = inf, law: LawFactory = make) -> Course:
    """How fast the closed loop is on the way in; empty if the law does not lead there.

    Where that takes longer than ``most_s``, as far as it was followed.

    Raises:
        LawFailed: the law raised.
    """
    found = list(_Way(scenario, law).looks(time.monotonic() + most_s))
    return found if all(look.rate < inf for look in found) else []


def longest_period_s(course: Course) -> float:
    """The longest control period that keeps h |λ| below 2, but for less than one period."""
    above_s = 0.0
    for look in sorted(course, key=lambda look: look.rate, reverse=True):
        above_s += look.lasts_s
        if above_s * look.rate >= LIMIT:
            return LIMIT / look.rate
    return inf


def _sampling(scenario: Scenario, law: LawFactory) -> Iterator[str]:
    period_s = scenario.clock.control_period_s
    try:
        way = course(scenario, MOST_S, law)
    except LawFailed as error:
        yield f"the law failed in the trial before the run: robot {error.robot}: {error}"
        return
    longest_s = longest_period_s(way)
    if period_s <= longest_s:
        return
    if longest_s >= SHORTEST_S:
        suggested_s = _part_of(scenario.clock.broadcast_period_s, longest_s)
        advice = [f"control_period_s <= {suggested_s:g}"]
    else:
        advice = ["smaller gains", "a larger law.length_scale_m"]
    back = _back(scenario, way)
    when = "from these starts"
    if back is None:
        advice += _softer(scenario, ("beta",))
    else:
        robots, at_s = " and ".join(map(str, back.robots)), back.tick * period_s
        when = f"after the {back.verb} of robot {robots} at {at_s:g} s"
        advice = [*_softer(scenario, ("gamma", "beta")), *advice]
        if advice[0].startswith("law.gamma"):
            steep = exp(scenario.law.gamma * at_s)
            advice[-1] += f" (with a robust term {steep:.2g} times as steep as at the start)"
    yield (
        f"clock.control_period_s = {period_s:g}: too long for these gains: {when} "
        f"the closed loop has a rate of {LIMIT / longest_s:.3g} 1/s, and commands held for more "
        f"than about {longest_s:.2g} s make it chatter or diverge. Try {', or '.join(advice)}"
    )


def _back(scenario: Scenario, way: Course) -> Happening | None:
    """The return of a robot after which the loop is fastest; None if that is before any."""
    fastest_s = max(way, key=lambda look: look.rate).at_s
    period_s = scenario.clock.control_period_s
    back = [some for some in returns(scenario) if some.tick * period_s <= fastest_s]
    return back[-1] if back else None


def returns(scenario: Scenario) -> list[Happening]:
    """When, by the plan, robots that were down take part again, ascending."""
    return [
        happening
        for happening in scenario.roster().happenings()
        if happening.verb in ("restart", "resume") and happening.tick <= scenario.ticks
    ]


def _part_of(broadcast_period_s: float, longest_s: float) -> float:
    """A control period well below the longest of which the broadcast period is a multiple."""
    parts = broadcast_period_s / (MARGIN * longest_s)
    tens = 10 ** max(0, floor(log10(parts))) if parts > 1.0 else 1
    return broadcast_period_s / min(k * tens for k in (1, 2, 4, 5, 8, 10) if k * tens >= parts)


def _softer(scenario: Scenario, gains: tuple[str, ...]) -> Iterator[str]:
    """The largest of each of ``gains`` (two digits) that goes well with the period, if one does."""
    if scenario.law.kind != "cooperative":
        return
    known = assess(scenario).warnings
    period_s = scenario.clock.control_period_s
    until_s = time.monotonic() + MOST_S
    for gain in gains:
        value = getattr(scenario.law, gain)
        factor, tries = _TRIES[gain]
        for _ in range(tries):
            value = _two_digits(factor * value)
            law = scenario.law.model_copy(update={gain: value})
            changed = scenario.model_copy(update={"law": law})
            if assess(changed).warnings != known or time.monotonic() > until_s:
                break
            if period_s <= MARGIN * longest_period_s(course(changed, MOST_S)):
                yield f"law.{gain} <= {value:g}"
                break


def _two_digits(value: float) -> float:
    """``value`` rounded down to two significant digits."""
    unit = 10.0 ** (floor(log10(value)) - 1)
    return float(f"{floor(value / unit) * unit:.2g}")


class _Way:
    """All robots on the way in, each with its law, its body and its neighbours.

    What is heard comes when it is broadcast, and as late as half of the messages do.
    """

    def __init__(self, scenario: Scenario, law: LawFactory) -> None:
        back = [some.tick * scenario.clock.control_period_s for some in returns(scenario)]
        self._end_ns = nanoseconds(min(max([0.0, *back]) + HORIZON_S, scenario.duration_s))
        self._most_looks = LOOKS_BACK if back else LOOKS
        self._longest_ns = nanoseconds(min(HORIZON_S, scenario.duration_s)) // 200
        self._dynamic = scenario.law.level == "dynamic"
        self._plant = scenario.plant
        self._roster = scenario.roster()
        self._period_ns = scenario.clock.control_period_ns
        self._every_ns = scenario.clock.broadcast_period_ns
        self._delays_ns = dict(scenario.of_links(_delay_ns))
        self._neighbours = scenario.neighbours_of
        plan = resolve(scenario)
        self._laws: dict[int, Law] = {robot: law(plan.situation(robot)) for robot in plan.ids}
        self._bodies = {robot: Body.of(scenario.vehicles[robot]) for robot in scenario.ids}
        self._states = {robot: scenario.start_state(robot) for robot in scenario.ids}
        self._broadcasts: deque[tuple[int, dict[int, State]]] = deque()

    def looks(self, until_s: float) -> Iterator[Look]:
        """One look after the other, until :func:`time.monotonic` is there. Raises LawFailed."""
        now_ns = 0
        for _ in range(self._most_looks):
            if now_ns >= self._end_ns or time.monotonic() > until_s:
                return
            rate = self._rate(now_ns)
            step_ns = min(ceil(SHARE / max(rate, 1e-3) * 1e9), self._longest_ns)
            yield Look(now_ns / 1e9, rate, STEPS * step_ns / 1e9)
            for _ in range(STEPS):
                self._step(now_ns, step_ns)
                now_ns += step_ns

    def _up(self, robot: int, now_ns: int) -> bool:
        return self._roster.up(robot, now_ns // self._period_ns)

    def _step(self, now_ns: int, step_ns: int) -> None:
        heard = self._heard(now_ns)
        reached = {}
        for robot, state in self._states.items():
            body = self._bodies[robot]
            if not self._up(robot, now_ns):
                left = body if self._dynamic else None
                reached[robot] = left_alone(self._plant, left, state, step_ns / 1e9)
                continue
            first, second = self._command(robot, now_ns, state, heard[robot])
            if self._dynamic:
                reached[robot] = driven(body, state, first, second, step_ns / 1e9)
            else:
                reached[robot] = steered(state, first, second, step_ns / 1e9)
        self._states = reached

    def _command(
        self, robot: int, now_ns: int, state: State, heard: tuple[Stamped, ...]
    ) -> tuple[float, float]:
        try:
            return pair(self._laws[robot].command(now_ns, state, heard))
        except RAISED as error:
            if not finite(state):
                return nan, nan
            raise failure(robot, error, self._laws[robot]) from error

    def _heard(self, now_ns: int) -> dict[int, tuple[Stamped, ...]]:
        sent = self._broadcasts
        if not sent or now_ns >= sent[-1][0] + self._every_ns:
            up = {robot: s for robot, s in self._states.items() if self._up(robot, now_ns)}
            sent.append((now_ns, up))
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
        """The newest broadcast of ``robot`` up to an instant; none if it was down."""
        for stamp_ns, states in reversed(self._broadcasts):
            if stamp_ns <= until_ns:
                return [Stamped(robot, stamp_ns, states[robot])] if robot in states else []
        return []

    def _rate(self, now_ns: int) -> float:
        """The largest |λ| of all robots that are up now."""
        heard = self._heard(now_ns)
        up = [robot for robot in self._states if self._up(robot, now_ns)]
        transposed = np.array([self._jacobian(robot, now_ns, heard[robot]) for robot in up])
        if not np.all(np.isfinite(transposed)):
            return inf
        if not up:
            return 0.0
        return float(np.abs(np.linalg.eigvals(transposed.transpose(0, 2, 1))).max())

    def _jacobian(self, robot: int, now_ns: int, heard: tuple[Stamped, ...]) -> list[list[float]]:
        """The closed loop of one robot, linearised, its neighbours standing still; transposed."""
        state = self._states[robot]
        columns = []
        for axis in range(5 if self._dynamic else 3):
            step = 1e-6 * max(1.0, abs(state[axis]))
            ahead = self._derivative(robot, now_ns, _shifted(state, axis, step), heard)
            behind = self._derivative(robot, now_ns, _shifted(state, axis, -step), heard)
            columns.append([(a - b) / (2.0 * step) for a, b in zip(ahead, behind, strict=True)])
        return columns

    def _derivative(
        self, robot: int, now_ns: int, state: State, heard: tuple[Stamped, ...]
    ) -> tuple[float, ...]:
        """How the state changes under the law's command: (5,), kinematic (3,)."""
        first, second = self._command(robot, now_ns, state, heard)
        c, s = cos(state.heading_rad), sin(state.heading_rad)
        if not self._dynamic:
            return first * c, first * s, second
        body, v, omega = self._bodies[robot], state.speed_mps, state.turn_rate_radps
        right, left = body.saturated(first), body.saturated(second)
        force = (right + left) / body.wheel_radius_m
        yaw = body.half_axle_m * (right - left) / body.wheel_radius_m
        return v * c, v * s, omega, *body.accelerations(v, omega, force, yaw)


def _shifted(state: State, axis: int, by: float) -> State:
    values = list(state)
    values[axis] += by
    return State(*values)


def _delay_ns(settings: LinkSettings) -> int:
    """How late half of the messages on a link are, but for what its rate adds."""
    return nanoseconds(settings.playout_s or settings.delay.quantile_s(0.5))
