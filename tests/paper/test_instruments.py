"""V and V* of lab/judge, and the rates that they have under the law, against SymPy's."""

import numpy as np
import pytest
import sympy as sp

from formnet.lab.judge import lyapunov, star
from formnet.lab.judge.closed_loop import ClosedLoop
from formnet.lab.judge.windows import windowed
from formnet.lab.runs.recording import Collected, Trajectories

SEED = 20
PERIOD_NS = 10_000_000


class Standing(Trajectories):
    """Random states at instants of a run that never was."""

    def __init__(self, count, robots, rng):
        self.t_ns = PERIOD_NS * np.arange(count, dtype=np.int64)
        self.t_s = self.t_ns / 1e9
        self.states = rng.uniform(-3.0, 3.0, (count, robots, 5))


def symbolic():
    """Eq. 8's variables of one robot as functions of x − p, y − p, θ (in the law's units), by SymPy."""
    x, y, theta, integral, beta, w = sp.symbols("x y theta integral beta w", real=True)
    zeta2 = x * sp.cos(theta) + y * sp.sin(theta)
    z3 = y * sp.cos(theta) - x * sp.sin(theta)
    z1, z2 = -theta - integral, zeta2 + beta * w * z3
    s = z1 + (z2 * beta * w + z3) * zeta2
    return sp.lambdify((x, y, theta, integral, beta, w), (z1, z2, z3, s, zeta2))


def quadratic():
    """V, V*, V̇ and V̇* of five robots as the identities have them (N, its inverse, and columns)."""
    size = 5
    n, inverse = sp.MatrixSymbol("N", size, size), sp.MatrixSymbol("I", size, size)
    z1, z2, z3, s, zeta2 = (sp.MatrixSymbol(k, size, 1) for k in ("a", "b", "c", "s", "h"))
    beta, w = sp.symbols("beta w", real=True)
    v = (z1.T * z1 + z2.T * z2 + z3.T * z3) / 2
    v_star = v + zeta2.T * inverse * zeta2 / (2 * beta)
    rate = -s.T * n * s - z2.T * n * z2 - beta * w**2 * z3.T * z3
    printed = rate + w * z2.T * z3
    fall = -s.T * n * s - z2.T * n * z2 - zeta2.T * zeta2 / beta
    fall -= w**2 * zeta2.T * inverse * zeta2
    return sp.lambdify(
        (n, inverse, z1, z2, z3, s, zeta2, beta, w), (v, v_star, printed, rate, fall), "numpy"
    )


@pytest.mark.parametrize("cross_term", ["printed", "compensated"])
def test_v_and_v_star_and_their_rates_are_those_of_the_identities(paper, cross_term, monkeypatch):
    rng = np.random.default_rng(SEED)
    print(f"seed {SEED}")
    scenario = paper("theorem2", "law.beta=0.7", f"law.cross_term={cross_term}")
    trajectories = Standing(40, 5, rng)
    trajectories.states[..., :2] *= scenario.law.length_scale_m
    recording = Collected(scenario)
    # As the law drives them: speeds and turn rates that make u = η at every instant.
    eta = ClosedLoop(recording, trajectories).eta()
    z3 = ClosedLoop(recording, trajectories).robots.z3
    trajectories.states[..., 4] = -eta.first
    trajectories.states[..., 3] = (eta.second + z3 * eta.first) * scenario.law.length_scale_m
    loop = ClosedLoop(recording, trajectories)
    lean = star.lean(loop)
    monkeypatch.setattr(Collected, "trajectories", trajectories)
    curves = lyapunov.curves(recording)
    assert (curves.star is None) == (cross_term == "compensated")

    matrix = np.diag(loop.damping)
    for link in loop.links:
        matrix[link.destination, link.destination] += link.weight
        matrix[link.destination, link.source] -= link.weight
    of_robot, of_group = symbolic(), quadratic()
    law = scenario.law
    scale, beta, w = law.length_scale_m, law.beta, law.w1.bias
    for k, t_s in enumerate(loop.t_s):
        places = (trajectories.states[k, :, :2] - scenario.offsets_m) / scale
        columns = of_robot(*places.T, trajectories.states[k, :, 2], w * t_s, beta, w)
        columns = [np.reshape(values, (5, 1)) for values in columns]
        v, v_star, printed, compensated, fall = (
            float(np.squeeze(value))
            for value in of_group(matrix, np.linalg.inv(matrix), *columns, beta, w)
        )
        assert curves.v.v[k] == pytest.approx(v, rel=1e-12)
        r = loop.robots
        rate = r.z1[k] @ (r.u1[k] - w) + r.z2[k] @ r.z2_dot[k] + r.z3[k] @ r.z3_dot[k]
        expected = printed if cross_term == "printed" else compensated
        assert rate == pytest.approx(expected, rel=1e-9)
        if curves.star is not None:
            assert curves.star.v[k] == pytest.approx(v_star, rel=1e-12)
            assert rate + lean[k] @ r.u2[k] == pytest.approx(fall, rel=1e-9)
            assert fall < 0.0


def test_a_windowed_integral_keeps_what_is_small():
    """exp(−t), whose integral over the last second is exp(−t) (e − 1), down to 1e-22."""
    t_s = np.arange(0.0, 50.0, 0.01)
    values = np.exp(-t_s)
    found = windowed(t_s, values, -values, 1.0)
    late = t_s >= 1.0
    assert found[late] == pytest.approx(values[late] * (np.e - 1.0), rel=1e-10, abs=0.0)
    assert found[~late] == pytest.approx(1.0 - values[~late], rel=1e-9, abs=1e-12)


def test_a_windowed_integral_begins_between_instants():
    t_s = np.arange(0.0, 9.0, 0.1)
    found = windowed(t_s, t_s**2, 2.0 * t_s, 0.777)
    begin = np.maximum(t_s - 0.777, 0.0)
    assert found == pytest.approx((t_s**3 - begin**3) / 3.0, rel=1e-12, abs=1e-12)
