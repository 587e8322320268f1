"""A run's plan: what it is made of, that it travels to the bit, and what is no plan."""

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from formnet.formation.briefing.plan import BadBrief, Plan, RobotPlan
from formnet.formation.briefing.resolving import resolve
from formnet.formation.scenario.loading import ScenarioError, load
from formnet.lab.scenarios.packaged import CONFIGS

SCENARIOS = sorted(
    path.relative_to(CONFIGS).as_posix()
    for path in CONFIGS.rglob("*.toml")
    if "[[robots]]" in path.read_text(encoding="utf-8")
)
RICH = CONFIGS / "network" / "every-action.toml"


@pytest.mark.parametrize("name", SCENARIOS)
def test_what_travels_is_what_was_resolved(name):
    plan = resolve(load(CONFIGS / name))
    assert Plan.unpack(plan.pack()) == plan
    for robot in plan.ids:
        assert RobotPlan.unpack(plan.robot(robot).pack()) == plan.robot(robot)


@given(
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(min_value=5e-324, allow_nan=False, allow_infinity=False),
    st.integers(min_value=0, max_value=2**63 - 1),
)
def test_numbers_travel_to_the_bit(x_m, beta, seed):
    plan = resolve(load(RICH, {"robots.1.start.x_m": x_m, "law.beta": beta, "seed": seed}))
    again = Plan.unpack(plan.pack())
    assert again.starts[1].x_m.hex() == x_m.hex()
    told = RobotPlan.unpack(again.robot(1).pack())
    assert (told.situation.settings.beta.hex(), told.seed) == (beta.hex(), seed)


def test_a_robot_is_told_nothing_of_bodies_and_of_links_that_are_not_its_own():
    """The true mass stays in the plant; so does who is down where it cannot be heard."""
    scenario = load(
        CONFIGS / "paper" / "section5.toml",
        {
            "formation.edges": [[1, 2], [2, 3], [3, 4], [4, 5]],
            "robots.1.mass_kg": 123.456,
            "robots.1.mass_estimate_kg": 7.0,
            "robots.1.robust_bound": 1.0,
            "timeline": [{"action": "kill", "at_s": 1.0, "robots": [1, 3]}],
        },
    )
    told = resolve(scenario).robot(1)
    assert "123.456" not in told.pack()
    assert told.situation.body.mass_kg == 7.0
    assert told.neighbours == [2]
    assert set(told.spans) == {1}
    assert {link.destination for link in told.links} == {1}


def test_a_table_that_links_share_travels_once():
    """A measured delay of 1000 samples on 10 links is 1000 numbers, not 10,000."""
    samples = [0.001 * k for k in range(1000)]
    delay = {"distribution": "empirical", "samples_s": samples}
    scenario = load(CONFIGS / "paper" / "section5.toml", {"network.default.delay": delay})
    plan = resolve(scenario)
    assert len(plan.links) == 10
    assert len(plan.settings) == 1
    assert plan.robot(1).pack().count("0.777") == 1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda data: data.pop("seed"), "seed: Field required"),
        (lambda data: data.update(more=1), "more: Unexpected keyword argument"),
        (lambda data: data.update(robot="1"), "robot: Input should be a valid integer"),
        (lambda data: data["clock"].update(control_period_s=-1.0), "clock.control_period_s: "),
        (lambda data: data["settings"][0].update(loss={"model": "no"}), "settings[0].loss: "),
        (lambda data: data["actions"][0].__setitem__(1, {"parameter": 3}), "actions[0]"),
    ],
)
def test_what_is_no_plan_is_refused_with_its_place(change, said):
    data = json.loads(resolve(load(RICH)).robot(1).pack())
    change(data)
    with pytest.raises(BadBrief) as refused:
        RobotPlan.unpack(json.dumps(data))
    assert str(refused.value).startswith(said)


@given(st.data())
def test_a_mutilated_plan_is_refused_or_is_one(data):
    text = resolve(load(RICH)).robot(1).pack()
    where = data.draw(st.integers(0, len(text) - 1))
    length = data.draw(st.integers(0, 40))
    new = data.draw(st.text(st.sampled_from('{}[]",:0123456789.eE-+truefalsn \x00é'), max_size=8))
    try:
        found = RobotPlan.unpack(text[:where] + new + text[where + length :])
    except BadBrief:
        return
    assert isinstance(found, RobotPlan)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", "[" * 100_000, "9" * 5000])
def test_what_is_no_json_is_no_plan(text):
    with pytest.raises(BadBrief):
        Plan.unpack(text)


@pytest.mark.parametrize(
    ("raw", "place"),
    [
        ("{a = inf}", "a = inf"),
        ("{a = [1, {b = nan}]}", r"a\[1\].b = nan"),
        ("{d = 2026-01-01}", "d = "),
    ],
)
def test_a_law_s_parameter_that_cannot_travel_is_refused(raw, place):
    with pytest.raises(ScenarioError, match=f"law.parameters.*: {place}"):
        load(RICH, [f"law.parameters={raw}"])


def test_a_law_s_parameters_travel_as_they_are():
    parameters = {"a": 1, "b": 1.0, "c": [True, "x", {"d": -0.0}], "e": 2**70}
    plan = resolve(load(RICH, {"law.parameters": parameters}))
    told = RobotPlan.unpack(plan.robot(1).pack()).situation.settings.parameters
    assert told == parameters
    assert [type(told[key]) for key in "abe"] == [int, float, int]
    assert math.copysign(1.0, told["c"][2]["d"]) == -1.0


def test_every_number_of_the_plan_s_actions_and_settings_is_there():
    plan = resolve(load(RICH))
    for link in plan.links:
        assert 0 <= link.settings < len(plan.settings)
        assert all(0 <= number < len(plan.actions) for number in link.actions)
    assert Path(RICH).is_file()
