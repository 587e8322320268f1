"""How much V may gain because states and the law are computed in doubles.

A control period rounds each number of the state to nearest, half a unit in the last place (ulp),
and the law evaluates S, z2 and η to some ulps of the largest number in them, which its gains times
the period, below one in a loop that is sampled fast enough, turn into less than the other half.
V itself is evaluated to some two ulps of the same numbers at either end. So V may gain, in an
interval with k control periods, (k + 4) times what an ulp of each number changes in it, to first
order. Headings grow without bound, and the ulp with them: that is the floor below which V does
not fall.
"""

import numpy as np

from formnet.lab.judge.closed_loop import Array, ClosedLoop, Eta

_EVALUATED = 4.0
"""Ulps of the evaluation of V at both ends of an interval."""


def rounding(loop: ClosedLoop, now: Eta, lean: Array) -> Array:
    """What V may have gained by rounding since the instant before, (n,); 0 at the first.

    ``lean`` is the derivative by ζ2 of what is added to V, (n, robots).
    """
    change = _of_an_ulp(loop, now, lean)
    spans = np.diff(loop.t_s)
    ulps = np.round(spans / loop.control_period_s) + _EVALUATED
    return np.concatenate(([0.0], ulps * loop.larger_end(change)))


def _of_an_ulp(loop: ClosedLoop, now: Eta, lean: Array) -> Array:
    """The sum of |∂V/∂state| · ulp over the robots that are up, (n,)."""
    r, ulp, law = loop.robots, loop.rounding, loop.law
    w1 = np.abs(loop.w.w1)
    slope = law.beta * w1
    zeta2 = np.abs(r.z2 - law.beta * loop.w.w1 * r.z3)
    z1, z2, z3 = np.abs(r.z1), np.abs(r.z2), np.abs(r.z3)
    of_zeta2 = ulp.place + z3 * ulp.heading
    of_z3 = ulp.place + zeta2 * ulp.heading
    of_z2 = of_zeta2 + slope * of_z3
    change = z1 * ulp.heading + z2 * of_z2 + z3 * of_z3 + np.abs(lean) * of_zeta2
    if law.level == "dynamic":
        of_s = (ulp.heading + (slope * z2 + z3) * of_zeta2 + zeta2 * (slope * of_z2 + of_z3)).max(
            axis=1, keepdims=True
        )
        pull = loop.damping.copy()
        for link in loop.links:
            pull[link.destination] += link.weight
        of_eta1 = 2.0 * pull * of_s
        of_eta2 = 2.0 * pull * of_z2.max(axis=1, keepdims=True) + slope * w1 * of_z2
        of_eta2 = of_eta2 + (slope**2 * w1 + w1) * of_z3
        of_u2 = ulp.speed + z3 * ulp.turn_rate + np.abs(r.u1) * of_z3
        mass, inertia = loop.inertias()
        e1, e2 = r.u1 - now.first, r.u2 - now.second
        second = mass * np.abs(e2 + r.z3 * e1)  # of M̄ũ
        first = z3 * second + inertia * np.abs(e1)
        change = change + first * (ulp.turn_rate + of_eta1)
        change = change + second * (of_u2 + of_eta2 + np.abs(e1) * of_z3)
    return loop.total(change)
