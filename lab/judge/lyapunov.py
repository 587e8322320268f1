"""The Lyapunov functions of the paper along a run.

V of Eq. 22 (kinematic), Eq. 34 (dynamic, read as ũᵀM̄ũ) and, where messages are delayed, the
functionals of Eqs. 40 and 43. What V may gain in a sampled loop is :mod:`lab.judge.budget`'s,
where it gains more :mod:`lab.judge.rises`'.
"""

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from formnet.formation.briefing.situation import parameters
from formnet.formation.scenario.model import Scenario
from formnet.lab.judge.budget import budget
from formnet.lab.judge.closed_loop import Array, ClosedLoop, Eta, Variables, shifted
from formnet.lab.runs.recording import Collected

_DIVERGED = 1e40
"""Beyond, S² overflows."""


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


def is_defined(scenario: Scenario) -> bool:
    """Whether runs have a V: with the cooperative law, in virtual time.

    V needs what each robot had heard at the instants of the samples.
    """
    return scenario.law.kind == "cooperative" and scenario.clock.mode == "lockstep"


_KNOWN: WeakKeyDictionary[Collected, tuple[tuple[int, ...], Curve | None]] = WeakKeyDictionary()
"""The newest curve of each run, and how much had been recorded then."""


def curve(recording: Collected) -> Curve | None:
    """V along a run, as long as it is finite; None without samples or where it is not defined.

    It is worked out anew only if something was recorded since: a verdict, a scene and a figure
    of one run ask for the same.
    """
    extent = (len(recording.samples), len(recording.link_rows), len(recording.events))
    known = _KNOWN.get(recording)
    if known is None or known[0] != extent:
        known = _KNOWN[recording] = extent, _curve(recording)
    return known[1]


def _curve(recording: Collected) -> Curve | None:
    scenario, trajectories = recording.scenario, recording.trajectories
    within = (np.abs(trajectories.states) < _DIVERGED).all(axis=(1, 2))  # not NaN either
    if not within.all():
        trajectories = trajectories.first(int(np.argmin(within)))
    if not is_defined(scenario) or len(trajectories.t_s) < 2:
        return None
    with np.errstate(over="ignore", invalid="ignore"):  # a diverging run overflows
        loop = ClosedLoop(recording, trajectories)
        now = loop.eta()
        v, whole = _functional(loop, now)
        return Curve(loop.t_s, v, budget(loop, now), whole)


def equation(scenario: Scenario) -> int:
    """The number of the equation that V is of in a scenario."""
    delayed = any(
        scenario.link_settings(*link).constant_ns != 0 for link in scenario.directed_links
    )
    if scenario.law.level == "kinematic":
        return 40 if delayed else 22
    return 43 if delayed else 34


def _functional(loop: ClosedLoop, now: Eta) -> tuple[Array, NDArray[np.bool_]]:
    """V, and whether all that it needs has been heard, (n,) each."""
    robots, t_s = loop.robots, loop.t_s
    v = 0.5 * loop.total(robots.z1**2 + robots.z2**2 + robots.z3**2)
    whole = np.ones(len(t_s), dtype=bool)
    stored, stored_rate = _cumulated(robots, t_s), robots.s**2 + robots.z2**2
    for link in loop.links:
        held = stored[:, link.source] - shifted(
            t_s, stored[:, link.source], stored_rate[:, link.source], link.delay_s
        )
        v += np.where(link.heard, 0.5 * link.weight * held, 0.0)
        both = loop.up[:, link.source] & loop.up[:, link.destination]
        whole &= link.heard | ~both
    if loop.law.level == "dynamic":
        mass, inertia = np.array(
            [parameters(*body.truth(), loop.law.length_scale_m)[:2] for body in loop.vehicles]
        ).T
        e1, e2 = robots.u1 - now.first, robots.u2 - now.second
        v += 0.5 * loop.total(mass * (e2 + robots.z3 * e1) ** 2 + inertia * e1**2)
    return v, whole


def _cumulated(robots: Variables, t_s: Array) -> Array:
    """∫₀ᵗ (S² + z2²), by the trapezoidal rule with its end correction (fourth order)."""
    values = robots.s**2 + robots.z2**2
    rates = 2.0 * (robots.s * robots.s_dot + robots.z2 * robots.z2_dot)
    h = np.diff(t_s)[:, None]
    pieces = 0.5 * h * (values[1:] + values[:-1]) - h**2 / 12.0 * (rates[1:] - rates[:-1])
    return np.concatenate((np.zeros((1, values.shape[1])), np.cumsum(pieces, axis=0)))
