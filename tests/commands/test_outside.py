"""Traces and samples are read from below the scenario's folder; errors never show what they hold."""

import os

import pytest
from in_process import formnet

import formnet as api
from formnet.formation.scenario.loading import ScenarioError, from_tables, load, loads
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.netem.bridge import lanes
from formnet.netem.bridge.lanes import NetworkFileError

SCENARIO = (CONFIGS / "paper" / "section5.toml").read_text("utf-8")
IDEAL = '{ distribution = "constant", mean_s = 0.0 }'
SECRET = "root:$6$secret:19000:0:99999:7:::"


@pytest.fixture
def place(tmp_path):
    """A scenario's folder, and beside it a file that is nobody's business, and a trace."""
    (tmp_path / "here").mkdir()
    (tmp_path / "shadow").write_text(SECRET + "\n")
    (tmp_path / "trace.csv").write_text("0,0.01\n1,0.01\n")
    return tmp_path / "here"


def written(place, name):
    (place / "s.toml").write_text(
        SCENARIO.replace(IDEAL, f'{{ distribution = "trace", file = "{name}" }}')
    )
    return place / "s.toml"


@pytest.mark.parametrize("how", ["up", "absolute", "link", "linked folder"])
def test_a_file_outside_of_the_folder_is_not_read(place, how):
    outside = place.parent / "trace.csv"
    name = {"up": "../trace.csv", "absolute": str(outside)}.get(how, "x/trace.csv")
    if how == "link":
        (place / "x").mkdir()
        (place / "x" / "trace.csv").symlink_to(outside)
    elif how == "linked folder":
        (place / "x").symlink_to(place.parent)
    file = written(place, name)
    with pytest.raises(ScenarioError, match="must lie below the folder of what names it"):
        load(file)
    assert load(file, allow_outside=True).network.default.delay.delays_s == [0.01, 0.01]
    code, said = formnet("check", "--no-lookahead", file)
    assert (code, "must lie below the folder of what names it" in said) == (2, True)
    assert formnet("check", "--no-lookahead", "--allow-outside", file)[0] == 0
    with pytest.raises(ScenarioError, match="must lie below"):
        api.check(file, lookahead=False)
    assert api.check(file, lookahead=False, allow_outside=True).scenario.name == "section5"


def test_a_file_below_the_folder_is_read(place):
    (place / "traces").mkdir()
    (place / "traces" / "a.csv").write_text("0,0.02\n1,0.02\n")
    (place / "b.csv").symlink_to("traces/a.csv")
    for name in ("traces/a.csv", "b.csv", "traces/../b.csv"):
        assert load(written(place, name)).network.default.delay.delays_s == [0.02, 0.02]


def test_tables_in_memory_read_from_below_the_working_directory(place, monkeypatch):
    monkeypatch.chdir(place)
    import tomllib

    tables = tomllib.loads(written(place, "../trace.csv").read_text())
    with pytest.raises(ScenarioError, match="must lie below"):
        from_tables(tables)
    assert from_tables(tables, allow_outside=True).name == "section5"


@pytest.mark.parametrize("text", [SECRET, "1,secret", "1,2,3.14159", '"secret', "secret\x00"])
def test_no_error_shows_what_a_file_holds(place, text):
    (place / "shadow.csv").write_text(text + "\n")
    with pytest.raises(ScenarioError) as caught:
        load(written(place, "shadow.csv"))
    assert "shadow.csv" in str(caught.value)
    assert "secret" not in str(caught.value)
    assert "3.14" not in str(caught.value)


def test_a_pipe_is_not_waited_for(place):
    os.mkfifo(place / "trace.csv")
    with pytest.raises(ScenarioError, match="cannot be read: it is no regular file"):
        load(written(place, "trace.csv"))


def test_what_came_over_the_bus_reads_nothing(place):
    with pytest.raises(ScenarioError, match="may only be named in a file"):
        loads(written(place, "../trace.csv").read_text())


def test_a_bridge_reads_from_below_its_file_s_folder_and_offers_no_option_that_it_has_not(place):
    file = place / "radio.toml"
    file.write_text(
        '[network.default]\ndelay = { distribution = "trace", file = "../trace.csv" }\n'
    )
    with pytest.raises(NetworkFileError, match="must lie below the folder of what names it") as e:
        lanes.load(file)
    assert "--allow-outside" not in str(e.value)
