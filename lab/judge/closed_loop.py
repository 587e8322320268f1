"""The closed loop of a run in the variables of the paper: Eq. 8, w1, the links, and η.

From the recorded states alone: an instrument apart from the code of the law. Lengths are in units
of ``law.length_scale_m``, as in the law.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from formnet.formation.briefing.situation import parameters
from formnet.formation.scenario.law import W1
from formnet.formation.scenario.model import Scenario
from formnet.lab.runs.recording import Collected, Trajectories

Array = NDArray[np.float64]


class Variables(NamedTuple):
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


class Signal(NamedTuple):
    """∫₀ᵗ w1, w1, ẇ1, ẅ1, each (n, 1)."""

    integral: Array
    w1: Array
    w1_dot: Array
    w1_ddot: Array


class Eta(NamedTuple):
    """η of Eqs. 38, 39 and its rates, (n, robots) each."""

    first: Array
    second: Array
    first_dot: Array
    second_dot: Array


class Rounding(NamedTuple):
    """A unit in the last place of what each sample holds, (n, robots) each, in the law's units."""

    place: Array
    heading: Array
    speed: Array
    turn_rate: Array


class Link(NamedTuple):
    """One directed link: columns of its ends, b, δ, and since when its messages are in use.

    ``stale_s`` is how much older than δ what is in use can be, by sampling.
    """

    source: int
    destination: int
    weight: float
    delay_s: float
    stale_s: float
    heard: NDArray[np.bool_]


class ClosedLoop:
    """The closed loop of one run as the theorems have it."""

    def __init__(self, recording: Collected, trajectories: Trajectories) -> None:
        scenario = recording.scenario
        self.law = scenario.law
        self.t_s = trajectories.t_s
        self.w = _signal(scenario.law.w1, self.t_s)
        self.robots = _coordinates(scenario, trajectories, self.w)
        self.rounding = _rounding(scenario, trajectories, self.w)
        self.control_period_s = scenario.clock.control_period_s
        self.vehicles = [scenario.vehicles[r] for r in scenario.ids]
        self.damping = np.array([vehicle.damping for vehicle in self.vehicles])
        self.up = _up(recording, trajectories)
        self.links = list(_links(recording, self.t_s, self.up))

    def total(self, values: Array) -> Array:
        """The sum of ``values`` (n, robots) over the robots that are up, (n,)."""
        return np.where(self.up, values, 0.0).sum(axis=1)  # type: ignore[no-any-return]

    def larger_end(self, rate: Array) -> Array:
        """The larger value of ``rate`` (n,) at the ends of each interval, (n - 1,).

        Where robots go down or come back, what follows has no part in the interval before.
        """
        changes = (self.up[1:] != self.up[:-1]).any(axis=1)
        return np.maximum(rate[:-1], np.where(changes, 0.0, rate[1:]))

    def inertias(self) -> tuple[Array, Array]:
        """m ℓ² and I + m d² as they are, (robots,) each."""
        scale = self.law.length_scale_m
        return (*np.array([parameters(*body.truth(), scale)[:2] for body in self.vehicles]).T,)

    def eta(self, *, stale: bool = False) -> Eta:
        """Eqs. 38, 39 and their rates; ``stale``: with what neighbours sent as long before
        t − δ as a sampled loop uses it at most."""
        r, w = self.robots, self.w
        pull = np.broadcast_to(self.damping, r.s.shape).copy()
        sums = [np.zeros_like(r.s) for _ in range(4)]
        for link in self.links:
            delay_s = link.delay_s + (link.stale_s if stale else 0.0)
            values = (
                shifted(self.t_s, r.s[:, link.source], r.s_dot[:, link.source], delay_s),
                shifted(self.t_s, r.z2[:, link.source], r.z2_dot[:, link.source], delay_s),
                shifted(self.t_s, r.s_dot[:, link.source], None, delay_s),
                shifted(self.t_s, r.z2_dot[:, link.source], None, delay_s),
            )
            weight = np.where(link.heard, link.weight, 0.0)
            pull[:, link.destination] += weight
            for total, value in zip(sums, values, strict=True):
                total[:, link.destination] += weight * value
        beta, compensated = self.law.beta, self.law.cross_term == "compensated"
        w1, w1_dot, w1_ddot = w.w1, w.w1_dot, w.w1_ddot
        first = sums[0] - pull * r.s + w1
        second = (
            sums[1]
            - pull * r.z2
            - beta * w1 * (w1 * r.z2 - beta * r.z3 * w1**2)
            - beta * r.z3 * w1_dot
        )
        first_dot = sums[2] - pull * r.s_dot + w1_dot
        second_dot = (
            sums[3]
            - pull * r.z2_dot
            - beta * (2.0 * w1 * w1_dot * r.z2 + w1**2 * r.z2_dot)
            + beta**2 * (3.0 * w1**2 * w1_dot * r.z3 + w1**3 * r.z3_dot)
            - beta * (r.z3_dot * w1_dot + r.z3 * w1_ddot)
        )
        if compensated:
            second = second - w1 * r.z3
            second_dot = second_dot - w1_dot * r.z3 - w1 * r.z3_dot
        return Eta(first, second, first_dot, second_dot)


def shifted(t_s: Array, values: Array, rates: Array | None, delay_s: float) -> Array:
    """``values`` at ``delay_s`` before each instant; the first value before the beginning.

    Cubic between instants where the ``rates`` are known, else linear.
    """
    at = np.maximum(t_s - delay_s, t_s[0])
    if rates is None:
        return np.interp(at, t_s, values)  # type: ignore[no-any-return]
    k = np.clip(np.searchsorted(t_s, at, side="right") - 1, 0, len(t_s) - 2)
    h = np.diff(t_s)
    slopes = np.diff(values) / h
    bend = (rates[:-1] + rates[1:] - 2.0 * slopes) / h
    square, cube = (slopes - rates[:-1]) / h - bend, bend / h
    s = at - t_s[k]
    # In this order, with these powers, the bits are those of SciPy's CubicHermiteSpline.
    return values[k] + rates[k] * s + square[k] * (s * s) + cube[k] * (s * s * s)  # type: ignore[no-any-return]


def _signal(w1: W1, t_s: Array) -> Signal:
    t = t_s[:, None]
    omega, amplitude = w1.frequency_radps or 1.0, 0.0 if w1.constant else w1.amplitude
    sine, cosine = np.sin(omega * t), np.cos(omega * t)
    return Signal(
        w1.bias * t + amplitude / omega * (1.0 - cosine),
        w1.bias + amplitude * sine,
        amplitude * omega * cosine,
        -amplitude * omega**2 * sine,
    )


def _coordinates(scenario: Scenario, trajectories: Trajectories, w: Signal) -> Variables:
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
    return Variables(z1, z2, z3, z1 + factor * zeta2, u1, u2, z2_dot, z3_dot, s_dot)


def _rounding(scenario: Scenario, trajectories: Trajectories, w: Signal) -> Rounding:
    x, y, heading, speed, turn_rate = np.moveaxis(np.spacing(np.abs(trajectories.states)), -1, 0)
    offsets = np.spacing(np.abs(scenario.offsets_m))
    scale = scenario.law.length_scale_m
    return Rounding(
        np.hypot(np.maximum(x, offsets[:, 0]), np.maximum(y, offsets[:, 1])) / scale,
        np.maximum(heading, np.spacing(np.abs(w.integral))),
        speed / scale,
        turn_rate,
    )


def _up(recording: Collected, trajectories: Trajectories) -> NDArray[np.bool_]:
    """Whether each robot takes part at each instant, (n, robots)."""
    roster, period_ns = recording.roster(), recording.scenario.clock.control_period_ns
    ticks = (trajectories.t_ns // period_ns).tolist()
    return np.array([[roster.up(r, tick) for r in recording.scenario.ids] for tick in ticks])


def _links(recording: Collected, t_s: Array, up: NDArray[np.bool_]) -> Iterator[Link]:
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
        yield Link(column[source], column[destination], weight, delay_ns / 1e9, stale_s, heard)


def _throughout(t_s: Array, up: NDArray[np.bool_], span_s: float) -> NDArray[np.bool_]:
    """Whether ``up`` held at every instant from ``span_s`` before each one on (and it is there)."""
    down = np.concatenate(([0], np.cumsum(~up)))
    first = np.searchsorted(t_s, t_s - span_s - 1e-12)
    within = t_s >= span_s - 1e-12
    return within & (down[1:] == down[first])  # type: ignore[no-any-return]
