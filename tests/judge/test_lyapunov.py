"""V along runs: against the law's own η, against the proofs' rates, and what makes it rise."""

import numpy as np
import pytest
from in_process import collected

from formnet.agent.law import make
from formnet.formation.briefing.resolving import resolve
from formnet.formation.briefing.situation import parameters
from formnet.formation.scenario.loading import load
from formnet.formation.wire.state import Stamped, State
from formnet.lab.figures import run_figures as figures
from formnet.lab.judge import lyapunov
from formnet.lab.judge.rises import Rise, rises, standing_causes
from formnet.lab.runs.recording import Collected
from formnet.lab.verdict.model import judge

COMPENSATED = 'law.cross_term="compensated"'
EXACT = (
    COMPENSATED,
    "robot_defaults.mass_estimate_kg=1.0",
    "robot_defaults.inertia_estimate_kgm2=1.0",
)


def found_in(recording: Collected) -> tuple[lyapunov.Curve, list[Rise]]:
    curve = lyapunov.curve(recording)
    assert curve is not None
    return curve, rises(recording, curve, standing_causes(recording.scenario))


# --- against what the law itself makes of the same states -----------------------------


class Oracle:
    """V and −V̇ of Eqs. 40-44 at recorded instants, robot by robot, with η from the agent's law."""

    def __init__(self, recording: Collected, delay_samples: int) -> None:
        self.scenario = recording.scenario
        self.trajectories = recording.trajectories
        self.delay = delay_samples
        kinematic = self.scenario.law.model_copy(update={"level": "kinematic"})
        plan = resolve(self.scenario.model_copy(update={"law": kinematic}))
        self.laws = {robot: make(plan.situation(robot)) for robot in plan.ids}

    def state(self, robot: int, k: int) -> State:
        row = self.trajectories.states[k, self.scenario.ids.index(robot)]
        return State(*(float(value) for value in row))

    def z(self, robot: int, k: int) -> tuple[float, float, float, float]:
        """z1, z2, z3, S."""
        state, t = self.state(robot, k), float(self.trajectories.t_s[k])
        law = self.scenario.law
        offset = self.scenario.robots[self.scenario.ids.index(robot)].offset_m
        w = law.w1
        assert w.amplitude == 0.0
        dx, dy = state.x_m - offset[0], state.y_m - offset[1]
        c, s = np.cos(state.heading_rad), np.sin(state.heading_rad)
        zeta2, z3 = (dx * c + dy * s) / law.length_scale_m, (dy * c - dx * s) / law.length_scale_m
        z1, z2 = -state.heading_rad - w.bias * t, zeta2 + law.beta * w.bias * z3
        return z1, z2, z3, z1 + z2 * law.beta * w.bias * zeta2 + z3 * zeta2

    def u_tilde(self, robot: int, k: int) -> np.ndarray:
        """ũ = u − η in Eq. 8's coordinates."""
        t_ns = self.trajectories.t_ns
        heard = tuple(
            Stamped(other, int(t_ns[k - self.delay]), self.state(other, k - self.delay))
            for other in self.scenario.neighbours_of[robot]
        )
        state = self.state(robot, k)
        speed, turn_rate = self.laws[robot].command(int(t_ns[k]), state, heard)
        scale, z3 = self.scenario.law.length_scale_m, self.z(robot, k)[2]
        first = -(state.turn_rate_radps - turn_rate)
        return np.array([first, (state.speed_mps - speed) / scale - z3 * first])

    def inertia(self, robot: int, k: int, *, believed: bool = False) -> np.ndarray:
        """M̄ for u of Eq. 8."""
        vehicle = self.scenario.vehicles[robot]
        values = vehicle.estimate() if believed else vehicle.truth()
        a = parameters(*values, self.scenario.law.length_scale_m)
        to_body = np.array([[self.z(robot, k)[2], 1.0], [-1.0, 0.0]])  # (v, ω) from u
        return to_body.T @ np.diag(a[:2]) @ to_body

    def v(self, k: int) -> float:
        total = 0.0
        for robot in self.scenario.ids:
            z1, z2, z3, _ = self.z(robot, k)
            e = self.u_tilde(robot, k)
            total += 0.5 * (z1**2 + z2**2 + z3**2)
            if self.scenario.law.level == "dynamic":
                total += 0.5 * e @ self.inertia(robot, k) @ e
            for other in self.scenario.neighbours_of[robot]:
                history = [self.z(other, i) for i in range(k - self.delay, k + 1)]
                squares = [s**2 + z2**2 for _, z2, _, s in history]
                step_s = self.scenario.clock.broadcast_period_s
                total += 0.5 * self.b(robot, other) * float(np.trapezoid(squares, dx=step_s))
        return total

    def dissipation(self, k: int) -> float:
        """−V̇ with exact parameters and the compensated cross term (Eqs. 41, 44)."""
        law, total = self.scenario.law, 0.0
        for robot in self.scenario.ids:
            _, z2, z3, s = self.z(robot, k)
            total += law.beta * law.w1.bias**2 * z3**2
            total += self.scenario.vehicles[robot].damping * (s**2 + z2**2)
            if law.level == "dynamic":
                e = self.u_tilde(robot, k)
                total += law.feedback_gain * e @ self.inertia(robot, k, believed=True) @ e
            for other in self.scenario.neighbours_of[robot]:
                _, other_z2, _, other_s = self.z(other, k - self.delay)
                gap = (s - other_s) ** 2 + (z2 - other_z2) ** 2
                total += 0.5 * self.b(robot, other) * gap
        return total

    def b(self, first: int, second: int) -> float:
        return self.scenario.formation.weights[min(first, second), max(first, second)]


@pytest.mark.parametrize("delay_s", [0.0, 0.02])
@pytest.mark.parametrize("name", ["theorem2", "theorem4"])
def test_v_and_its_rate_are_those_of_the_proofs(paper, name, delay_s):
    scenario = paper(
        name,
        *EXACT,
        f"network.default.delay.mean_s={delay_s}",
        "duration_s=0.3",
        "clock.control_period_s=0.0005",
        "clock.broadcast_period_s=0.0005",
    )
    recording = collected(scenario)
    curve, rises = found_in(recording)
    assert rises == []
    oracle = Oracle(recording, round(delay_s / 0.0005))
    for k in (100, 333, 590):
        assert curve.whole[k]
        assert curve.v[k] == pytest.approx(oracle.v(k), rel=2e-5)
    lost = 0.0005 * np.trapezoid([oracle.dissipation(k) for k in range(400, 601)])
    assert curve.v[400] - curve.v[600] == pytest.approx(lost, rel=0.01)


# --- what never rises -----------------------------------------------------------------


@pytest.mark.parametrize("name", ["theorem1", "theorem2", "theorem5"])
def test_kinematic_v_never_rises(paper, name):
    scenario = paper(name, COMPENSATED, "duration_s=15", "expect.lyapunov=true")
    judged = judge(collected(scenario), mode="inline", wall_s=1.0)
    assert judged.lyapunov.may_rise_by == []
    assert judged.lyapunov.rises == []
    assert judged.claims["lyapunov"].holds is True
    assert judged.lyapunov.budget < 0.2 * judged.lyapunov.initial


@pytest.mark.parametrize(
    ("name", "equation"), [("theorem3", 34), ("theorem4", 34), ("theorem6", 43)]
)
def test_dynamic_v_never_rises(paper, name, equation):
    scenario = paper(name, *EXACT, "duration_s=15", "expect.lyapunov=true")
    judged = judge(collected(scenario), mode="inline", wall_s=1.0)
    assert judged.lyapunov.equation == equation
    assert judged.lyapunov.may_rise_by == []
    assert judged.lyapunov.rises == []
    assert judged.claims["lyapunov"].holds is True
    assert judged.lyapunov.budget < judged.lyapunov.initial


@pytest.mark.parametrize("delay_s", [0.007, 0.05, 0.3, 1.0])
def test_no_constant_delay_makes_it_rise(paper, delay_s):
    name = f"network.default.delay.mean_s={delay_s}"
    _, rises = found_in(collected(paper("section5-delay", *EXACT, name, "duration_s=15")))
    assert rises == []


def test_fixed_playout_makes_random_delay_constant(paper):
    noisy = 'network.default.delay={distribution="uniform",low_s=0.02,high_s=0.18}'
    fixed = ("network.default.playout_s=0.2",)
    _, latest = found_in(collected(paper("section5-delay", *EXACT, noisy, "duration_s=10")))
    _, constant = found_in(
        collected(paper("section5-delay", *EXACT, noisy, *fixed, "duration_s=10"))
    )
    assert latest
    assert all(rise.causes == ["variable delay"] for rise in latest)
    assert constant == []


# --- what does, and why ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("overrides", "cause"),
    [
        (['law.delta="printed"'], "Δ of the sign printed in Eq. 19 (law.delta)"),
        (
            ["law.robust=false", "robot_defaults.mass_estimate_kg=4.0"],
            "the estimates of robot 1 are wrong and law.robust is off",
        ),
        (
            ["robot_defaults.disturbance_force_n=3000"],
            "disturbance_force_n is not part of Eq. 7's model",
        ),
    ],
)
def test_a_standing_cause_is_named(paper, overrides, cause):
    _, rises = found_in(collected(paper("theorem4", *EXACT, *overrides, "duration_s=6")))
    assert rises
    assert all(rise.causes == [cause] for rise in rises)


def test_the_printed_cross_term_can_make_it_rise(paper):
    """Theorem 3's μ = 0 leaves nothing that outweighs w1 z2 z3 once the robots agree."""
    scenario = paper("theorem1", "law.beta=0.2", "duration_s=30")
    _, rises = found_in(collected(scenario))
    assert rises
    assert "the term w1 z2 z3 that the proofs drop (law.cross_term)" in rises[0].causes
    _, none = found_in(collected(paper("theorem1", "law.beta=0.2", "duration_s=30", COMPENSATED)))
    assert none == []


def test_faults_and_losses_are_named(paper):
    killed = 'timeline=[{at_s=3.0, action="kill", robots=2, restart_after_s=3.0}]'
    _, rises = found_in(collected(paper("section5-delay", *EXACT, killed, "duration_s=12")))
    assert [(rise.causes, rise.begin_s) for rise in rises] == [
        (["kill 2 at 3 s"], pytest.approx(2.99)),
        (["restart 2 at 6 s"], pytest.approx(5.99, abs=0.02)),
    ]
    cut = 'timeline=[{at_s=3.0, action="cut", links=[[1, 2]], heal_after_s=3.0}]'
    _, rises = found_in(collected(paper("section5-delay", *EXACT, cut, "duration_s=12")))
    assert rises
    assert all(3.0 <= rise.begin_s <= 7.0 for rise in rises)
    assert all(any("cut" in cause or "loss" in cause for cause in rise.causes) for rise in rises)


def test_a_rise_fails_the_claim_and_is_drawn(paper, tmp_path):
    killed = 'timeline=[{at_s=1.0, action="kill", robots=2}]'
    recording = collected(
        paper("section5-delay", *EXACT, killed, "duration_s=3", "expect={lyapunov=true}")
    )
    judged = judge(recording, mode="inline", wall_s=1.0)
    assert judged.claims["lyapunov"].holds is False
    assert not judged.passed
    _, rises = found_in(recording)
    axes = figures.lyapunov(recording, lyapunov.curves(recording)).axes[0]
    assert rises
    assert "V gains more" in axes.get_legend_handles_labels()[1]


def test_without_the_paper_s_law_or_samples_there_is_no_v(paper):
    assert lyapunov.curve(Collected(paper("theorem4"))) is None
    nobody = Collected(paper("theorem4"))
    judged_law = nobody.scenario.law.model_copy(update={"kind": "another"})
    other = collected(paper("theorem4", "duration_s=0.1"))
    other.scenario = other.scenario.model_copy(update={"law": judged_law})
    assert lyapunov.curve(other) is None


def test_no_budget_of_what_follows_hides_what_a_fault_does(root):
    """Robots that come back bring their share of V, and their sampling begins only then."""
    file = root / "configs" / "faults" / "every-fault.toml"
    recording = collected(load(file, ["duration_s=8.5", COMPENSATED]))
    curve, rises = found_in(recording)
    causes = {cause for rise in rises for cause in rise.causes}
    assert {"restart 1, 4 at 5 s", "restart 1 at 7 s", "restart 1, 2, 3, 4, 5 at 8.25 s"} <= causes
    nobody = (curve.t_s >= 8.0) & (curve.t_s < 8.25)
    assert (curve.v[nobody] == 0.0).all()
    assert (curve.v[~nobody] > 0.0).all()
    axes = figures.lyapunov(recording, lyapunov.curves(recording)).axes[0]
    assert axes.get_ylim()[0] > 1e-6  # where nobody is up nothing is drawn
