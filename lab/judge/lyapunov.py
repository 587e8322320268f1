"""The Lyapunov functions of the paper along a run.

V of Eq. 22 (kinematic), Eq. 34 (dynamic, read as ũᵀM̄ũ) and, where messages are delayed, the
functionals of Eqs. 40 and 43; beside it, where it is defined, V* of :mod:`lab.judge.star`. What
they may gain in a sampled loop is :mod:`lab.judge.budget`'s, where they gain more
:mod:`lab.judge.rises`'.
"""

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from formnet.formation.scenario.model import Scenario
from formnet.lab.judge import star
from formnet.lab.judge.budget import budget
from formnet.lab.judge.closed_loop import Array, ClosedLoop, Eta
from formnet.lab.judge.windows import windowed
from formnet.lab.runs.recording import Collected

_DIVERGED = 1e40
"""Beyond, S² overflows."""


class Curve(NamedTuple):
    """V or V* along a run, at the recorded instants.

    ``t_s``, ``v``: (n,); V* is NaN where it is not defined. ``budget``: (n,), what it may have
    gained since the instant before by sampling, rounding and the robust term. ``whole``: (n,),
    whether every neighbour that is up has been heard at that instant, so that the function is the
    theorem's.
    """

    t_s: Array
    v: Array
    budget: Array
    whole: NDArray[np.bool_]


class Curves(NamedTuple):
    """V, and V* if it is one of the scenario's law and network, at some instant at least."""

    v: Curve
    star: Curve | None


def is_defined(scenario: Scenario) -> bool:
    """Whether runs have a V: with the cooperative law, in virtual time.

    V needs what each robot had heard at the instants of the samples.
    """
    return scenario.law.kind == "cooperative" and scenario.clock.mode == "lockstep"


_KNOWN: WeakKeyDictionary[Collected, tuple[tuple[int, ...], Curves | None]] = WeakKeyDictionary()
"""The newest curves of each run, and how much had been recorded then."""


def curve(recording: Collected) -> Curve | None:
    """V along a run, as long as it is finite; None without samples or where it is not defined."""
    found = curves(recording)
    return None if found is None else found.v


def curves(recording: Collected) -> Curves | None:
    """V and V* along a run, as :func:`curve`.

    They are worked out anew only if something was recorded since: a verdict, a scene and a figure
    of one run ask for the same.
    """
    extent = (len(recording.samples), len(recording.link_rows), len(recording.events))
    known = _KNOWN.get(recording)
    if known is None or known[0] != extent:
        known = _KNOWN[recording] = extent, _curves(recording)
    return known[1]


def _curves(recording: Collected) -> Curves | None:
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
        found = Curve(loop.t_s, v, budget(loop, now, np.zeros_like(loop.robots.z2)), whole)
        if not star.is_defined(scenario):
            return Curves(found, None)
        lean = star.lean(loop)
        if np.isnan(lean).any(axis=1).all():
            return Curves(found, None)
        more = v + 0.5 * loop.total(star.zeta(loop) * lean)
        return Curves(found, Curve(loop.t_s, more, budget(loop, now, lean), whole))


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
    values = robots.s**2 + robots.z2**2
    rates = 2.0 * (robots.s * robots.s_dot + robots.z2 * robots.z2_dot)
    held: dict[tuple[int, float], Array] = {}  # of one sender, for all who hear it as late
    for link in loop.links:
        if link.delay_s:
            key = k, delay_s = link.source, link.delay_s
            if key not in held:
                held[key] = windowed(t_s, values[:, k], rates[:, k], delay_s)
            v += np.where(link.heard, 0.5 * link.weight * held[key], 0.0)
        both = loop.up[:, link.source] & loop.up[:, link.destination]
        whole &= link.heard | ~both
    if loop.law.level == "dynamic":
        mass, inertia = loop.inertias()
        e1, e2 = robots.u1 - now.first, robots.u2 - now.second
        v += 0.5 * loop.total(mass * (e2 + robots.z3 * e1) ** 2 + inertia * e1**2)
    return v, whole
