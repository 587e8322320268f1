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

from formnet.agent.dynamics import DynamicLayer
from formnet.agent.excitation import Excitation, W1Signal
from formnet.agent.law import Command
from formnet.exact.trigonometry import sin_cos
from formnet.formation.briefing.situation import Situation
from formnet.formation.wire.state import Stamped, State

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
        settings = situation.settings
        self._w1 = W1Signal(settings.w1)
        self._beta = settings.beta
        self._delta_sign = 1.0 if settings.delta == "corrected" else -1.0
        self._compensated = settings.cross_term == "compensated"
        self._dynamic = settings.level == "dynamic"
        self._scale = settings.length_scale_m
        self._own_offset = self._scaled(situation.offsets_m[situation.robot])
        self._offsets = {i: self._scaled(situation.offsets_m[i]) for i in situation.coupling}
        self._coupling = dict(situation.coupling)
        self._damping = situation.damping
        self._layer = DynamicLayer(situation)
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
            b_z2 - pull * z2 - beta * w1 * (w1 * z2 - beta * z3 * w1_squared) - beta * z3 * w1_dot
        )
        if self._compensated:
            eta2 -= w1 * z3
        if not self._dynamic:
            return Command((eta2 + z3 * eta1) * self._scale, -eta1)

        eta1_dot = b_s_dot - pull * s_dot + w1_dot
        eta2_dot = (
            b_z2_dot
            - pull * z2_dot
            - beta * (2.0 * w1 * w1_dot * z2 + w1_squared * z2_dot)
            + beta * beta * w1_squared * (z3_dot * w1 + 3.0 * z3 * w1_dot)
            - beta * (z3_dot * w1_dot + z3 * w1_ddot)
        )
        if self._compensated:
            eta2_dot -= w1_dot * z3 + w1 * z3_dot
        return self._layer.torques(
            t_s, z3, z3_dot, me[4], me[5], eta1, eta2, eta1_dot, eta2_dot, big_s, z2
        )

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
        sine, cosine = sin_cos(heading)
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
