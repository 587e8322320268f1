"""One robot's motion over one control period (Eqs. 6 and 7 of the paper).

The reference point is the middle of the axle, the centre of mass d ahead of it.
With forward force f and yaw torque n (both net of friction and disturbance)::

    m (v̇ − d ω²) = f          (I + m d²) ω̇ + m d v ω = n
    ẋ = v cos θ    ẏ = v sin θ    θ̇ = ω

Commands are held over the period (zero-order hold).
"""

import math
from dataclasses import dataclass, field

from formnet.exact.exponentials import exp, expm1
from formnet.exact.trigonometry import sin_cos
from formnet.formation.scenario.failures import Plant
from formnet.formation.scenario.robots import Vehicle
from formnet.formation.wire.state import State
from formnet.formation.wire.tuples import make

# Gauss-Legendre collocation with three stages, order 6 (Hairer, Nørsett, Wanner,
# Solving Ordinary Differential Equations I, section II.7): nodes and weights on
# [0, 1] and the matrix a_ij = ∫₀^{c_i} ℓ_j.
_R = math.sqrt(15.0)
C1, C2, C3 = 0.5 - _R / 10.0, 0.5, 0.5 + _R / 10.0
B1, B2, B3 = 5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0
MATRIX = (
    (5.0 / 36.0, 2.0 / 9.0 - _R / 15.0, 5.0 / 36.0 - _R / 30.0),
    (5.0 / 36.0 + _R / 24.0, 2.0 / 9.0, 5.0 / 36.0 - _R / 24.0),
    (5.0 / 36.0 + _R / 30.0, 2.0 / 9.0 + _R / 15.0, 5.0 / 36.0),
)

MOST_TURN_PER_STEP = 0.1
"""Radians (or decay time constants) per step; a period that holds more is split.

The quadrature's error is then below 1e-12 of the distance covered.
"""
MOST_TURN_PER_PERIOD = 1e4
"""A robot that would turn by more within a period counts as diverged."""


@dataclass(frozen=True, slots=True)
class Body:
    """The true parameters of one robot's dynamics, in SI units."""

    mass_kg: float
    axle_inertia_kgm2: float
    com_offset_m: float
    half_axle_m: float
    wheel_radius_m: float
    torque_limit_nm: float
    linear_friction_nspm: float
    angular_friction_nmsprad: float
    disturbance_force_n: float
    disturbance_torque_nm: float

    accelerates_evenly: bool = field(init=False)
    """Whether constant torques give constant accelerations: no d, no friction."""

    def __post_init__(self) -> None:
        terms = (self.com_offset_m, self.linear_friction_nspm, self.angular_friction_nmsprad)
        object.__setattr__(self, "accelerates_evenly", not any(terms))

    @classmethod
    def of(cls, vehicle: Vehicle) -> "Body":
        limit, offset_m = vehicle.wheel_torque_limit_nm, vehicle.com_offset_m
        return cls(
            mass_kg=vehicle.mass_kg,
            axle_inertia_kgm2=vehicle.inertia_kgm2 + vehicle.mass_kg * (offset_m * offset_m),
            com_offset_m=offset_m,
            half_axle_m=vehicle.half_axle_m,
            wheel_radius_m=vehicle.wheel_radius_m,
            torque_limit_nm=math.inf if limit is None else limit,
            linear_friction_nspm=vehicle.linear_friction_nspm,
            angular_friction_nmsprad=vehicle.angular_friction_nmsprad,
            disturbance_force_n=vehicle.disturbance_force_n,
            disturbance_torque_nm=vehicle.disturbance_torque_nm,
        )

    def saturated(self, torque_nm: float) -> float:
        """A wheel torque within the limit; NaN stays NaN."""
        limit = self.torque_limit_nm
        return limit if torque_nm > limit else -limit if torque_nm < -limit else torque_nm

    def stiffness(self, speed_mps: float) -> float:
        """The fastest rate (1/s) at which offset and friction change the velocities."""
        return (
            abs(self.com_offset_m) * self.mass_kg / self.axle_inertia_kgm2 * speed_mps
            + self.linear_friction_nspm / self.mass_kg
            + self.angular_friction_nmsprad / self.axle_inertia_kgm2
        )

    def accelerations(
        self, speed: float, turn_rate: float, force: float, yaw: float
    ) -> tuple[float, float]:
        """(v̇, ω̇) of Eq. 7 for the applied forward force and yaw torque."""
        d = self.com_offset_m
        net_force = force + self.disturbance_force_n - self.linear_friction_nspm * speed
        net_yaw = yaw + self.disturbance_torque_nm - self.angular_friction_nmsprad * turn_rate
        return (
            net_force / self.mass_kg + d * turn_rate * turn_rate,
            (net_yaw - self.mass_kg * d * speed * turn_rate) / self.axle_inertia_kgm2,
        )


def driven(body: Body, state: State, right_nm: float, left_nm: float, period_s: float) -> State:
    """The state after ``period_s`` under constant wheel torques (N m)."""
    if body.torque_limit_nm != math.inf:
        right_nm, left_nm = body.saturated(right_nm), body.saturated(left_nm)
    force = (right_nm + left_nm) / body.wheel_radius_m
    yaw = body.half_axle_m * (right_nm - left_nm) / body.wheel_radius_m
    v_dot, w_dot = body.accelerations(state[3], state[4], force, yaw)
    turn = (abs(state[4]) + abs(w_dot) * period_s) * period_s
    even = body.accelerates_evenly
    if not even:
        turn += body.stiffness(abs(state[3]) + abs(v_dot) * period_s) * period_s
    if not turn < MOST_TURN_PER_PERIOD:  # also NaN: the plant reports divergence
        return State(math.nan, math.nan, math.nan, math.nan, math.nan)
    if even and turn <= MOST_TURN_PER_STEP:
        return _even_step(state, v_dot, w_dot, period_s)
    steps = max(1, math.ceil(turn / MOST_TURN_PER_STEP))
    for _ in range(steps):
        state = (
            _even_step(state, v_dot, w_dot, period_s / steps)
            if even
            else _collocation_step(body, state, force, yaw, period_s / steps)
        )
    return state


def _even_step(state: State, v_dot: float, w_dot: float, h: float) -> State:
    """One step of length ``h`` with constant accelerations (no d, no friction).

    v and ω are then linear and θ is quadratic in time, exactly; only the
    position needs the quadrature. Unrolled: this is the plant's hot path.
    """
    x, y, heading, v, w = state
    half = 0.5 * w_dot
    t1, t2, t3 = C1 * h, C2 * h, C3 * h
    v1, v2, v3 = B1 * (v + v_dot * t1), B2 * (v + v_dot * t2), B3 * (v + v_dot * t3)
    s1, c1 = sin_cos(heading + t1 * (w + half * t1))
    s2, c2 = sin_cos(heading + t2 * (w + half * t2))
    s3, c3 = sin_cos(heading + t3 * (w + half * t3))
    return make(
        State,
        (
            x + h * (v1 * c1 + v2 * c2 + v3 * c3),
            y + h * (v1 * s1 + v2 * s2 + v3 * s3),
            heading + h * (w + half * h),
            v + v_dot * h,
            w + w_dot * h,
        ),
    )


def _collocation_step(body: Body, state: State, force: float, yaw: float, h: float) -> State:
    """One step of length ``h``; the implicit stages are solved by fixed-point iteration.

    Contracts by MOST_TURN_PER_STEP per sweep or better, so it ends after a few.
    """
    x, y, heading, speed, turn_rate = state
    v_dots, w_dots = ([a] * 3 for a in body.accelerations(speed, turn_rate, force, yaw))
    speeds = turn_rates = [0.0] * 3
    for _ in range(50):
        before = (*v_dots, *w_dots)
        speeds = [speed + h * _dot(row, v_dots) for row in MATRIX]
        turn_rates = [turn_rate + h * _dot(row, w_dots) for row in MATRIX]
        for i in range(3):
            v_dots[i], w_dots[i] = body.accelerations(speeds[i], turn_rates[i], force, yaw)
        if all(
            abs(new - old) <= 1e-15 * (abs(new) + abs(old))
            for new, old in zip((*v_dots, *w_dots), before, strict=True)
        ):
            break
    weights = (B1, B2, B3)
    turned = [sin_cos(heading + h * _dot(row, turn_rates)) for row in MATRIX]
    return State(
        x + h * _dot(weights, [v * c for v, (_, c) in zip(speeds, turned, strict=True)]),
        y + h * _dot(weights, [v * s for v, (s, _) in zip(speeds, turned, strict=True)]),
        heading + h * _dot(weights, turn_rates),
        speed + h * _dot(weights, v_dots),
        turn_rate + h * _dot(weights, w_dots),
    )


def _dot(row: tuple[float, float, float], values: list[float]) -> float:
    return row[0] * values[0] + row[1] * values[1] + row[2] * values[2]


def steered(state: State, speed_mps: float, turn_rate_radps: float, period_s: float) -> State:
    """The kinematic level (Eq. 6): an arc at constant speed and turn rate, in closed form."""
    arc, turn = speed_mps * period_s, turn_rate_radps * period_s
    return _after_arc(state, arc, turn, speed_mps, turn_rate_radps)


def braked(state: State, period_s: float, time_s: float) -> State:
    """The state after ``period_s`` in which both velocities decay as exp(−t / ``time_s``).

    They keep their ratio, so the way is an arc, in closed form.
    """
    left = exp(-period_s / time_s)
    effective_s = time_s * -expm1(-period_s / time_s)
    speed, turn_rate = state.speed_mps, state.turn_rate_radps
    arc, turn = speed * effective_s, turn_rate * effective_s
    return _after_arc(state, arc, turn, speed * left, turn_rate * left)


def left_alone(plant: Plant, body: Body | None, state: State, period_s: float) -> State:
    """The state after ``period_s`` of a robot without a process (``plant.body_on_failure``).

    ``body`` is None at the kinematic level.
    """
    if plant.body_on_failure == "freeze":
        return State(state.x_m, state.y_m, state.heading_rad, 0.0, 0.0)
    if plant.body_on_failure == "brake":
        return braked(state, period_s, plant.brake_time_s)
    if body is not None:
        return driven(body, state, 0.0, 0.0, period_s)
    return steered(state, state.speed_mps, state.turn_rate_radps, period_s)


def _after_arc(
    state: State, arc_m: float, turn_rad: float, speed_mps: float, turn_rate_radps: float
) -> State:
    """Where an arc leads, arriving with these velocities."""
    half = 0.5 * turn_rad
    chord = arc_m * (sin_cos(half)[0] / half if half != 0.0 else 1.0)
    sine, cosine = sin_cos(state.heading_rad + half)
    return State(
        state.x_m + chord * cosine,
        state.y_m + chord * sine,
        state.heading_rad + turn_rad,
        speed_mps,
        turn_rate_radps,
    )
