"""The leader-follower baseline: what it linearises, its rates, its tree, and Remark 9's comparison."""

from math import atan2, hypot

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from in_process import collected

from formnet.agent.law import accepts
from formnet.agent.leader_follower import LeaderFollowerLaw
from formnet.formation.briefing.resolving import resolve
from formnet.formation.briefing.situation import BodyEstimate, Situation
from formnet.formation.scenario.law import LawSettings
from formnet.formation.scenario.loading import ScenarioError, load
from formnet.formation.wire.state import Stamped, State
from formnet.lab.verdict.model import judge
from formnet.plant.body import steered

OFFSETS = {1: (0.0, 0.0), 2: (-3.0, 2.0), 3: (-3.0, -2.0)}
FOLLOWS = {"2": 1, "3": 1}
REACH_M, GAINS = 0.7, (0.9, 1.4)
number = st.floats(-5.0, 5.0)
states = st.builds(State, number, number, number, number, number)
times = st.floats(0.0, 20.0)


def law(robot: int, level: str = "kinematic", **parameters: object) -> LeaderFollowerLaw:
    values = {
        "follows": FOLLOWS,
        "separation_gain": GAINS[0],
        "bearing_gain": GAINS[1],
        "reach_m": REACH_M,
    }
    settings = LawSettings.model_validate(
        {"kind": "leader_follower", "level": level, "parameters": values | parameters}
    )
    return LeaderFollowerLaw(
        Situation(
            robot=robot,
            settings=settings,
            control_period_s=0.01,
            offsets_m=OFFSETS,
            coupling={1: 1.0} if robot > 1 else {2: 1.0, 3: 1.0},
            damping=0.0,
            body=BodyEstimate(1.0, 1.0, 0.0, False, 0.0, 0.5, 0.2),
        )
    )


def polar(own: State, leader: State) -> tuple[float, float]:
    """l and ψ of the point ahead of the follower's axle, seen from the leader."""
    x = own.x_m + REACH_M * np.cos(own.heading_rad) - leader.x_m
    y = own.y_m + REACH_M * np.sin(own.heading_rad) - leader.y_m
    return hypot(x, y), atan2(y, x) - leader.heading_rad


def wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


@given(states, states)
def test_separation_and_bearing_close_exponentially(own, leader):
    distance, bearing = polar(own, leader)
    assume(distance > 0.3)
    speed, turn_rate = law(2).command(0, own, (Stamped(1, 0, leader),))
    h = 1e-6
    after = polar(
        steered(own, speed, turn_rate, h),
        steered(leader, leader.speed_mps, leader.turn_rate_radps, h),
    )
    wanted = hypot(-3.0 + REACH_M, 2.0), atan2(2.0, -3.0 + REACH_M)
    gap = wrapped(wanted[1] - bearing)
    assume(abs(gap) < 3.1)
    assert (after[0] - distance) / h == pytest.approx(GAINS[0] * (wanted[0] - distance), abs=2e-3)
    assert wrapped(after[1] - bearing) / h == pytest.approx(GAINS[1] * gap, abs=2e-3)


@given(states, states)
def test_rates_are_those_of_the_velocities(own, leader):
    assume(polar(own, leader)[0] > 0.3)
    follower, h = law(2), 1e-5

    def after(t: float) -> tuple[float, float, float, float]:
        return follower._velocities(
            steered(own, own.speed_mps, own.turn_rate_radps, t),
            steered(leader, leader.speed_mps, leader.turn_rate_radps, t),
        )

    back, now, forth = after(-h), after(0.0), after(h)
    assume(max(abs(forth[0] - back[0]), abs(forth[1] - back[1])) < 1.0)  # bearing wraps at ±π
    for rate, before, behind in ((now[2], back[0], forth[0]), (now[3], back[1], forth[1])):
        assert rate == pytest.approx((behind - before) / (2 * h), rel=1e-4, abs=1e-3)


@given(times)
def test_in_the_pattern_everybody_drives_on_alike(t):
    first = State(t, 0.0, 0.0, 1.0, 0.0)
    assert law(1).command(round(t * 1e9), first, ()) == pytest.approx((1.0, 0.0), abs=1e-6)
    follower = State(t - 3.0, 2.0, 0.0, 1.0, 0.0)
    heard = (Stamped(1, 0, first),)
    assert law(2).command(0, follower, heard) == pytest.approx((1.0, 0.0), abs=1e-6)
    assert law(2, "dynamic").command(0, follower, heard) == pytest.approx((0.0, 0.0), abs=1e-6)


@given(states)
def test_who_hears_no_leader_stands_still(own):
    assert law(2).command(0, own, ()) == (0.0, 0.0)
    at_rest = own._replace(speed_mps=0.0, turn_rate_radps=0.0)
    assert law(3, "dynamic").command(0, at_rest, (Stamped(2, 0, own),)) == (0.0, 0.0)


def test_a_leader_on_the_same_spot_is_no_division_by_zero():
    own = State(-REACH_M, 0.0, 0.0, 0.0, 0.0)
    command = law(2).command(0, own, (Stamped(1, 0, State(0.0, 0.0, 0.0, 0.0, 0.0)),))
    assert np.isfinite(command).all()


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"follows": {"2": 1}}, "must name every robot but one"),
        ({"follows": {"1": 2, "2": 3, "3": 1}}, "must name every robot but one"),
        ({"follows": {"1": 2, "2": 1}}, "goes round in a circle"),
        ({"follows": {"2": 1, "3": 7}}, "names 7, which is no robot"),
        ({"follows": {"2": 1, "x": 1}}, "which is no robot"),
        ({"follows": {"2": 1, "03": 1}}, "which is no robot"),
        ({"follows": {"2": 1, "٣": 1}}, "which is no robot"),
        ({"follows": {"3": 1, "2": 3}}, "follows robot 3, which is not its neighbour"),
        ({"reach_m": 0.0}, "reach_m = 0.0: must be greater than 0"),
        ({"speed": 1.0}, "speed = 1.0: unknown key"),
    ],
)
def test_a_bad_tree_or_parameter_is_refused(parameters, said):
    with pytest.raises(ValueError, match=said.replace("(", r"\(")):
        law(2, **parameters)


def scenario(root, *overrides):
    return load(root / "configs" / "faults" / "leader-follower.toml", overrides)


def test_a_scenario_with_a_bad_tree_says_so(root):
    bad = scenario(root, 'law.parameters.follows={ "1" = 5, "2" = 4, "3" = 4, "4" = 5 }')
    assert "robot 2 follows robot 4, which is not its neighbour" in (accepts(resolve(bad)) or "")
    with pytest.raises(ScenarioError):
        scenario(root, "law.parameters=3")


@pytest.mark.long
@pytest.mark.parametrize(
    ("robot", "at_s", "holds"),
    [(None, 0.0, True), (5, 2.0, False), (1, 2.0, False), (4, 10.0, False), (2, 2.0, True)],
)
def test_it_fails_with_its_leaders_and_not_with_a_leaf(root, robot, at_s, holds):
    """Remark 9: without its leader a follower has nothing to go by; robots 2 and 3 lead nobody."""
    plan = [] if robot is None else [f'timeline=[{{at_s={at_s}, action="kill", robots={robot}}}]']
    recording = collected(scenario(root, *plan))
    judged = judge(recording, mode="inline", wall_s=1.0)
    assert judged.outcome.kind == "completed"
    assert judged.claims["formation"].observed is holds
    assert judged.lyapunov is None
