"""The plant against SciPy's DOP853, conservation laws, and the paper's Properties 1-4."""

import math
import re

import matrices as model
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from formnet.formation.briefing.resolving import resolve
from formnet.formation.wire.messages import Drive
from formnet.formation.wire.state import State
from formnet.plant.body import Body, driven, steered
from formnet.plant.world import BAD_COMMAND, BAD_STATE, World


def body(**changes: float) -> Body:
    values = {
        "mass_kg": 1.7,
        "axle_inertia_kgm2": 0.9,
        "com_offset_m": 0.0,
        "half_axle_m": 0.5,
        "wheel_radius_m": 0.2,
        "torque_limit_nm": math.inf,
        "linear_friction_nspm": 0.0,
        "angular_friction_nmsprad": 0.0,
        "disturbance_force_n": 0.0,
        "disturbance_torque_nm": 0.0,
    }
    return Body(**(values | changes))


def oracle(b: Body, state: State, right: float, left: float, period_s: float) -> np.ndarray:
    """The same motion from Eqs. 1 and 2 as printed (matrices and constraint), by DOP853."""
    force = np.array([right, left]).clip(-b.torque_limit_nm, b.torque_limit_nm)

    def rates(_t, y):
        heading, v, w = y[2:]
        m = model.reduced_inertia(b, heading)
        c = model.reduced_coriolis(b, heading, w)
        push = model.reduced_input(b, heading) @ force
        push = push + np.array([b.disturbance_force_n, b.disturbance_torque_nm])
        push = push - np.array([b.linear_friction_nspm * v, b.angular_friction_nmsprad * w])
        v_dot, w_dot = np.linalg.solve(m, push - c @ [v, w])
        return [v * np.cos(heading), v * np.sin(heading), w, v_dot, w_dot]

    solution = solve_ivp(rates, (0, period_s), list(state), method="DOP853", rtol=1e-13, atol=1e-13)
    return solution.y[:, -1]


bodies = st.builds(
    body,
    mass_kg=st.floats(0.5, 50),
    axle_inertia_kgm2=st.floats(0.5, 20),
    com_offset_m=st.sampled_from([0.0, 0.1, -0.2]),
    linear_friction_nspm=st.sampled_from([0.0, 3.0]),
    angular_friction_nmsprad=st.sampled_from([0.0, 2.0]),
    disturbance_force_n=st.floats(-5, 5),
    disturbance_torque_nm=st.floats(-5, 5),
    torque_limit_nm=st.sampled_from([math.inf, 4.0]),
)
states = st.builds(
    State,
    st.floats(-50, 50),
    st.floats(-50, 50),
    st.floats(-7, 7),
    st.floats(-30, 30),
    st.floats(-12, 12),
)
torques = st.floats(-20, 20)


@given(bodies, states, torques, torques, st.sampled_from([1e-3, 1e-2, 5e-2]))
@settings(max_examples=60, deadline=None)
def test_one_tick_is_accurate_to_a_nanometre(b, state, right, left, period_s):
    expected = oracle(b, state, right, left, period_s)
    found = driven(b, state, right, left, period_s)
    np.testing.assert_allclose(found[:2], expected[:2], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[2:], expected[2:], rtol=1e-11, atol=1e-9)


@pytest.mark.parametrize("speed", [300.0, -300.0])
def test_accurate_at_the_speeds_of_section_5(speed):
    state, b = State(3.0, -40.0, 1.0, speed, 9.0), body(mass_kg=1.0, axle_inertia_kgm2=1.0)
    found = driven(b, state, 800.0, -900.0, 1e-3)
    np.testing.assert_allclose(found[:2], oracle(b, state, 800.0, -900.0, 1e-3)[:2], atol=1e-9)


@given(states, st.floats(-30, 30), st.floats(-12, 12))
@settings(max_examples=40, deadline=None)
def test_kinematic_arc_against_dop853(state, speed, rate):
    def rates(_t, y):
        return [speed * np.cos(y[2]), speed * np.sin(y[2]), rate]

    period_s = 0.05
    end = solve_ivp(rates, (0, period_s), state[:3], method="DOP853", rtol=1e-13, atol=1e-13).y[
        :, -1
    ]
    found = steered(state, speed, rate, period_s)
    np.testing.assert_allclose(found[:3], end, rtol=0, atol=1e-9)
    assert found[3:] == (speed, rate)


def test_kinetic_energy_is_kept_without_forces_and_changes_by_the_work_done():
    b = body(com_offset_m=0.2)
    state = State(0, 0, 0, 3.0, 4.0)

    def energy(s):
        return 0.5 * (b.mass_kg * s.speed_mps**2 + b.axle_inertia_kgm2 * s.turn_rate_radps**2)

    coasting = state
    for _ in range(1000):
        coasting = driven(b, coasting, 0.0, 0.0, 1e-2)
    assert energy(coasting) == pytest.approx(energy(state), rel=1e-10)
    assert coasting.turn_rate_radps != pytest.approx(state.turn_rate_radps, rel=1e-2)

    pushed, work = state, 0.0
    for _ in range(1000):
        after = driven(b, pushed, 1.0, 0.5, 1e-3)
        speed, rate = (0.5 * (after[i] + pushed[i]) for i in (3, 4))
        work += 1e-3 * (1.5 / 0.2 * speed + 0.5 * 0.5 / 0.2 * rate)
        pushed = after
    assert energy(pushed) - energy(state) == pytest.approx(work, rel=1e-5)


def test_friction_has_the_closed_form():
    b = body(linear_friction_nspm=2.0)
    state = State(0, 0, 0, 0, 0)
    for _ in range(100):
        state = driven(b, state, 1.0, 1.0, 0.01)
    force = 2.0 / 0.2
    assert state.speed_mps == pytest.approx(force / 2.0 * (1 - math.exp(-2.0 / 1.7)), rel=1e-10)


def test_torque_limit_and_disturbance():
    rest = State(0, 0, 0, 0, 0)
    limited = body(torque_limit_nm=1.0)
    assert driven(limited, rest, 5.0, -7.0, 0.01) == driven(limited, rest, 1.0, -1.0, 0.01)
    pushed = driven(body(disturbance_force_n=1.7), rest, 0.0, 0.0, 0.5)
    assert pushed.speed_mps == pytest.approx(0.5)
    assert pushed.x_m == pytest.approx(0.125)


# --- Properties 1 to 4 ------------------------------------------------------------------

angles = st.floats(-7, 7)
rates = st.floats(-5, 5)
any_body = st.builds(body, com_offset_m=st.floats(-0.4, 0.4), mass_kg=st.floats(0.5, 5))


def derivative(function, heading, turn_rate):
    """d/dt along θ̇ = turn_rate, by central differences."""
    h = 1e-6
    return (function(heading + turn_rate * h) - function(heading - turn_rate * h)) / (2 * h)


@given(any_body, angles, rates)
@settings(max_examples=40, deadline=None)
def test_property_1_skew_symmetry(b, heading, rate):
    m_dot = derivative(lambda q: model.inertia(b, q), heading, rate)
    s = m_dot - 2 * model.coriolis(b, heading, rate)
    np.testing.assert_allclose(s, -s.T, atol=1e-8)


@given(angles, rates, st.tuples(rates, rates, rates), st.tuples(rates, rates, rates))
@settings(max_examples=40, deadline=None)
def test_property_2_linear_in_the_parameters(heading, rate, xi, xi_dot):
    """M ξ̇ + C ξ for a = (m, I + m d², m d) is the sum over a's components of fixed columns."""

    def left_side(mass, axle, d):
        b = body(mass_kg=mass, axle_inertia_kgm2=axle, com_offset_m=d)
        return model.inertia(b, heading) @ xi_dot + model.coriolis(b, heading, rate) @ xi

    columns = [left_side(1.0, 0.0, 0.0), left_side(0.0, 1.0, 0.0)]
    columns.append(left_side(1.0, 0.0, 1.0) - columns[0])
    a = (1.7, 0.9, 1.7 * 0.3)
    np.testing.assert_allclose(left_side(1.7, 0.9, 0.3), np.array(columns).T @ a, atol=1e-12)


def transformed(b, heading, rate, offset_vector, speed):
    """M̄, C̄ of Eq. 10 and the position they hold at; ḡ as in Eq. 11."""

    def g_bar(q, position):
        c, s = np.cos(q), np.sin(q)
        zeta3 = -position[0] * s + position[1] * c
        return np.array([[zeta3 * c, c], [zeta3 * s, s], [-1, 0]])

    def at(t):
        q = heading + rate * t
        position = np.add(offset_vector, [t * speed * np.cos(heading), t * speed * np.sin(heading)])
        return q, position

    g = g_bar(*at(0.0))
    h = 1e-6
    g_dot = (g_bar(*at(h)) - g_bar(*at(-h))) / (2 * h)
    m, c = model.inertia(b, heading), model.coriolis(b, heading, rate)
    m_bar_dot = sum(
        sign * g_bar(*at(sign * h)).T @ model.inertia(b, at(sign * h)[0]) @ g_bar(*at(sign * h))
        for sign in (1, -1)
    ) / (2 * h)
    return g.T @ m @ g, g.T @ (m @ g_dot + c @ g), m_bar_dot


@given(any_body, angles, rates, st.tuples(rates, rates), rates)
@settings(max_examples=40, deadline=None)
def test_property_3_skew_symmetry_of_the_transformed_system(b, heading, rate, position, speed):
    _, c_bar, m_bar_dot = transformed(b, heading, rate, position, speed)
    s = m_bar_dot - 2 * c_bar
    np.testing.assert_allclose(s, -s.T, atol=1e-6)


@given(
    angles, rates, st.tuples(rates, rates), rates, st.tuples(rates, rates), st.tuples(rates, rates)
)
@settings(max_examples=40, deadline=None)
def test_property_4_linear_in_the_parameters(heading, rate, position, speed, xi, xi_dot):
    def left_side(mass, axle, d):
        b = body(mass_kg=mass, axle_inertia_kgm2=axle, com_offset_m=d)
        m_bar, c_bar, _ = transformed(b, heading, rate, position, speed)
        return m_bar @ xi_dot + c_bar @ xi

    columns = [left_side(1.0, 0.0, 0.0), left_side(0.0, 1.0, 0.0)]
    columns.append(left_side(1.0, 0.0, 1.0) - columns[0])
    np.testing.assert_allclose(
        left_side(1.7, 0.9, 0.3), np.array(columns).T @ (1.7, 0.9, 0.51), atol=1e-7
    )


@given(any_body, states, torques, torques)
@settings(max_examples=40, deadline=None)
def test_accelerations_satisfy_eq_1_up_to_the_constraint_force(b, state, right, left):
    """M q̈ + C q̇ − B τ must be a multiple of (sin θ, −cos θ, 0)."""
    assume(b.axle_inertia_kgm2 > b.mass_kg * b.com_offset_m**2)
    heading, v, w = state[2:]
    force, yaw = (
        (right + left) / b.wheel_radius_m,
        b.half_axle_m * (right - left) / b.wheel_radius_m,
    )
    v_dot, w_dot = b.accelerations(v, w, force, yaw)
    q_dot = model.reduction(heading) @ [v, w]
    q_ddot = model.reduction(heading) @ [v_dot, w_dot]
    q_ddot = q_ddot + model.reduction_rate(heading, w) @ [v, w]
    rest = model.inertia(b, heading) @ q_ddot + model.coriolis(b, heading, w) @ q_dot
    rest = rest - model.input_matrix(b, heading) @ [right, left]
    along = np.array([math.sin(heading), -math.cos(heading), 0.0])
    np.testing.assert_allclose(rest - (rest @ along) * along, 0.0, atol=1e-8 * (1 + abs(w * v)))


# --- the world's protocol -----------------------------------------------------------------


def test_world_takes_each_drive_once_and_only_for_its_tick(paper):
    world = World(resolve(paper("section5", "duration_s=0.01")))
    with pytest.raises(ValueError, match="tick 1"):
        world.on_drive(Drive(1, 1, 0.0, 0.0))
    with pytest.raises(ValueError, match="robot 9"):
        world.on_drive(Drive(9, 0, 0.0, 0.0))
    assert world.on_drive(Drive(1, 0, 0.0, 0.0)).tick == 1
    assert world.tick == 0
    with pytest.raises(ValueError, match="robot 1"):
        world.on_drive(Drive(1, 0, 0.0, 0.0))
    assert world.awaited() == [2, 3, 4, 5]


def test_world_samples_every_broadcast_tick_and_the_end(paper):
    world = World(resolve(paper("section5", "duration_s=0.025", "clock.broadcast_period_s=0.01")))
    while not world.finished:
        for robot, sense in world.senses():
            world.on_drive(Drive(robot, sense.tick, 1.0, 2.0))
    samples = world.take_samples()
    assert sorted({s.t_ns for s in samples}) == [0, 10_000_000, 20_000_000, 25_000_000]
    assert [s.robot for s in samples] == [1, 2, 3, 4, 5] * 4
    assert samples[-1].torque_right_nm == 1.0
    assert world.take_samples() == []


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e300])
def test_world_reports_divergence_of_the_first_robot_whatever_the_order(paper, bad):
    """A command that is not finite, or one whose state overflows."""
    world = World(resolve(paper("section5", "duration_s=0.01")))
    for robot in (5, 4, 3, 2):
        world.on_drive(Drive(robot, 0, 0.0 if robot == 5 else bad, 0.0))
    assert not world.finished
    world.on_drive(Drive(1, 0, 0.0, 0.0))
    assert world.finished
    assert world.diverged == (0, 2, BAD_STATE if math.isfinite(bad) else BAD_COMMAND)
    assert len(world.take_samples()) == 5


def test_who_runs_away_is_to_blame_not_who_hears_of_it(paper):
    world = World(resolve(paper("section5", "duration_s=0.01")))
    for robot in world.ids:
        world.on_drive(Drive(robot, 0, 9e7 if robot == 4 else 0.0, 0.0))
    for robot in world.ids:
        world.on_drive(Drive(robot, 1, math.nan if robot == 2 else 0.0, 0.0))
    at_ns, robot, reason = world.diverged
    assert (at_ns, robot) == (10**6, 4)
    assert re.fullmatch(r"it runs away, at \S+ m/s and \S+ rad/s", reason)
