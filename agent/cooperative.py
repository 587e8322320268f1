"""The cooperative law of the paper: Theorems 1 to 6 from one implementation.

Which theorem applies follows from the settings: ``level`` (kinematic: 1, 2, 5;
dynamic: 3, 4, 6), the damping μ (Theorems 1 and 3 have none) and the stamps of
what was heard (Theorems 5 and 6 are Theorems 2 and 4 with old messages).

Lengths are measured in units of ℓ = ``length_scale_m`` metres. Two corrections
of the paper, derived in docs/corrections.md, are settings: ``delta`` and
``cross_term``.

Plain floats and no arrays: for two-vectors that is an order of magnitude faster
than NumPy, and this runs once per robot and control period.
"""

from math import cos, exp, sin, sqrt

from agent.excitation import Excitation, W1Signal
from agent.law import Command, Situation, parameters
from formation.messages import Stamped, State, make

Coordinates = tuple[float, float, float, float, float, float, float, float, float]
"""(ζ2, ζ3, z2, S, u1, u2, ζ̇3, ż2, Ṡ) of one robot at one instant, S = z1 + Δ (Eqs. 8, 19).

The rates follow from pose and velocity alone. A plain tuple: it is made and
taken apart once per robot and control period.
"""

NeighbourSums = tuple[float, float, float, float, float]
"""Σ b_ji and Σ b_ji · (S_i, z2_i, Ṡ_i, ż2_i) over the neighbours heard."""


class CooperativeLaw:
    """Eqs. 15-19, 26, 27 (kinematic) and 29-31 (dynamic); 38, 39 with delayed neighbours."""

    def __init__(self, situation: Situation) -> None:
        settings, body = situation.settings, situation.body
        self._w1 = W1Signal(settings.w1)
        self._beta = settings.beta
        self._delta_sign = 1.0 if settings.delta == "corrected" else -1.0
        self._compensated = settings.cross_term == "compensated"
        self._dynamic = settings.level == "dynamic"
        self._inertia_shaped = settings.feedback_shape == "inertia"
        self._scale = settings.length_scale_m
        self._own_offset = self._scaled(situation.offsets_m[situation.robot])
        self._offsets = {i: self._scaled(situation.offsets_m[i]) for i in situation.coupling}
        self._coupling = dict(situation.coupling)
        self._damping = situation.damping
        a_estimate = parameters(body.mass_kg, body.inertia_kgm2, body.com_offset_m, self._scale)
        self._com_uncertain = body.com_uncertain
        self._constants = (
            *a_estimate,
            settings.feedback_gain,
            body.robust_bound if settings.robust else 0.0,
            settings.boundary_layer,
            settings.gamma,
            self._scale,
            body.half_axle_m,
            0.5 * body.wheel_radius_m,
        )
        self._summed: tuple[tuple[Stamped, ...], NeighbourSums] = ((), (0.0,) * 5)

    def command(self, now_ns: int, own: State, heard: tuple[Stamped, ...]) -> Command:
        """See :meth:`agent.law.Law.command`."""
        t_s = now_ns * 1e-9
        w = self._w1.at(t_s)
        me = self._coordinates(own, self._own_offset, w)
        _, z3, z2, big_s, _, _, z3_dot, z2_dot, s_dot = me
        if heard is not self._summed[0]:
            self._summed = (heard, self._neighbour_sums(heard))
        b, b_s, b_z2, b_s_dot, b_z2_dot = self._summed[1]
        pull = b + self._damping  # Σ b_ji + μ_j multiplies the own state

        # η of Eqs. 26, 27 (17, 18 when μ = 0; 38, 39 when the neighbours are old).
        beta = self._beta
        w1, w1_dot, w1_ddot = w[1], w[2], w[3]
        w1_squared = w1 * w1
        eta1 = b_s - pull * big_s + w1
        eta2 = (
            b_z2 - pull * z2
            - beta * w1 * (w1 * z2 - beta * z3 * w1_squared)
            - beta * z3 * w1_dot
        )  # fmt: skip
        if self._compensated:
            eta2 -= w1 * z3
        if not self._dynamic:
            return Command((eta2 + z3 * eta1) * self._scale, -eta1)

        eta1_dot = b_s_dot - pull * s_dot + w1_dot
        eta2_dot = (
            b_z2_dot - pull * z2_dot
            - beta * (2.0 * w1 * w1_dot * z2 + w1_squared * z2_dot)
            + beta * beta * w1_squared * (z3_dot * w1 + 3.0 * z3 * w1_dot)
            - beta * (z3_dot * w1_dot + z3 * w1_ddot)
        )  # fmt: skip
        if self._compensated:
            eta2_dot -= w1_dot * z3 + w1 * z3_dot
        return self._torques(t_s, me, own[4], eta1, eta2, eta1_dot, eta2_dot)

    def _torques(
        self, t_s: float, me: Coordinates, omega: float,
        eta1: float, eta2: float, eta1_dot: float, eta2_dot: float,
    ) -> Command:  # fmt: skip
        """Eqs. 29-31 and the wheel torques that give the wrench B̄τ."""
        a1, a2, a3, gain, rho, epsilon, gamma, scale, half_axle, half_radius = self._constants
        _, zeta3, z2, big_s, u1, u2, zeta3_dot, _, _ = me
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
        wrench1 = -gain * k1 + y11 * r1 + y12 * r2 + y13 * r3 - big_s
        wrench2 = -gain * k2 + y21 * r1 + y23 * r3 - z2
        # B̄τ = [ζ3 f − n, f], f = (τ_r + τ_l)/R, n = L (τ_r − τ_l)/R.
        force = wrench2 / scale
        yaw = (zeta3 * wrench2 - wrench1) / half_axle
        return make(Command, (half_radius * (force + yaw), half_radius * (force - yaw)))

    def _neighbour_sums(self, heard: tuple[Stamped, ...]) -> NeighbourSums:
        """What the neighbours contribute, each evaluated at its own stamp.

        Depends on ``heard`` alone, so it is computed once per change of it.
        """
        b = b_s = b_z2 = b_s_dot = b_z2_dot = 0.0
        for robot, stamp_ns, state in heard:
            weight = self._coupling[robot]
            w = self._w1.at(stamp_ns * 1e-9)
            _, _, z2, s, _, _, _, z2_dot, s_dot = self._coordinates(state, self._offsets[robot], w)
            b += weight
            b_s += weight * s
            b_z2 += weight * z2
            b_s_dot += weight * s_dot
            b_z2_dot += weight * z2_dot
        return b, b_s, b_z2, b_s_dot, b_z2_dot

    def _scaled(self, offset_m: tuple[float, float]) -> tuple[float, float]:
        return offset_m[0] / self._scale, offset_m[1] / self._scale

    def _coordinates(self, state: State, offset: tuple[float, float], w: Excitation) -> Coordinates:
        """Eq. 8 with u of the same equation, Δ of Eq. 19, and their rates."""
        x_m, y_m, heading, speed, turn_rate = state
        scale, beta = self._scale, self._beta
        integral, w1, w1_dot, _ = w
        dx, dy = x_m / scale - offset[0], y_m / scale - offset[1]
        cosine, sine = cos(heading), sin(heading)
        zeta2 = dx * cosine + dy * sine
        zeta3 = dy * cosine - dx * sine
        u1 = -turn_rate
        u2 = speed / scale + zeta3 * turn_rate
        zeta3_dot = u1 * zeta2
        z2 = zeta2 + beta * w1 * zeta3
        z2_dot = u2 + beta * (w1 * zeta3_dot + w1_dot * zeta3)
        # Δ = ±(z2 β w1 + z3) ζ2: factor and its rate.
        factor = z2 * beta * w1 + zeta3
        factor_dot = beta * (z2_dot * w1 + z2 * w1_dot) + zeta3_dot
        sign = self._delta_sign
        s = -heading - integral + sign * factor * zeta2
        s_dot = u1 - w1 + sign * (factor_dot * zeta2 + factor * u2)
        return zeta2, zeta3, z2, s, u1, u2, zeta3_dot, z2_dot, s_dot
