"""The cooperative law against independent derivations: matrices, finite differences, Lyapunov rates."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from formnet.agent.cooperative import CooperativeLaw
from formnet.agent.excitation import W1Signal
from formnet.formation.briefing.situation import BodyEstimate, Situation, parameters
from formnet.formation.scenario.law import W1, LawSettings
from formnet.formation.wire.state import Stamped, State
from formnet.plant.body import Body, driven

W1_VARYING = W1(bias=0.4, amplitude=0.3, frequency_radps=1.7)
OFFSETS = {1: (1.24, 3.8), 2: (-3.24, 2.35), 3: (0.5, -2.0)}
coordinate = st.floats(-3.0, 3.0)
states = st.builds(State, coordinate, coordinate, coordinate, coordinate, coordinate)
times = st.floats(0.0, 20.0)


def situation(
    *,
    body: BodyEstimate | None = None,
    damping: float = 0.7,
    coupling: dict[int, float] | None = None,
    robot: int = 1,
    **law: object,
) -> Situation:
    values = {"beta": 1.5, "w1": W1_VARYING, "feedback_gain": 3.0, "cross_term": "compensated"}
    return Situation(
        robot=robot,
        settings=LawSettings.model_validate(values | law),
        control_period_s=0.01,
        offsets_m=OFFSETS,
        coupling={2: 1.3, 3: 0.6} if coupling is None else coupling,
        damping=damping,
        body=body or BodyEstimate(1.7, 0.6, 0.15, True, 0.8, 0.5, 0.2),
    )


# --- w1 -------------------------------------------------------------------------------


@given(times, st.floats(-1, 1), st.floats(-1, 1), st.floats(0.1, 5.0))
@settings(max_examples=30, deadline=None)
def test_excitation_against_quadrature_and_differences(t, bias, amplitude, omega):
    signal = W1Signal(W1(bias=bias, amplitude=amplitude, frequency_radps=omega))
    integral, value, rate, acceleration = signal.at(t)
    expected, _ = quad(lambda s: bias + amplitude * np.sin(omega * s), 0.0, t, limit=200)
    assert integral == pytest.approx(expected, abs=1e-7)
    assert value == pytest.approx(bias + amplitude * np.sin(omega * t), abs=1e-12)
    h = 1e-5
    after, before = signal.at(t + h), signal.at(t - h)
    assert rate == pytest.approx((after[1] - before[1]) / (2 * h), abs=1e-6)
    assert acceleration == pytest.approx((after[2] - before[2]) / (2 * h), abs=1e-6)


# --- an independent reading of the law, with matrices ---------------------------------


def w1_of(t):
    w = W1_VARYING
    return w.bias + w.amplitude * np.sin(w.frequency_radps * t)


def w1_rate(t):
    w = W1_VARYING
    return w.amplitude * w.frequency_radps * np.cos(w.frequency_radps * t)


def z_of(t, state, offset, beta, sign):
    """(z1, z2, z3, ζ2, S) from Eq. 8 and Eq. 19 as printed there (with its sign as given)."""
    w = W1_VARYING
    integral = w.bias * t + w.amplitude / w.frequency_radps * (1 - np.cos(w.frequency_radps * t))
    c, s = np.cos(state.heading_rad), np.sin(state.heading_rad)
    dx, dy = state.x_m - offset[0], state.y_m - offset[1]
    zeta2, z3 = dx * c + dy * s, -dx * s + dy * c
    z1, z2 = -state.heading_rad - integral, zeta2 + beta * w1_of(t) * z3
    return z1, z2, z3, zeta2, z1 + sign * (z2 * beta * w1_of(t) * zeta2 + z3 * zeta2)


def eta_of(t, own, neighbours, about, sign=1.0):
    """η of Eqs. 26, 27 with the compensated cross term; ``neighbours``: {robot: (t, state)}."""
    beta, mu = about.settings.beta, about.damping
    _, z2, z3, _, big_s = z_of(t, own, OFFSETS[about.robot], beta, sign)
    w, w_dot = w1_of(t), w1_rate(t)
    eta1, eta2 = -mu * big_s + w, -mu * z2 - beta * w * (-beta * z3 * w**2 + w * z2)
    eta2 += -beta * z3 * w_dot - w * z3
    for robot, (stamp, state) in neighbours.items():
        b = about.coupling[robot]
        _, other_z2, _, _, other_s = z_of(stamp, state, OFFSETS[robot], beta, sign)
        eta1 -= b * (big_s - other_s)
        eta2 -= b * (z2 - other_z2)
    return np.array([eta1, eta2])


def moved(state, h):
    """The state after ``h`` seconds at its own constant velocity (negative: before)."""
    x, y, heading, v, w = state
    n = 200  # the exact arc, by composite midpoint rule
    angles = heading + w * h * (np.arange(n) + 0.5) / n
    return State(
        x + h * v * np.cos(angles).mean(), y + h * v * np.sin(angles).mean(), heading + w * h, v, w
    )


def m_full(a, heading):
    m, axle, md = a
    s, c = np.sin(heading), np.cos(heading)
    return np.array([[m, 0, -md * s], [0, m, md * c], [-md * s, md * c, axle]])


def c_full(a, heading, rate):
    md = a[2]
    s, c = np.sin(heading), np.cos(heading)
    return np.array([[0, 0, -md * rate * c], [0, 0, -md * rate * s], [0, 0, 0]])


def g_bar(state, offset):
    """ḡ of Eq. 11, with q̇ = ḡ u."""
    c, s = np.cos(state.heading_rad), np.sin(state.heading_rad)
    zeta3 = -(state.x_m - offset[0]) * s + (state.y_m - offset[1]) * c
    return np.array([[zeta3 * c, c], [zeta3 * s, s], [-1, 0]])


def m_bar(a, state, offset):
    g = g_bar(state, offset)
    return g.T @ m_full(a, state.heading_rad) @ g


def c_bar(a, state, offset):
    h = 1e-6
    g = g_bar(state, offset)
    g_dot = (g_bar(moved(state, h), offset) - g_bar(moved(state, -h), offset)) / (2 * h)
    m, c = m_full(a, state.heading_rad), c_full(a, state.heading_rad, state.turn_rate_radps)
    return g.T @ (m @ g_dot + c @ g)


def reference_torques(t, own, neighbours, about):
    """Eqs. 29-31 from matrices; η̇ by central differences along the motion of everybody."""
    h = 1e-5
    eta = eta_of(t, own, neighbours, about)
    shifted = [
        eta_of(
            t + d,
            moved(own, d),
            {r: (s + d, moved(q, d)) for r, (s, q) in neighbours.items()},
            about,
        )
        for d in (h, -h)
    ]
    eta_dot = (shifted[0] - shifted[1]) / (2 * h)
    offset, law, body = OFFSETS[about.robot], about.settings, about.body
    zeta3 = -(own.x_m - offset[0]) * np.sin(own.heading_rad) + (own.y_m - offset[1]) * np.cos(
        own.heading_rad
    )
    u = np.array([-own.turn_rate_radps, own.speed_mps + zeta3 * own.turn_rate_radps])
    error = u - eta
    # The regressor's columns: M̄ η̇ + C̄ η is linear in a (Property 4).
    y = np.array(
        [m_bar(e, own, offset) @ eta_dot + c_bar(e, own, offset) @ eta for e in np.eye(3)]
    ).T
    a_hat = np.array(parameters(body.mass_kg, body.inertia_kgm2, body.com_offset_m, 1.0))
    q = y.T @ error
    pi = body.robust_bound * q / (np.linalg.norm(q) + law.boundary_layer * np.exp(-law.gamma * t))
    k = law.feedback_gain * (
        np.eye(2) if law.feedback_shape == "identity" else m_bar(a_hat, own, offset)
    )
    _, z2, _, _, big_s = z_of(t, own, offset, law.beta, 1.0)
    wrench = -k @ error + y @ (a_hat - (pi if law.robust else 0.0)) - np.array([big_s, z2])
    g = g_bar(own, offset)
    half, radius = body.half_axle_m, body.wheel_radius_m
    c, s = np.cos(own.heading_rad), np.sin(own.heading_rad)
    b = np.array([[c, c], [s, s], [half, -half]]) / radius
    return np.linalg.solve(g.T @ b, wrench)


@given(
    times,
    states,
    states,
    states,
    st.floats(0, 2),
    st.sampled_from(["identity", "inertia"]),
    st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_torques_against_matrices(t, own, second, third, delay, shape, robust):
    about = situation(feedback_shape=shape, robust=robust)
    stamp_ns = [round(max(0.0, t - d) * 1e9) for d in (delay, 0.5 * delay)]
    heard = (Stamped(2, stamp_ns[0], second), Stamped(3, stamp_ns[1], third))
    now_ns = round(t * 1e9)
    found = CooperativeLaw(about).command(now_ns, own, heard)
    neighbours = {m.robot: (m.stamp_ns * 1e-9, m.state) for m in heard}
    expected = reference_torques(now_ns * 1e-9, own, neighbours, about)
    scale = 1.0 + float(np.abs(expected).max())
    np.testing.assert_allclose(found, expected, atol=2e-5 * scale)


@given(times, states, states, st.booleans())
@settings(max_examples=40, deadline=None)
def test_kinematic_command_against_eta(t, own, second, printed_delta):
    about = situation(level="kinematic", delta="printed" if printed_delta else "corrected")
    now_ns = round(t * 1e9)
    speed, rate = CooperativeLaw(about).command(now_ns, own, (Stamped(2, now_ns, second),))
    t = now_ns * 1e-9
    eta = eta_of(t, own, {2: (t, second)}, about, -1.0 if printed_delta else 1.0)
    zeta3 = z_of(t, own, OFFSETS[1], 1.5, 1.0)[2]
    assert rate == pytest.approx(-eta[0], rel=1e-9, abs=1e-9)
    assert speed == pytest.approx(eta[1] + zeta3 * eta[0], rel=1e-9, abs=1e-8)


@given(times, states, states, st.floats(0.5, 50.0))
@settings(max_examples=30, deadline=None)
def test_length_scale_is_a_change_of_units(t, own, second, scale):
    body = BodyEstimate(1.7, 0.6, 0.15, True, 0.8, 0.5, 0.2)
    about = situation(body=body, length_scale_m=scale)
    shrunk = replace(
        about,
        settings=about.settings.model_copy(update={"length_scale_m": 1.0}),
        offsets_m={r: (x / scale, y / scale) for r, (x, y) in OFFSETS.items()},
        body=replace(body, mass_kg=1.7 * scale**2, com_offset_m=0.15 / scale),
    )
    now_ns = round(t * 1e9)

    def small(state):
        return State(
            state.x_m / scale,
            state.y_m / scale,
            state.heading_rad,
            state.speed_mps / scale,
            state.turn_rate_radps,
        )

    right, left = CooperativeLaw(about).command(now_ns, own, (Stamped(2, now_ns, second),))
    r, el = CooperativeLaw(shrunk).command(now_ns, small(own), (Stamped(2, now_ns, small(second)),))
    # Yaw torque is the same; force times ℓ is the shrunk world's force.
    assert right - left == pytest.approx(r - el, rel=1e-9, abs=1e-9)
    assert (right + left) * scale == pytest.approx(r + el, rel=1e-9, abs=1e-7)


def test_memo_of_neighbours_does_not_go_stale():
    law, fresh = (CooperativeLaw(situation()) for _ in range(2))
    own, first, second = State(1, 2, 0.3, 0, 0), State(0, 1, 0, 1, 0), State(2, -1, 1, 0, 1)
    law.command(0, own, (Stamped(2, 0, first),))
    heard = (Stamped(2, 10, second),)
    assert law.command(20, own, heard) == fresh.command(20, own, heard)


# --- Lyapunov: the two corrections (docs/corrections.md) --------------------------------


def group(delta="corrected", **law):
    """Three kinematic robots on a path 1-2-3; robot 1 damped."""
    coupling = {1: {2: 1.3}, 2: {1: 1.3, 3: 0.6}, 3: {2: 0.6}}
    damping = {1: 0.7, 2: 0.0, 3: 0.0}
    return {
        robot: situation(
            robot=robot,
            coupling=coupling[robot],
            damping=damping[robot],
            delta=delta,
            level="kinematic",
            **law,
        )
        for robot in OFFSETS
    }


def lyapunov_rate(t_ns, placed, abouts):
    """V̇ of Eq. 22 along the kinematic closed loop, by chain rule on Eq. 8."""
    total, t = 0.0, t_ns * 1e-9
    for robot, about in abouts.items():
        own = placed[robot]
        heard = tuple(Stamped(i, t_ns, placed[i]) for i in sorted(about.coupling))
        speed, rate = CooperativeLaw(about).command(t_ns, own, heard)
        moving = State(*own[:3], speed, rate)
        h = 1e-6
        after, before = (
            np.array(z_of(t + d, moved(moving, d), OFFSETS[robot], 1.5, 1.0)[:3]) for d in (h, -h)
        )
        z = np.array(z_of(t, own, OFFSETS[robot], 1.5, 1.0)[:3])
        total += z @ (after - before) / (2 * h)
    return total


def claimed_rate(t_ns, placed, abouts):
    """V̇ as Theorem 2's proof states it."""
    t = t_ns * 1e-9
    beta = 1.5
    z = {r: z_of(t, placed[r], OFFSETS[r], beta, 1.0) for r in abouts}
    total = sum(-beta * w1_of(t) ** 2 * z[r][2] ** 2 for r in abouts)
    for robot, about in abouts.items():
        total -= about.damping * (z[robot][1] ** 2 + z[robot][4] ** 2)
        for other, b in about.coupling.items():
            total -= 0.5 * b * ((z[robot][1] - z[other][1]) ** 2 + (z[robot][4] - z[other][4]) ** 2)
    return total


@given(times, st.tuples(states, states, states))
@settings(max_examples=40, deadline=None)
def test_corrected_delta_gives_the_proof_s_rate_exactly(t, placed):
    placed = dict(zip(OFFSETS, placed, strict=True))
    t_ns = round(t * 1e9)
    rate, claimed = (f(t_ns, placed, group()) for f in (lyapunov_rate, claimed_rate))
    assert claimed <= 0.0
    assert rate == pytest.approx(claimed, rel=1e-5, abs=1e-4)


def test_printed_delta_makes_v_grow():
    """Far from the pattern the printed Eq. 19 gives V̇ > 0, the corrected one V̇ < 0."""
    placed = {
        1: State(-3.5, -13.8, -2.0, 0, 0),
        2: State(18.1, 3.3, 3.0, 0, 0),
        3: State(13.9, -25.3, 2.0, 0, 0),
    }
    assert lyapunov_rate(0, placed, group("printed")) > 1e3
    assert lyapunov_rate(0, placed, group("corrected")) < -1e3


def test_printed_cross_term_can_make_v_grow_and_the_compensated_one_cannot():
    """Without damping and with all robots alike, w1 z2 z3 is all that is left to grow."""
    heading, zeta2, zeta3 = -0.3, 1.0, 1.0
    c, s = np.cos(heading), np.sin(heading)
    placed = {
        r: State(p[0] + c * zeta2 - s * zeta3, p[1] + s * zeta2 + c * zeta3, heading, 0, 0)
        for r, p in OFFSETS.items()
    }
    weak = {"beta": 1.5}
    printed = {r: replace(a, damping=0.0) for r, a in group(cross_term="printed", **weak).items()}
    compensated = {r: replace(a, damping=0.0) for r, a in group(**weak).items()}
    assert lyapunov_rate(0, placed, printed) > 0.1
    assert lyapunov_rate(0, placed, compensated) < 0.0


@given(times, states, states)
@settings(max_examples=30, deadline=None)
def test_dynamic_law_gives_theorem_4_s_rate(t, first, second):
    """With exact estimates: V̇ of Eq. 34 = the kinematic rate − Σ ũᵀKũ, along the plant's own motion."""
    body = Body(1.7, 0.6 + 1.7 * 0.15**2, 0.15, 0.5, 0.2, np.inf, 0.0, 0.0, 0.0, 0.0)
    placed, t_ns = {1: first, 2: second}, round(t * 1e9)
    abouts = {
        r: situation(
            robot=r, coupling={3 - r: 1.3}, damping=0.7, robust=False, feedback_shape="identity"
        )
        for r in (1, 2)
    }
    a = parameters(1.7, 0.6, 0.15, 1.0)

    def tracking_error(t, here, robot):
        others = {i: (t, here[i]) for i in abouts[robot].coupling}
        own, offset = here[robot], OFFSETS[robot]
        zeta3 = z_of(t, own, offset, 1.5, 1.0)[2]
        u = np.array([-own.turn_rate_radps, own.speed_mps + zeta3 * own.turn_rate_radps])
        return u - eta_of(t, own, others, abouts[robot])

    def v(t, here):
        total = 0.0
        for robot in abouts:
            z = np.array(z_of(t, here[robot], OFFSETS[robot], 1.5, 1.0)[:3])
            e = tracking_error(t, here, robot)
            total += 0.5 * (z @ z + e @ m_bar(a, here[robot], OFFSETS[robot]) @ e)
        return total

    commands = {
        r: CooperativeLaw(about).command(
            t_ns, placed[r], tuple(Stamped(i, t_ns, placed[i]) for i in about.coupling)
        )
        for r, about in abouts.items()
    }
    t = t_ns * 1e-9
    h = 1e-6
    # Forward differences of the plant's own integrator, extrapolated to h = 0.
    slopes = []
    for step in (h, 2 * h):
        after = {r: driven(body, placed[r], *commands[r], step) for r in abouts}
        slopes.append((v(t + step, after) - v(t, placed)) / step)
    rate = 2 * slopes[0] - slopes[1]
    expected = claimed_rate(t_ns, placed, abouts)
    errors = [tracking_error(t, placed, r) for r in abouts]
    expected -= sum(3.0 * e @ e for e in errors)
    assert rate == pytest.approx(expected, rel=2e-3, abs=1e-2 * (1 + abs(v(t, placed)) ** 0.5))
