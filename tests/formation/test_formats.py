"""Older formats of scenarios: read as they were meant, and rewritten without losing anything."""

import json
from copy import deepcopy

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from formnet.formation.briefing.resolving import resolve
from formnet.formation.formats.migration import FORMAT, FormatError, migrate
from formnet.formation.scenario.loading import ScenarioError, dumps, load, loads
from formnet.lab.cli import main
from formnet.lab.scenarios.packaged import CONFIGS

SECTION5 = (CONFIGS / "paper" / "section5.toml").read_text(encoding="utf-8")
OLD = SECTION5.replace("format = 2\n", "") + (
    '\n[neighbours]  # of format 1\nplayout = "fixed"  # a buffer\nplayout_s = 0.3\nsilence_s = 0.4\n'
)


def playouts(text):
    """The buffer of every link, by the plan that the robots are told."""
    plan = resolve(loads(text))
    return {
        (link.source, link.destination): plan.settings[link.settings].playout_s
        for link in plan.links
    }


@pytest.mark.parametrize("path", sorted(CONFIGS.rglob("*.toml")), ids=lambda path: path.stem)
def test_what_comes_along_states_the_current_format_first(path):
    text = path.read_text(encoding="utf-8")
    if "[[robots]]" in text:
        first = next(line for line in text.splitlines() if line and not line.startswith("#"))
        assert first == f"format = {FORMAT}"


def test_what_is_written_states_it_first():
    assert dumps(loads(SECTION5)).startswith(f"format = {FORMAT}\n")


def test_a_buffer_of_format_1_is_one_of_every_link():
    assert set(playouts(OLD).values()) == {0.3}
    assert loads(OLD).neighbours.silence_s == 0.4


def test_links_with_a_buffer_of_their_own_kept_it_and_no_other_lost_the_common_one():
    """Format 1 gave a link the common buffer wherever its own settings had none."""
    rules = [
        "{from = 1, to = 2, playout_s = 0.7}",
        "{from = 2, to = 3, playout_s = 0.0}",
        '{from = 3, to = 4, preset = "lan"}',
        '{from = 4, to = 5, delay = {distribution = "constant", mean_s = 0.1}}',
    ]
    assert "[network]" not in OLD
    found = playouts(OLD + f"\n[network]\nlinks = [{', '.join(rules)}]\n")
    assert found.pop((1, 2)) == 0.7
    assert set(found.values()) == {0.3}
    assert {(2, 3), (3, 4), (4, 5)} <= found.keys()


def test_the_default_s_own_buffer_was_stronger():
    assert set(
        playouts(
            OLD.replace("[network.default]\n", "[network.default]\nplayout_s = 0.2\n")
        ).values()
    ) == {0.2}


def test_latest_was_the_default():
    text = OLD.replace('"fixed"', '"latest"')
    assert set(playouts(text).values()) == {0.0}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("seed = 1", "format = 3\nseed = 1"), "format = 3: is newer than this version of formnet"),
        (("seed = 1", "format = 0\nseed = 1"), "format = 0: must be a whole number from 1 to 2"),
        (("seed = 1", "format = true\nseed = 1"), "format = true: must be a whole number"),
        (("seed = 1", 'format = "2"\nseed = 1'), "format = '2': must be a whole number"),
        (('"fixed"', '"late"'), "neighbours.playout = 'late': must be 'latest' or 'fixed'"),
        (("playout_s = 0.3\n", ""), "neighbours.playout = 'fixed': \"fixed\" needs playout_s"),
        (("playout_s = 0.3", "playout_s = -1.0"), "network.default.playout_s = -1.0: must be at"),
        (("seed = 1", "format = 2\nseed = 1"), "neighbours.playout = 'fixed': unknown key"),
    ],
)
def test_what_no_format_has_is_named(change, said):
    assert change[0] in OLD
    with pytest.raises(ScenarioError) as error:
        loads(OLD.replace(*change, 1), "f")
    assert str(error.value).startswith(f"f: {said}"), error.value


LEAVES = st.none() | st.booleans() | st.integers(-9, 9) | st.floats() | st.text(max_size=3)
KEYS = st.sampled_from(
    ["format", "neighbours", "playout", "playout_s", "network", "default", "links", "preset"]
)


@given(
    st.dictionaries(
        KEYS,
        st.recursive(
            LEAVES,
            lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=4),
            max_leaves=12,
        ),
        max_size=5,
    )
)
def test_any_tables_are_migrated_or_refused(data):
    old = data.get("format", 1) == 1
    try:
        migrate(data)
    except FormatError as refused:
        said = str(refused)
    else:
        said = ""
    if said:
        assert said.startswith(("format: ", "neighbours.playout: "))
        return
    if old and isinstance(data.get("neighbours"), dict):
        assert not {"playout", "playout_s"} & set(data["neighbours"])
    again = deepcopy(data)
    migrate(again)
    assert json.dumps(again, default=repr) == json.dumps(data, default=repr)


# --- formnet migrate ---------------------------------------------------------------------


def command(*paths):
    result = CliRunner().invoke(main, ["migrate", *map(str, paths)])
    return result.exit_code, result.output


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_a_file_is_rewritten_with_its_comments(tmp_path, ending):
    file = tmp_path / "old.toml"
    file.write_bytes(OLD.replace("\n", ending).encode())
    before = load(file)
    code, said = command(file)
    assert code == 0, said
    assert f"{file}: format 1 -> 2" in said
    assert "network.default.playout_s" in said
    text = file.read_bytes().decode()
    assert text.count("\n") == text.count(ending)
    assert load(file) == before
    comments = [line for line in OLD.splitlines() if line.startswith("#")]
    assert all(line in text for line in comments)
    assert "[neighbours]  # of format 1" in text
    assert next(line for line in text.splitlines() if line and line[0] != "#") == "format = 2"
    assert command(file) == (0, f"{file}: is of the current format\n")


def test_a_run_s_folder_is_rewritten(tmp_path):
    (tmp_path / "scenario.toml").write_text(OLD, encoding="utf-8")
    assert command(tmp_path)[0] == 0
    assert "format = 2" in (tmp_path / "scenario.toml").read_text(encoding="utf-8")


def test_what_is_no_scenario_is_left_as_it_is(tmp_path):
    bad = tmp_path / "bad.toml"
    bad.write_text(OLD.replace("seed = 1", "seed = -1"), encoding="utf-8")
    good = tmp_path / "good.toml"
    good.write_text(OLD, encoding="utf-8")
    before = bad.read_text(encoding="utf-8")
    code, said = command(bad, good, tmp_path / "none.toml")
    assert code == 2
    assert "seed = -1: must be at least 0" in said
    assert "none.toml: cannot be read" in said
    assert bad.read_text(encoding="utf-8") == before
    assert "format = 2" in good.read_text(encoding="utf-8")
