"""The Lyapunov functions of the paper along a run, and where they rise.

V of Eq. 22 (kinematic), Eq. 34 (dynamic, read as ũᵀM̄ũ) and, where messages are delayed, the
functionals of Eqs. 40 and 43, from the recorded states alone: an instrument apart from the
code of the law. Lengths are in units of ``law.length_scale_m``, as in the law.

The theorems are about continuous control over delays that are what the scenario says. In a
sampled loop V may rise a little all the same; how much is computed from the run, not fitted
to it:

sampling
    the power Σ ũᵀ(w − w*) by which a law can differ from Eq. 29's w* in continuous time (at
    the kinematic level: its velocities from Eqs. 38, 39) that holds its wrench w for a whole
    broadcast period, and of one that uses what it heard for so long, each where positive;
robust term
    ρ‖Ȳᵀũ‖ e / (‖Ȳᵀũ‖ + e) with e = ε exp(−γt), which is at most Eq. 35's ρ ε exp(−γt).

Whatever V gains beyond that is a rise.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from formnet.agent.law import body_estimate, parameters
from formnet.formation.paper.theory import outside_model
from formnet.formation.scenario.law import W1
from formnet.formation.scenario.model import Scenario
from formnet.lab.runs.recording import Collected, Trajectories
from formnet.netem.core.transit import LOST_DOWN

Array = NDArray[np.float64]


class Curve(NamedTuple):
    """V along a run, at the recorded instants.

    ``t_s``, ``v``: (n,). ``budget``: (n,), what V may have gained since the instant before by
    sampling and by the robust term. ``whole``: (n,), whether every neighbour that is
    up has been heard at that instant, so that the functional is the theorem's.
    """

    t_s: Array
    v: Array
    budget: Array
    whole: NDArray[np.bool_]


class Rise(NamedTuple):
    """V gained ``gain`` more than it may between ``begin_s`` and ``end_s``, and why."""

    begin_s: float
    end_s: float
    gain: float
    relative_gain: float
    causes: list[str]


ROUNDING = 1e-9
"""A gain below this share of V is not a rise."""
_DIVERGED = 1e40
"""Beyond, S² overflows."""
_APART = 10
"""Rises fewer broadcast periods apart are one."""


class _Robots(NamedTuple):
    """Eq. 8's variables of every robot at every instant, (n, robots) each."""

    z1: Array
    z2: Array
    z3: Array
    s: Array
    u1: Array
    u2: Array
    z2_dot: Array
    z3_dot: Array
    s_dot: Array


class _Signal(NamedTuple):
    """∫₀ᵗ w1, w1, ẇ1, ẅ1, each (n, 1)."""

    integral: Array
    w1: Array
    w1_dot: Array
    w1_ddot: Array


def is_defined(scenario: Scenario) -> bool:
    """Whether runs have a V: with the cooperative law, in virtual time.

    V needs what each robot had heard at the instants of the samples.
    """
    return scenario.law.kind == "cooperative" and scenario.clock.mode == "lockstep"


def curve(recording: Collected) -> Curve | None:
    """V along a run, as long as it is finite; None without samples or where it is not defined."""
    scenario, trajectories = recording.scenario, recording.trajectories
    within = (np.abs(trajectories.states) < _DIVERGED).all(axis=(1, 2))  # not NaN either
    if not within.all():
        trajectories = trajectories.first(int(np.argmin(within)))
    if not is_defined(scenario) or len(trajectories.t_s) < 2:
        return None
    with np.errstate(over="ignore", invalid="ignore"):  # a diverging run overflows
        return _Loop(recording, trajectories).curve()


def equation(scenario: Scenario) -> int:
    """The number of the equation that V is of in a scenario."""
    delayed = any(
        scenario.link_settings(*link).constant_ns != 0 for link in scenario.directed_links
    )
    if scenario.law.level == "kinematic":
        return 40 if delayed else 22
    return 43 if delayed else 34


def rises(recording: Collected, found: Curve) -> list[Rise]:
    """Every stretch in which V gains more than its budget, from when all were first heard on."""
    first = int(np.argmax(found.whole)) if found.whole.any() else len(found.v) - 1
    with np.errstate(invalid="ignore"):  # a diverging run overflows
        excess = np.diff(found.v) - found.budget[1:]
        beyond = ~(excess <= ROUNDING * found.v[:-1])
    marked = np.flatnonzero(beyond[first:]) + first
    if not len(marked):
        return []
    causes = _Causes(recording)
    groups = np.split(marked, np.flatnonzero(np.diff(marked) > _APART) + 1)
    return [_rise(found, excess, group, causes) for group in groups]


def _rise(found: Curve, excess: Array, steps: NDArray[np.intp], causes: "_Causes") -> Rise:
    begin_s, end_s = float(found.t_s[steps[0]]), float(found.t_s[steps[-1] + 1])
    gain, before = float(excess[steps].sum()), float(found.v[steps[0]])
    return Rise(begin_s, end_s, gain, gain / before if before else gain, causes.of(begin_s, end_s))


class _Causes:
    """What can make V rise, and when: all that the theorems exclude."""

    def __init__(self, recording: Collected) -> None:
        scenario = recording.scenario
        self._standing = standing_causes(scenario)
        self._happenings = [(entry.at_s, f"{entry.what} at {entry.at_s:g} s")
                            for entry in scenario.plan]  # fmt: skip
        self._happenings += [
            (event.t_ns / 1e9, f"robot {event.details['robot']} lost at {event.t_ns / 1e9:g} s")
            for event in recording.events
            if event.kind == "lost"
        ]
        lost = [
            row for row in recording.link_rows
            if row.fate.startswith("lost") and row.fate != LOST_DOWN
        ]  # fmt: skip
        self._lost_s = np.sort(np.array([row.t_sent_ns for row in lost], dtype=np.float64)) / 1e9
        delays = [
            row.t_usable_ns - row.t_sent_ns
            for row in recording.link_rows
            if row.t_usable_ns is not None
        ]
        longest_ns = max(delays, default=0)
        self._reach_s = (
            scenario.neighbours.silence_s + longest_ns / 1e9 + scenario.clock.broadcast_period_s
        )

    def of(self, begin_s: float, end_s: float) -> list[str]:
        """What may have made V rise between two instants; "unexplained" if nothing is known."""
        since_s = begin_s - self._reach_s
        found = [what for at_s, what in self._happenings if since_s <= at_s <= end_s]
        lost = int(np.searchsorted(self._lost_s, end_s) - np.searchsorted(self._lost_s, since_s))
        if lost:
            found.append(f"loss: {lost} messages since {max(0.0, since_s):g} s")
        return [*found, *self._standing] or ["unexplained"]


def standing_causes(scenario: Scenario) -> list[str]:
    """Why V may rise at any time in a scenario; nothing where the theorems say that it never does.

    What happens at an instant (faults, cuts, loss) is not among them.
    """
    law = scenario.law
    causes = []
    if law.cross_term == "printed":
        causes.append("the term w1 z2 z3 that the proofs drop (law.cross_term)")
    if law.delta == "printed":
        causes.append("Δ of the sign printed in Eq. 19 (law.delta)")
    settings = (scenario.link_settings(*link) for link in scenario.directed_links)
    if any(some.constant_ns is None for some in settings):
        causes.append("variable delay")
    if law.level == "dynamic":
        causes += outside_model(scenario)
    return causes


class _Eta(NamedTuple):
    """η of Eqs. 38, 39 and its rates, (n, robots) each."""

    first: Array
    second: Array
    first_dot: Array
    second_dot: Array


class _Link(NamedTuple):
    """One directed link: columns of its ends, b, δ, and since when its messages are in use.

    ``stale_s`` is how much older than δ what is in use can be, by sampling.
    """

    source: int
    destination: int
    weight: float
    delay_s: float
    stale_s: float
    heard: NDArray[np.bool_]


class _Loop:
    """The closed loop of one run as the theorems have it."""

    def __init__(self, recording: Collected, trajectories: Trajectories) -> None:
        self.scenario = scenario = recording.scenario
        self.law = scenario.law
        self.t_s = trajectories.t_s
        self.w = _signal(scenario.law.w1, self.t_s)
        self.robots = _coordinates(scenario, trajectories, self.w)
        self.damping = np.array([scenario.vehicles[r].damping for r in scenario.ids])
        self.up = _up(recording, trajectories)
        self.estimates = [
            body_estimate(scenario.vehicles[r], self.law.length_scale_m) for r in scenario.ids
        ]
        self.links = list(_links(recording, self.t_s, self.up))

    def curve(self) -> Curve:
        robots, scenario, t_s = self.robots, self.scenario, self.t_s
        v = 0.5 * _total(self.up, robots.z1**2 + robots.z2**2 + robots.z3**2)
        whole = np.ones(len(t_s), dtype=bool)
        stored, stored_rate = _cumulated(robots, t_s), robots.s**2 + robots.z2**2
        for link in self.links:
            held = stored[:, link.source] - _shifted(
                t_s, stored[:, link.source], stored_rate[:, link.source], link.delay_s
            )
            v += np.where(link.heard, 0.5 * link.weight * held, 0.0)
            both = self.up[:, link.source] & self.up[:, link.destination]
            whole &= link.heard | ~both
        now, stale = self._eta(), self._eta(stale=True)
        if self.law.level == "kinematic":
            own = self._held_velocities(now)
            powers = [
                robots.s * (own[0] - now.first) + robots.z2 * (own[1] - now.second),
                robots.s * (stale.first - now.first) + robots.z2 * (stale.second - now.second),
            ]
            return Curve(t_s, v, self._budget(powers, np.zeros_like(v)), whole)
        e1, e2 = robots.u1 - now.first, robots.u2 - now.second
        mass, inertia = np.array(
            [
                parameters(*scenario.vehicles[r].truth(), self.law.length_scale_m)[:2]
                for r in scenario.ids
            ]
        ).T
        v += 0.5 * _total(self.up, mass * (e2 + robots.z3 * e1) ** 2 + inertia * e1**2)
        first, second, robust = self._wrench(now)
        old_first, old_second, _ = self._wrench(stale)
        force, yaw = _held(second), _held(robots.z3 * second - first)
        powers = [
            e1 * (robots.z3 * force - yaw - first) + e2 * (force - second),
            e1 * (old_first - first) + e2 * (old_second - second),
        ]
        return Curve(t_s, v, self._budget(powers, _total(self.up, robust)), whole)

    def _budget(self, powers: list[Array], robust: Array) -> Array:
        """∫ of the robust term and of the powers, where they are positive, (n,).

        ``powers`` are (n, robots), ``robust`` (n,); in each interval their larger end counts.
        """
        rates = [robust, *(_total(self.up, np.maximum(power, 0.0)) for power in powers)]
        # Where robots go down or come back, what follows has no part in the interval before.
        changes = (self.up[1:] != self.up[:-1]).any(axis=1)
        gains = np.diff(self.t_s) * sum(
            np.maximum(rate[:-1], np.where(changes, 0.0, rate[1:])) for rate in rates
        )
        return np.concatenate(([0.0], np.where(np.isfinite(gains), gains, np.inf)))

    def _eta(self, *, stale: bool = False) -> "_Eta":
        """Eqs. 38, 39 and their rates; ``stale``: with what neighbours sent as long before
        t − δ as a sampled loop uses it at most."""
        r, w = self.robots, self.w
        pull = np.broadcast_to(self.damping, r.s.shape).copy()
        sums = [np.zeros_like(r.s) for _ in range(4)]
        for link in self.links:
            delay_s = link.delay_s + (link.stale_s if stale else 0.0)
            values = (
                _shifted(self.t_s, r.s[:, link.source], r.s_dot[:, link.source], delay_s),
                _shifted(self.t_s, r.z2[:, link.source], r.z2_dot[:, link.source], delay_s),
                _shifted(self.t_s, r.s_dot[:, link.source], None, delay_s),
                _shifted(self.t_s, r.z2_dot[:, link.source], None, delay_s),
            )
            weight = np.where(link.heard, link.weight, 0.0)
            pull[:, link.destination] += weight
            for total, value in zip(sums, values, strict=True):
                total[:, link.destination] += weight * value
        beta, compensated = self.law.beta, self.law.cross_term == "compensated"
        w1, w1_dot, w1_ddot = w.w1, w.w1_dot, w.w1_ddot
        first = sums[0] - pull * r.s + w1
        second = (
            sums[1] - pull * r.z2 - beta * w1 * (w1 * r.z2 - beta * r.z3 * w1**2)
            - beta * r.z3 * w1_dot
        )  # fmt: skip
        first_dot = sums[2] - pull * r.s_dot + w1_dot
        second_dot = (
            sums[3] - pull * r.z2_dot
            - beta * (2.0 * w1 * w1_dot * r.z2 + w1**2 * r.z2_dot)
            + beta**2 * (3.0 * w1**2 * w1_dot * r.z3 + w1**3 * r.z3_dot)
            - beta * (r.z3_dot * w1_dot + r.z3 * w1_ddot)
        )  # fmt: skip
        if compensated:
            second = second - w1 * r.z3
            second_dot = second_dot - w1_dot * r.z3 - w1 * r.z3_dot
        return _Eta(first, second, first_dot, second_dot)

    def _wrench(self, eta: "_Eta") -> tuple[Array, Array, Array]:
        """B̄τ of Eq. 29, (n, robots) twice, and how much its robust term may let V gain a second."""
        r, law = self.robots, self.law
        mass, inertia, offset = np.array(
            [
                parameters(e.mass_kg, e.inertia_kgm2, e.com_offset_m, law.length_scale_m)
                for e in self.estimates
            ]
        ).T
        uncertain = np.array([e.com_uncertain for e in self.estimates])
        rho = np.array([e.robust_bound if law.robust else 0.0 for e in self.estimates])
        e1, e2 = r.u1 - eta.first, r.u2 - eta.second
        omega = -r.u1
        s = r.z3_dot * eta.first + r.z3 * eta.first_dot + eta.second_dot
        y13 = np.where(uncertain, -omega * eta.second, 0.0)
        y23 = np.where(uncertain, omega * eta.first, 0.0)
        x1, x2, x3 = r.z3 * s * e1 + s * e2, eta.first_dot * e1, y13 * e1 + y23 * e2
        size = np.sqrt(x1**2 + x2**2 + x3**2)
        layer = law.boundary_layer * np.exp(-law.gamma * self.t_s)[:, None]
        share = rho / (size + layer)
        a1, a2, a3 = mass - share * x1, inertia - share * x2, offset - share * x3
        k1, k2 = e1, e2
        if law.feedback_shape == "inertia":
            k2 = mass * (r.z3 * e1 + e2)
            k1 = r.z3 * k2 + inertia * e1
        gain = law.feedback_gain
        first = -gain * k1 + r.z3 * s * a1 + eta.first_dot * a2 + y13 * a3 - r.s
        second = -gain * k2 + s * a1 + y23 * a3 - r.z2
        return first, second, share * size * layer

    def _held_velocities(self, eta: _Eta) -> tuple[Array, Array]:
        """u of Eq. 8 for the speed and turn rate that were right at the instant before."""
        speed, turn_rate = _held(eta.second + self.robots.z3 * eta.first), _held(-eta.first)
        return -turn_rate, speed + self.robots.z3 * turn_rate


def _signal(w1: W1, t_s: Array) -> _Signal:
    t = t_s[:, None]
    constant = w1.amplitude == 0.0 or w1.frequency_radps == 0.0
    omega, amplitude = w1.frequency_radps or 1.0, 0.0 if constant else w1.amplitude
    sine, cosine = np.sin(omega * t), np.cos(omega * t)
    return _Signal(
        w1.bias * t + amplitude / omega * (1.0 - cosine),
        w1.bias + amplitude * sine,
        amplitude * omega * cosine,
        -amplitude * omega**2 * sine,
    )


def _coordinates(scenario: Scenario, trajectories: Trajectories, w: _Signal) -> _Robots:
    """Eq. 8, the corrected Δ of Eq. 19, and rates along the motion."""
    scale, beta = scenario.law.length_scale_m, scenario.law.beta
    offsets = scenario.offsets_m / scale
    x, y, heading, speed, turn_rate = np.moveaxis(trajectories.states, -1, 0)
    dx, dy = x / scale - offsets[:, 0], y / scale - offsets[:, 1]
    sine, cosine = np.sin(heading), np.cos(heading)
    zeta2, z3 = dx * cosine + dy * sine, dy * cosine - dx * sine
    u1, u2 = -turn_rate, speed / scale + z3 * turn_rate
    z3_dot = u1 * zeta2
    z2 = zeta2 + beta * w.w1 * z3
    z2_dot = u2 + beta * (w.w1 * z3_dot + w.w1_dot * z3)
    factor = z2 * beta * w.w1 + z3
    factor_dot = beta * (z2_dot * w.w1 + z2 * w.w1_dot) + z3_dot
    z1 = -heading - w.integral
    s_dot = u1 - w.w1 + factor_dot * zeta2 + factor * u2
    return _Robots(z1, z2, z3, z1 + factor * zeta2, u1, u2, z2_dot, z3_dot, s_dot)


def _up(recording: Collected, trajectories: Trajectories) -> NDArray[np.bool_]:
    """Whether each robot takes part at each instant, (n, robots)."""
    roster, period_ns = recording.roster(), recording.scenario.clock.control_period_ns
    ticks = (trajectories.t_ns // period_ns).tolist()
    return np.array([[roster.up(r, tick) for r in recording.scenario.ids] for tick in ticks])


def _links(recording: Collected, t_s: Array, up: NDArray[np.bool_]) -> Iterator[_Link]:
    """The links that are both ways in the graph, with the delay that the theory has for each.

    That is the configured one where it is constant, and the median of what was observed
    where it is not. A link that never delivered anything is left out.
    """
    scenario = recording.scenario
    column = {robot: k for k, robot in enumerate(scenario.ids)}
    period_ns = scenario.clock.broadcast_period_ns
    observed: dict[tuple[int, int], list[int]] = {}
    for row in recording.link_rows:
        if row.t_usable_ns is not None:
            age_ns = row.t_usable_ns - row.t_sent_ns
            observed.setdefault((row.source, row.destination), []).append(age_ns)
    for source, destination in scenario.directed_links:
        delay_ns = scenario.link_settings(source, destination).constant_ns
        if delay_ns is None:
            ages = observed.get((source, destination))
            if ages is None:
                continue
            delay_ns = int(np.median(ages))
        stale_s = period_ns / 1e9
        since_s = (delay_ns + -delay_ns % period_ns) / 1e9  # the first broadcast has been heard
        heard = _throughout(t_s, up[:, column[source]], since_s)
        heard &= _throughout(t_s, up[:, column[destination]], since_s)
        weight = scenario.formation.weights[min(source, destination), max(source, destination)]
        yield _Link(column[source], column[destination], weight, delay_ns / 1e9, stale_s, heard)


def _throughout(t_s: Array, up: NDArray[np.bool_], span_s: float) -> NDArray[np.bool_]:
    """Whether ``up`` held at every instant from ``span_s`` before each one on (and it is there)."""
    down = np.concatenate(([0], np.cumsum(~up)))
    first = np.searchsorted(t_s, t_s - span_s - 1e-12)
    within = t_s >= span_s - 1e-12
    return within & (down[1:] == down[first])  # type: ignore[no-any-return]


def _cumulated(robots: _Robots, t_s: Array) -> Array:
    """∫₀ᵗ (S² + z2²), by the trapezoidal rule with its end correction (fourth order)."""
    values = robots.s**2 + robots.z2**2
    rates = 2.0 * (robots.s * robots.s_dot + robots.z2 * robots.z2_dot)
    h = np.diff(t_s)[:, None]
    pieces = 0.5 * h * (values[1:] + values[:-1]) - h**2 / 12.0 * (rates[1:] - rates[:-1])
    return np.concatenate((np.zeros((1, values.shape[1])), np.cumsum(pieces, axis=0)))


def _shifted(t_s: Array, values: Array, rates: Array | None, delay_s: float) -> Array:
    """``values`` at ``delay_s`` before each instant; the first value before the beginning.

    Cubic between instants where the ``rates`` are known, else linear.
    """
    at = np.maximum(t_s - delay_s, t_s[0])
    if rates is None:
        return np.interp(at, t_s, values)  # type: ignore[no-any-return]
    return CubicHermiteSpline(t_s, values, rates)(at)  # type: ignore[no-any-return]


def _held(values: Array) -> Array:
    """The values of the instant before (the first: its own)."""
    return np.concatenate((values[:1], values[:-1]))


def _total(up: NDArray[np.bool_], values: Array) -> Array:
    """The sum over robots that are up, (n,)."""
    return np.where(up, values, 0.0).sum(axis=1)  # type: ignore[no-any-return]
