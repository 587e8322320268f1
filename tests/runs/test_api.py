"""``import formnet``: what a program gets of it is what the command line writes."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from in_process import formnet as command_line

import formnet
from formnet.formation.records.events import Kill, Network
from formnet.lab.runs.recording import LINKS_SCHEMA, STATES_SCHEMA
from formnet.lab.runs.tables import read_states

SHORT = {"duration_s": 0.5}


@pytest.fixture(scope="module")
def delayed():
    return formnet.run("section5-delay", SHORT | {"network.default.delay.mean_s": 0.02})


def test_the_whole_of_section_5_has_the_bits_of_the_command_line(delayed, tmp_path):
    out = tmp_path / "run"
    sets = ("--set", "duration_s=0.5", "--set", "network.default.delay.mean_s=0.02")
    command_line(
        "run", "section5-delay", "--inline", "--no-figures", "--no-scene", "--out", out, *sets
    )
    written = json.loads((out / "verdict.json").read_text(encoding="utf-8"))
    assert delayed.verdict.trajectory_sha256 == written["trajectory_sha256"]
    own = json.loads(delayed.verdict.model_dump_json())
    timed = {"wall_s", "realtime_factor", "warnings", "versions"}
    assert {k: own[k] for k in own.keys() - timed} == {
        k: written[k] for k in written.keys() - timed
    }


def test_arrays_have_the_axes_that_are_promised(delayed):
    assert delayed.robots == [1, 2, 3, 4, 5]
    assert delayed.t_s.shape == (51,)
    assert np.array_equal(delayed.t_s, np.arange(51) * 10_000_000 / 1e9)
    for name in STATES_SCHEMA.names[2:]:
        assert delayed.state(name).shape == (51, 5)
        column = delayed.states[name].to_numpy().reshape(51, 5)
        assert np.array_equal(delayed.state(name), column)
    assert delayed.links.schema == LINKS_SCHEMA
    assert delayed.links.num_rows == delayed.verdict.messages.copies
    for name, error in delayed.errors.items():
        assert error.shape == (51,)
        assert delayed.verdict.claims[name].largest_in_window == pytest.approx(error[-6:].max())


def test_a_quantity_that_there_is_not_is_named(delayed):
    with pytest.raises(KeyError, match="no quantity 'x'; there are x_m, y_m, heading_rad"):
        delayed.state("x")


def test_what_is_saved_is_opened_again_and_read_by_every_command(delayed, tmp_path):
    folder = delayed.save(tmp_path / "saved")
    again = formnet.open(folder)
    assert again.verdict == delayed.verdict
    assert again.events == delayed.events
    assert np.array_equal(again.state("heading_rad"), delayed.state("heading_rad"))
    assert again.links.equals(delayed.links)
    code, said = command_line("verify", folder)
    assert (code, "identical" in said) == (0, True)
    with pytest.raises(OSError, match="exists"):
        delayed.save(folder)
    assert formnet.open(again.save(tmp_path / "copy")).verdict == delayed.verdict


def test_what_happens_to_links_and_robots_is_among_the_events(tmp_path):
    run = formnet.run(
        "section5",
        SHORT
        | {
            "timeline": [
                {"action": "cut", "at_s": 0.1, "heal_after_s": 0.1},
                {"action": "kill", "at_s": 0.2, "robots": 4},
            ]
        },
    )
    assert sum(isinstance(event, Network) for event in run.events) == 2
    (kill,) = [event for event in run.events if isinstance(event, Kill)]
    assert (kill.t_ns, kill.robots) == (200_000_000, (4,))
    assert run.events[-1].name == "completed"
    assert formnet.open(run.save(tmp_path / "run")).events == run.events


class Circling:
    """Every robot drives in a circle, whatever it hears."""

    def __init__(self, situation: formnet.Situation) -> None:
        self.radius_m = 1.0 + situation.robot

    def command(self, now_ns, own, heard):
        return formnet.Command(0.5, 0.5 / self.radius_m)


def test_a_law_of_one_s_own_drives_every_robot():
    kinematic = SHORT | {"law.level": "kinematic"}
    run = formnet.run("theorem2", kinematic, law=Circling)
    assert np.allclose(run.state("speed_mps")[1:-1], 0.5)
    radii = 0.5 / run.state("turn_rate_radps")[1:-1]
    assert np.allclose(radii, 1.0 + np.array(run.robots))
    assert run.scenario.law.kind == "Circling"
    assert run.verdict.theorem is None


def test_a_law_may_be_a_function_or_an_object_that_all_share():
    class Still:
        def command(self, now_ns, own, heard):
            return (0.0, 0.0)

    kinematic = SHORT | {"law.level": "kinematic"}
    shared = formnet.run("theorem2", kinematic, law=Still())
    made = formnet.run("theorem2", kinematic, law=lambda situation: Still())
    assert shared.scenario.law.kind == "Still"
    assert shared.verdict.trajectory_sha256 == made.verdict.trajectory_sha256
    with pytest.raises(TypeError, match="law must be a class"):
        formnet.run("theorem2", law=3)


def test_a_law_that_cannot_be_built_or_fails_is_named():
    def refuses(situation):
        raise ValueError("no such gain")

    with pytest.raises(formnet.ScenarioError, match="refuses robot 1: no such gain"):
        formnet.run("theorem2", law=refuses)

    class Fails:
        def command(self, now_ns, own, heard):
            return 1 / 0

    run = formnet.run("theorem2", SHORT, law=Fails())
    assert run.stands == "failed"
    assert "ZeroDivisionError" in run.verdict.outcome.reason


def test_a_scenario_may_be_tables_or_loaded_and_stays_as_it_is():
    loaded = formnet.load(Path("configs/paper/section5.toml"), SHORT)
    tables = loaded.model_dump(mode="json", by_alias=True, exclude_none=True)
    before = json.dumps(tables)
    runs = [formnet.run(source, SHORT) for source in ("section5", loaded, tables)]
    assert len({run.verdict.trajectory_sha256 for run in runs}) == 1
    assert json.dumps(tables) == before


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ({"law.beta": -1.0}, "law.beta = -1.0: must be greater than 0"),
        ({"law.betta": 1.0}, "law.betta = 1.0: unknown key; did you mean 'beta'?"),
        ({"robots.9.damping": 1.0}, "there is no '9' in this list"),
        ({"law.kind": "nobody"}, "no law 'nobody' is installed"),
        ({"clock.mode": "realtime"}, "this is virtual time"),
        (["law.beta"], "must read key.path=value"),
    ],
)
def test_what_is_wrong_with_a_scenario_is_named(overrides, said):
    with pytest.raises(formnet.ScenarioError) as error:
        formnet.run("section5", overrides)
    assert said in str(error.value)


def test_what_is_no_scenario_and_no_run_is_named(tmp_path):
    with pytest.raises(LookupError, match=r"did you mean paper.section5"):
        formnet.run("section55")
    with pytest.raises(formnet.Unreadable, match="no such folder"):
        formnet.open(tmp_path / "none")


def test_check_says_what_the_theory_says():
    found = formnet.check("section5-delay")
    assert (found.theorem, found.warnings) == (6, [])
    hard = formnet.check("section5", {"law.beta": 200.0})
    assert any("control_period_s" in warning for warning in hard.warnings)
    assert formnet.check("section5", {"law.beta": 200.0}, lookahead=False).warnings == []


def test_a_run_may_end_early():
    run = formnet.run("section5", until_s=0.05)
    assert run.stands == "interrupted"
    assert run.t_s[-1] == pytest.approx(0.05, abs=0.011)


@pytest.mark.processes
def test_every_public_name_is_there_and_the_import_brings_nothing(tmp_path):
    program = (
        "import sys, formnet\n"
        "heavy = {'numpy', 'pydantic', 'pyarrow', 'zenoh', 'networkx', 'scipy'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
        "for name in formnet.__all__: getattr(formnet, name)\n"
        "assert set(formnet.__all__) == set(formnet._PLACES)\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True, cwd=tmp_path)


def test_a_name_that_is_not_public_is_no_attribute():
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        formnet.nonsense  # noqa: B018


def test_the_saved_states_are_those_of_the_run(delayed, tmp_path):
    folder = delayed.save(tmp_path / "run")
    assert len(read_states(folder)) == 51 * 5
