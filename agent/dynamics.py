"""The dynamic layer of the paper: wheel torques that make velocities follow η (Eqs. 29, 31).

Shared by every law that decides velocities first. Plain floats and no arrays, as in
:mod:`agent.cooperative`.
"""

from math import sqrt

from formnet.agent.law import Command
from formnet.exact.exponentials import exp
from formnet.formation.briefing.situation import Situation, parameters
from formnet.formation.wire.tuples import make


class DynamicLayer:
    """Eq. 29 for one robot: lengths are in units of ℓ = ``length_scale_m`` metres."""

    def __init__(self, situation: Situation) -> None:
        settings, body = situation.settings, situation.body
        scale = settings.length_scale_m
        self._inertia_shaped = settings.feedback_shape == "inertia"
        self._com_uncertain = body.com_uncertain
        self._constants = (
            *parameters(body.mass_kg, body.inertia_kgm2, body.com_offset_m, scale),
            settings.feedback_gain,
            body.robust_bound if settings.robust else 0.0,
            settings.boundary_layer,
            settings.gamma,
            scale,
            body.half_axle_m,
            0.5 * body.wheel_radius_m,
        )

    def torques(
        self,
        t_s: float,
        zeta3: float,
        zeta3_dot: float,
        u1: float,
        u2: float,
        eta1: float,
        eta2: float,
        eta1_dot: float,
        eta2_dot: float,
        lambda1: float,
        lambda2: float,
    ) -> Command:
        """The wheel torques that give the wrench B̄τ for u = (−ω, v + ζ3 ω) and Λ.

        A law that decides (v, ω) themselves has ζ3 = 0.
        """
        a1, a2, a3, gain, rho, epsilon, gamma, scale, half_axle, half_radius = self._constants
        omega = -u1
        e1, e2 = u1 - eta1, u2 - eta2
        # Rows of the regressor Ȳ(ζ, ζ̇, η, η̇) of Property 4 for a = (m, I + m d², m d).
        s = zeta3_dot * eta1 + zeta3 * eta1_dot + eta2_dot
        y11, y12, y21 = zeta3 * s, eta1_dot, s
        y13, y23 = (-omega * eta2, omega * eta1) if self._com_uncertain else (0.0, 0.0)
        # Π, Eq. 31 with a boundary layer ε: ρ Ȳᵀũ / (‖Ȳᵀũ‖ + ε exp(−γ t)).
        p1, p2, p3 = y11 * e1 + y21 * e2, y12 * e1, y13 * e1 + y23 * e2
        denominator = sqrt(p1 * p1 + p2 * p2 + p3 * p3) + epsilon * exp(-gamma * t_s)
        share = rho / denominator if denominator > 0.0 else 0.0
        r1, r2, r3 = a1 - share * p1, a2 - share * p2, a3 - share * p3
        # K ũ with K = k 1 or K = k M̄(q) from the estimates.
        if self._inertia_shaped:
            k2 = a1 * (zeta3 * e1 + e2)
            k1 = zeta3 * k2 + a2 * e1
        else:
            k1, k2 = e1, e2
        wrench1 = -gain * k1 + y11 * r1 + y12 * r2 + y13 * r3 - lambda1
        wrench2 = -gain * k2 + y21 * r1 + y23 * r3 - lambda2
        # B̄τ = [ζ3 f − n, f], f = (τ_r + τ_l)/R, n = L (τ_r − τ_l)/R.
        force = wrench2 / scale
        yaw = (zeta3 * wrench2 - wrench1) / half_axle
        return make(Command, (half_radius * (force + yaw), half_radius * (force - yaw)))
