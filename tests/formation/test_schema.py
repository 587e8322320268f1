"""The JSON Schema of scenarios: complete, as strict as the loader, and its copies up to date."""

import copy
import json
import tomllib

import jsonschema
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from formnet.formation.scenario.model import Scenario
from formnet.lab.cli import main
from formnet.lab.schemas.common import UNITS, markdown
from formnet.lab.schemas.scenario import FILE, scenario_schema
from formnet.lab.schemas.scenario_page import reference

SCHEMA = scenario_schema()
CHECK = jsonschema.Draft202012Validator(SCHEMA)

RICH = tomllib.loads(
    """
name = "rich"
description = "every table and every kind"
seed = 3
duration_s = 30
[clock]
mode = "realtime"
control_period_s = 0.01
broadcast_period_s = 0.02
[formation]
edges = [[1, 2], [2, 3]]
coupling = { "1-2" = 2, "3-2" = 0.5 }
[law]
kind = "mine"
parameters = { anything = [1, { goes = true }] }
w1 = { bias = 0.5, amplitude = 0.1, frequency_radps = 2 }
[network.default]
preset = "wifi"
delay = { mean_s = 0.004 }
loss = { p = 0.01 }
slots = { min_s = 0.001, max_s = 0.002 }
[[network.links]]
from = 1
to = "*"
both_ways = true
preset = "lte"
delay = { distribution = "uniform", low_s = 0.1, high_s = 0.2, correlation = 0.5 }
loss = { probability = 0.5 }
[[network.links]]
from = [1, 2]
to = 3
delay = { distribution = "trace", times_s = [0.0, 1.0], delays_s = [0.1, 0.2], period_s = 2.0 }
loss = { model = "four_state", p13 = 0.1 }
rate = { bits_per_s = 1000 }
[[network.links]]
from = 2
to = 3
delay = { distribution = "empirical", samples_s = [0.1, 0.2] }
loss = { model = "trace", losses = [0, 1] }
[neighbours]
on_silence = "hold"
[plant]
body_on_failure = "coast"
[run]
patience_s = 5
[robot_defaults]
mass_kg = 12.0
com_offset_estimate_m = 0.1
[[timeline]]
at_s = 1
action = "network"
links = [[1, 2], ["*", [2, 3]]]
delay = { mean_s = 0.2 }
keep_order = false
[[timeline]]
at_s = 2
action = "ramp"
parameter = "delay.mean_s"
from_value = 0.1
to_value = 1
duration_s = 3
[[timeline]]
at_s = 3
action = "cut"
links = "*"
in_flight = "lost"
heal_after_s = 1.5
[[timeline]]
at_s = 4
action = "heal"
[[timeline]]
at_s = 5
action = "partition"
groups = [[1], [2, 3]]
[[timeline]]
at_s = 6
action = "kill"
robots = { random = 1 }
restart_after_s = 1
[[timeline]]
at_s = 9
action = "pause"
robots = [1, 2]
resume_after_s = 1
[[robots]]
id = 1
offset_m = [0, 1.5]
start = { x_m = 0, y_m = 1, heading_rad = -2 }
damping = 1
wheel_torque_limit_nm = 5.0
[[robots]]
id = 2
offset_m = [1, 0]
start = { x_m = 0, y_m = 1 }
[[robots]]
id = 3
offset_m = [2, 0]
start = { x_m = 0, y_m = 1 }
[expect]
formation = true
lyapunov = false
window_s = 1.0
"""
)


def loader_s_errors(data):
    """The kinds of what the models find wrong with a file.

    What does not fit a preset counts as what must fit together: a value_error.
    """
    try:
        Scenario.model_validate(data, context={})
    except ValidationError as error:
        return {
            "value_error" if beside_a_preset(data, item["loc"]) else item["type"]
            for item in error.errors()
        }
    return set()


def beside_a_preset(data, loc):
    """Whether ``loc`` is in the delay or the loss of a table with a preset."""
    for part in loc:
        if isinstance(data, dict) and "preset" in data and part in ("delay", "loss"):
            return True
        inside = isinstance(data, dict) or (isinstance(data, list) and isinstance(part, int))
        if inside and part in (data if isinstance(data, dict) else range(len(data))):
            data = data[part]
    return False


def paths(node, place=()):
    """Every place in a file, inner ones too."""
    items = (
        node.items()
        if isinstance(node, dict)
        else enumerate(node)
        if isinstance(node, list)
        else ()
    )
    for key, value in items:
        yield (*place, key)
        yield from paths(value, (*place, key))


def at(data, place):
    for part in place:
        data = data[part]
    return data


def shipped(root):
    found = sorted((root / "configs").rglob("*.toml"))
    return [path for path in found if path.name != "wifi.toml"]  # the bridge's


def test_it_is_a_schema_of_its_dialect():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert SCHEMA["$schema"] == "https://json-schema.org/draft/2020-12/schema"


def test_shipped_scenarios_are_valid_and_name_the_schema(root):
    files = shipped(root)
    assert len(files) >= 12
    for path in files:
        text = path.read_text(encoding="utf-8")
        assert [error.message for error in CHECK.iter_errors(tomllib.loads(text))] == [], path
        directive, _, where = text.partition("\n")[0].partition(" ")
        assert directive == "#:schema"
        assert (path.parent / where).resolve() == root / "configs" / FILE


def test_the_committed_copies_are_what_the_code_says(root):
    """If this fails: make reference."""
    assert json.loads((root / "configs" / FILE).read_text(encoding="utf-8")) == SCHEMA
    assert (root / "docs" / "scenario.md").read_text(encoding="utf-8") == reference()


def tables():
    yield "top", SCHEMA
    yield from SCHEMA["$defs"].items()


def test_every_key_is_described_with_its_unit_and_no_other_is_allowed():
    for name, table in tables():
        assert table["additionalProperties"] is False, name
        for key, entry in table["properties"].items():
            inner = SCHEMA["$defs"][entry["$ref"].rpartition("/")[2]] if "$ref" in entry else entry
            text = entry.get("description") or inner.get("description", "")
            assert text, f"{name}.{key}"
            assert "``" not in text
            assert ":class:" not in text
            for end, unit in UNITS.items():
                if key.endswith(end):
                    assert entry["unit"] == unit
                    break


def test_every_default_of_a_value_is_there():
    """Against the models themselves."""
    found = {
        key: entry.get("default")
        for key, entry in SCHEMA["$defs"]["LawSettings"]["properties"].items()
    }
    assert found["beta"] == 10.0
    assert found["robust"] is True
    assert found["delta"] == "corrected"
    assert "default" not in SCHEMA["$defs"]["Vehicle"]["properties"]["mass_estimate_kg"]


def test_the_rich_file_is_well_for_both():
    assert [error.message for error in CHECK.iter_errors(RICH)] == []
    assert loader_s_errors(RICH) == set()


WRONG = st.sampled_from(
    ["x", "*", -1, 0, 7, 1.5, 1e13 + 0.5, True, [], [1], [1, 2, 3], {}, {"x": 1}, {"random": 0}]
)
PLACES = sorted(paths(RICH), key=str)


# In Python true is 1, so the loader takes it in ``losses``; JSON knows better.
FLAGS = [place for place in PLACES if "losses" in place[:-1]]


def agree(data):
    """The schema refuses nothing that the loader takes, and everything that is wrong by itself."""
    errors = loader_s_errors(data)
    if CHECK.is_valid(data):
        assert errors <= {"value_error"}  # what must fit together
    else:
        assert errors


@pytest.mark.parametrize("place", PLACES, ids=lambda place: ".".join(map(str, place)))
def test_schema_and_loader_agree_on_what_may_be_left_out(place):
    data = copy.deepcopy(RICH)
    del at(data, place[:-1])[place[-1]]
    agree(data)


@given(st.sampled_from([place for place in PLACES if place not in FLAGS]), WRONG)
def test_schema_and_loader_agree_on_wrong_values(place, value):
    data = copy.deepcopy(RICH)
    at(data, place[:-1])[place[-1]] = value
    agree(data)


@given(st.sampled_from([place for place in PLACES if isinstance(at(RICH, place), dict)]), st.data())
def test_schema_and_loader_agree_on_unknown_keys_and_keys_of_others(place, data):
    key = data.draw(st.sampled_from(["betta", *sorted({str(place[-1]) for place in PLACES})]))
    changed = copy.deepcopy(RICH)
    at(changed, place)[key] = data.draw(WRONG)
    agree(changed)


BROKEN = {
    "unknown key": ("law", {"betta": 1.0}),
    "wrong kind": ("seed", "one"),
    "out of bounds": ("duration_s", 0.0),
    "not one of the words": ("clock", {"mode": "fast"}),
    "a delay without its kind": ("network", {"default": {"delay": {"mean_s": 0.1}}}),
    "a key of another kind": (
        "network",
        {"default": {"delay": {"distribution": "constant", "low_s": 0.1}}},
    ),
    "no numbers and no file": ("network", {"default": {"delay": {"distribution": "empirical"}}}),
    "unknown preset": ("network", {"default": {"preset": "wlan"}}),
    "a preset that is no word": ("network", {"default": {"preset": ["wifi"]}}),
    "a table for a value of a preset": (
        "network",
        {"default": {"preset": "wifi", "keep_order": {}}},
    ),
    "no robots": ("robots", []),
    "an edge of three": ("formation", {"edges": [[1, 2, 3]]}),
    "unknown action": ("timeline", [{"action": "explode", "at_s": 1.0}]),
}


@pytest.mark.parametrize("case", BROKEN)
def test_both_refuse(case):
    key, value = BROKEN[case]
    assert not CHECK.is_valid(RICH | {key: value})
    assert loader_s_errors(RICH | {key: value})


def test_a_file_of_numbers_may_stand_for_them():
    delay = {"distribution": "empirical", "file": "rtt.csv"}
    assert CHECK.is_valid(RICH | {"network": {"default": {"delay": delay}}})
    assert not CHECK.is_valid(RICH | {"network": {"default": {"delay": delay | {"filee": "x"}}}})


def test_markdown_of_a_docstring():
    text = (
        "``a``: one\n    two.\n\nwords:\n\nfirst\n    its text\n    goes on;\nsecond\n    another."
    )
    assert (
        markdown(text)
        == "`a`: one two.\n\nwords:\n\n- `first`: its text goes on;\n- `second`: another."
    )


def test_the_command_prints_it_or_writes_it(tmp_path):
    printed = CliRunner().invoke(main, ["schema"])
    assert json.loads(printed.output) == SCHEMA
    out = tmp_path / "s.json"
    assert CliRunner().invoke(main, ["schema", "--out", str(out)]).exit_code == 0
    assert out.read_text(encoding="utf-8") == printed.output
    nowhere = CliRunner().invoke(main, ["schema", "--out", str(tmp_path / "none" / "s.json")])
    assert nowhere.exit_code == 2
    assert "No such file" in nowhere.output
