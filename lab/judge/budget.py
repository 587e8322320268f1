"""How much V may gain in a sampled loop although the theorems say that it never rises.

The theorems are about continuous control over delays that are what the scenario says. In a
sampled loop V may rise a little all the same; how much is computed from the run, not fitted
to it:

sampling
    the power Σ ũᵀ(w − w*) by which a law can differ from Eq. 29's w* in continuous time (at
    the kinematic level: its velocities from Eqs. 38, 39) that holds its wrench w for a whole
    broadcast period, and of one that uses what it heard for so long, each where positive;
robust term
    ρ‖Ȳᵀũ‖ e / (‖Ȳᵀũ‖ + e) with e = ε exp(−γt), which is at most Eq. 35's ρ ε exp(−γt);
rounding
    that of states, law and V (:mod:`lab.judge.rounding`).

V* leans on ζ2 besides: a velocity that differs from Eq. 39's by u2 − η2 gains it ζ2ᵀN⁻¹(u2 − η2)/β.

Whatever V gains beyond that is a rise (:mod:`lab.judge.rises`).
"""

import numpy as np

from formnet.formation.briefing.situation import body_estimate, parameters
from formnet.lab.judge.closed_loop import Array, ClosedLoop, Eta
from formnet.lab.judge.rounding import rounding


def budget(loop: ClosedLoop, now: Eta, lean: Array) -> Array:
    """What V may have gained since the instant before, (n,); 0 at the first.

    ``lean`` is the derivative by ζ2 of what V* adds to V, (n, robots); 0 for V.
    """
    return _sampled(loop, now, lean) + rounding(loop, now, lean)


def _sampled(loop: ClosedLoop, now: Eta, lean: Array) -> Array:
    """The part of sampling and of the robust term."""
    robots, stale = loop.robots, loop.eta(stale=True)
    if loop.law.level == "kinematic":
        own, by_u2 = _held_velocities(loop, now), robots.z2 + lean
        powers = [
            robots.s * (own[0] - now.first) + by_u2 * (own[1] - now.second),
            robots.s * (stale.first - now.first) + by_u2 * (stale.second - now.second),
        ]
        return _integrated(loop, powers, np.zeros_like(loop.t_s))
    e1, e2 = robots.u1 - now.first, robots.u2 - now.second
    first, second, robust = _wrench(loop, now)
    old_first, old_second, _ = _wrench(loop, stale)
    force, yaw = _held(second), _held(robots.z3 * second - first)
    powers = [
        e1 * (robots.z3 * force - yaw - first) + e2 * (force - second),
        e1 * (old_first - first) + e2 * (old_second - second),
    ]
    return _integrated(loop, powers, loop.total(robust))


def _integrated(loop: ClosedLoop, powers: list[Array], robust: Array) -> Array:
    """∫ of the robust term and of the powers, where they are positive, (n,).

    ``powers`` are (n, robots), ``robust`` (n,); in each interval their larger end counts.
    """
    rates = [robust, *(loop.total(np.maximum(power, 0.0)) for power in powers)]
    gains = np.diff(loop.t_s) * sum(map(loop.larger_end, rates))
    return np.concatenate(([0.0], np.where(np.isfinite(gains), gains, np.inf)))


def _wrench(loop: ClosedLoop, eta: Eta) -> tuple[Array, Array, Array]:
    """B̄τ of Eq. 29, (n, robots) twice, and how much its robust term may let V gain a second."""
    r, law = loop.robots, loop.law
    estimates = [body_estimate(v, law.length_scale_m) for v in loop.vehicles]
    mass, inertia, offset = np.array(
        [
            parameters(e.mass_kg, e.inertia_kgm2, e.com_offset_m, law.length_scale_m)
            for e in estimates
        ]
    ).T
    uncertain = np.array([e.com_uncertain for e in estimates])
    rho = np.array([e.robust_bound if law.robust else 0.0 for e in estimates])
    e1, e2 = r.u1 - eta.first, r.u2 - eta.second
    omega = -r.u1
    s = r.z3_dot * eta.first + r.z3 * eta.first_dot + eta.second_dot
    y13 = np.where(uncertain, -omega * eta.second, 0.0)
    y23 = np.where(uncertain, omega * eta.first, 0.0)
    x1, x2, x3 = r.z3 * s * e1 + s * e2, eta.first_dot * e1, y13 * e1 + y23 * e2
    size = np.sqrt(x1**2 + x2**2 + x3**2)
    layer = law.boundary_layer * np.exp(-law.gamma * loop.t_s)[:, None]
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


def _held_velocities(loop: ClosedLoop, eta: Eta) -> tuple[Array, Array]:
    """u of Eq. 8 for the speed and turn rate that were right at the instant before."""
    speed, turn_rate = _held(eta.second + loop.robots.z3 * eta.first), _held(-eta.first)
    return -turn_rate, speed + loop.robots.z3 * turn_rate


def _held(values: Array) -> Array:
    """The values of the instant before (the first: its own)."""
    return np.concatenate((values[:1], values[:-1]))
