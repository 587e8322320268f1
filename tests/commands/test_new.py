"""``formnet new``: what it writes passes the check and holds what it claims."""

from itertools import product
from math import hypot

import jsonschema
import networkx as nx
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from in_process import collected

from formnet.formation.paper.graph import laplacian
from formnet.formation.scenario.loading import load, loads
from formnet.lab.cli import main
from formnet.lab.forecast.stiffness import warnings
from formnet.lab.scenarios.new import (
    PATTERNS,
    SLOWEST_PER_S,
    CannotWrite,
    Wish,
    damped_robots,
    graph_edges,
    scenario_text,
)
from formnet.lab.schemas.scenario import FILE, scenario_schema, text
from formnet.lab.verdict.model import judge
from formnet.netem.settings.presets import PRESETS

GRAPHS = ("ring", "path", "complete", "star", "random")
WISH = Wish("fleet", 8, "wedge", "ring", "wifi", None, 1, "lockstep")


def new(*words):
    return CliRunner().invoke(main, ["new", *words])


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty folder to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


# --- what it writes ----------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(("pattern", "graph"), list(product(PATTERNS, GRAPHS)))
@pytest.mark.parametrize("robots", [2, 3, 8])
def test_it_passes_the_check_without_a_warning(pattern, graph, robots):
    scenario = loads(scenario_text(WISH._replace(pattern=pattern, graph=graph, robots=robots)))
    assert warnings(scenario) == []
    assert len(scenario.robots) == robots
    assert [getattr(scenario.expect, claim) for claim in ("formation", "heading", "centroid")] == [
        True
    ] * 3


@pytest.mark.long
@pytest.mark.parametrize("network", [*PRESETS])
def test_every_network_passes_the_check_and_the_schema(network):
    import tomllib

    written = scenario_text(WISH._replace(network=network, mode="realtime"))
    assert warnings(loads(written)) == []
    jsonschema.validate(tomllib.loads(written), scenario_schema())


RUNS = [
    WISH,
    WISH._replace(pattern="circle", graph="star", network="satellite", seed=2),
    WISH._replace(pattern="line", graph="path", network="wifi-congested", robots=5),
    WISH._replace(pattern="grid", graph="random", network="lte", robots=7, seed=3),
    WISH._replace(pattern="circle", graph="complete", network="ideal", robots=4),
    WISH._replace(network="lan", robots=4, spacing_m=100.0),
    WISH._replace(network="robot-link", robots=2, spacing_m=0.05),
]


@pytest.mark.long
@pytest.mark.parametrize(
    "wish", RUNS, ids=lambda wish: f"{wish.pattern}-{wish.graph}-{wish.network}"
)
def test_a_run_holds_what_it_claims(wish):
    judged = judge(collected(loads(scenario_text(wish))), mode="inline", wall_s=1.0)
    assert [judged.claims[claim].holds for claim in ("formation", "heading", "centroid")] == [
        True
    ] * 3
    assert judged.passed


def test_same_wish_same_text_and_another_seed_another_start():
    assert scenario_text(WISH) == scenario_text(WISH)
    first, second = (loads(scenario_text(WISH._replace(seed=seed))) for seed in (1, 2))
    assert first.robots[0].start != second.robots[0].start
    assert (first.offsets_m == second.offsets_m).all()


def test_every_section_and_every_gain_is_explained():
    for line in scenario_text(WISH).splitlines():
        if line.startswith("[") and not line.startswith("[[robots"):
            assert " # " in line, line
        if line.startswith(("beta", "w1", "coupling", "control_period_s", "length_scale_m")):
            assert " # " in line, line


# --- patterns ----------------------------------------------------------------------------


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("robots", [2, 5, 8])
def test_neighbours_in_a_pattern_stand_at_the_spacing_around_the_origin(pattern, robots):
    wish = WISH._replace(pattern=pattern, robots=robots, spacing_m=2.5, network="ideal")
    places = loads(scenario_text(wish)).offsets_m
    gaps = [np.hypot(*(a - b)) for k, a in enumerate(places) for b in places[:k]]
    assert min(gaps) == pytest.approx(2.5, abs=2e-3) or (pattern, robots) == ("wedge", 2)
    assert places.mean(axis=0) == pytest.approx([0.0, 0.0], abs=2e-3)


def test_shapes():
    wedge = PATTERNS["wedge"](5)
    assert max(wedge) == wedge[0]
    assert {(x, -y) for x, y in wedge} == set(wedge)
    assert len({y for _, y in PATTERNS["line"](4)}) == 1
    assert sorted(PATTERNS["grid"](4)) == [(-1.0, -1.0), (-1.0, 0.0), (0.0, -1.0), (0.0, 0.0)]
    assert len({round(hypot(*place), 9) for place in PATTERNS["circle"](7)}) == 1


def test_a_pattern_from_a_file(here):
    (here / "arrow.csv").write_text("x_m,y_m\n101,50\n100,51\n100,49\n", encoding="utf-8")
    assert new("arrow", "--pattern", "arrow.csv", "--graph", "path").exit_code == 0
    scenario = load(here / "arrow.toml")
    assert scenario.offsets_m.tolist() == [[101, 50], [100, 51], [100, 49]]
    assert max(abs(robot.start.x_m - 100.3) for robot in scenario.robots) < 3.0


@pytest.mark.parametrize(
    ("rows", "options", "message"),
    [
        ("0,0\n1,one\n", [], "file p.csv, line 2, column 2: must be a number"),
        ("x_m,y_m\n0,0\n1\n", [], "file p.csv, line 3: must have 2 columns, has 1"),
        ("0,0\n1,nan\n", [], "file p.csv, line 2, column 2: must be finite"),
        ("0,0.5m\n1,0\n2,0\n", [], "file p.csv, line 1, column 2: must be a number"),
        ("0,0\n1e300,0\n", [], "file p.csv, line 2, column 1 = 1e+300: must be within ±1e+07 m"),
        (
            "0,0\n1,0\n1,1e-9\n",
            [],
            "line 3 = 1.0, 1e-09: robot 3 must be at least 0.001 m from robot 2 (line 2)",
        ),
        ("", [], "file p.csv holds no numbers"),
        ("0,0\n", [], "file p.csv has one place; a formation needs two"),
        (
            "0,0\n1,0\n0,0\n",
            [],
            "file p.csv, line 3 = 0.0, 0.0: robot 3 must be at least 0.001 m from robot 1 (line 1)",
        ),
        ("0,0\n1,0\n", ["--robots", "3"], "--robots 3: file p.csv has places for 2"),
        ("0,0\n1,0\n", ["--spacing", "2"], "--spacing: the places of a file have their own"),
    ],
)
def test_a_bad_file_is_named_with_its_line(here, rows, options, message):
    (here / "p.csv").write_text(rows, encoding="utf-8")
    result = new("x", "--pattern", "p.csv", *options)
    assert result.exit_code == 2
    assert message in result.output
    assert not (here / "x.toml").exists()


# --- graphs and damping --------------------------------------------------------------------


@given(st.sampled_from(GRAPHS), st.integers(2, 30), st.integers(0, 2**32))
def test_graphs_are_connected_and_repeat(graph, robots, seed):
    edges = graph_edges(graph, robots, seed)
    assert edges == sorted(set(edges)) == graph_edges(graph, robots, seed)
    assert all(1 <= a < b <= robots for a, b in edges)
    built = nx.Graph(edges)
    assert len(built) == robots
    assert nx.is_connected(built)


def test_graphs_are_what_they_are_called():
    sizes = {graph: len(graph_edges(graph, 6, 1)) for graph in GRAPHS}
    assert sizes | {"random": 0} == {"ring": 6, "path": 5, "complete": 15, "star": 5, "random": 0}
    assert graph_edges("star", 4, 1) == [(1, 2), (1, 3), (1, 4)]
    assert graph_edges("random", 9, 1) != graph_edges("random", 9, 2)


@settings(max_examples=25)
@given(st.sampled_from(GRAPHS), st.integers(2, 25), st.floats(0.3, 1.0))
def test_enough_robots_are_damped(graph, robots, coupling):
    edges = graph_edges(graph, robots, 1)
    damped, slowest = damped_robots(robots, edges, coupling)
    matrix = laplacian(range(1, robots + 1), dict.fromkeys(edges, coupling))
    mu = np.diag([float(robot in damped) for robot in range(1, robots + 1)])
    assert slowest == pytest.approx(np.linalg.eigvalsh(matrix + mu)[0])
    assert slowest > SLOWEST_PER_S
    assert damped == sorted(set(damped))


# --- the command -----------------------------------------------------------------------------


def test_a_new_user_s_way(here):
    words = ["fleet", "--robots", "8", "--pattern", "wedge", "--graph", "ring", "--network", "wifi"]
    made = new(*words)
    assert made.exit_code == 0
    assert "formnet run fleet.toml" in made.output
    checked = CliRunner().invoke(main, ["check", "fleet.toml"])
    assert checked.exit_code == 0
    assert "warning" not in checked.output
    first, _, rest = (here / "fleet.toml").read_text(encoding="utf-8").partition("\n")
    assert first == f"#:schema ./{FILE}"
    assert str(here) not in rest
    assert (here / FILE).read_text(encoding="utf-8") == text()


def test_nothing_is_overwritten(here):
    (here / "x.toml").write_text("mine", encoding="utf-8")
    (here / FILE).write_text("mine, too", encoding="utf-8")
    result = new("x")
    assert result.exit_code == 2
    assert "x.toml exists already" in result.output
    assert new("x", "--out", "y.toml").exit_code == 0
    assert (here / "x.toml").read_text(encoding="utf-8") == "mine"
    assert (here / FILE).read_text(encoding="utf-8") == "mine, too"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["a/b"], "name = 'a/b': must start with a letter or digit"),
        (["x", "--pattern", "wegde"], "did you mean 'wedge'?"),
        (["x", "--pattern", "none.csv"], "file none.csv cannot be read: No such file"),
        (["x", "--network", "wify"], "did you mean 'wifi'?"),
        (["x", "--network", "string"], "(ideal, lan, wifi"),
        (["x", "--network", "wlan"], "no such preset (ideal, lan, wifi"),
        (["x", "--pattern", "vee"], "neither a pattern (circle, line, wedge, grid) nor a file"),
        (["x", "--robots", "eight"], "'eight' is not a valid whole number"),
        (["x", "--robots", "1"], "1 is not in the range 2<=x<=1000"),
        (["x", "--graph", "tree"], "'tree' is not one of"),
        (["x", "--out", "none/x.toml"], "cannot be written: No such file"),
    ],
)
def test_a_wish_that_cannot_be_met_is_refused(here, words, message):
    result = new(*words)
    assert result.exit_code == 2
    assert message in result.output
    assert "Traceback" not in result.output
    assert list(here.iterdir()) == []


def test_the_help_names_every_network():
    shown = " ".join(new("--help").output.split())
    assert ", ".join(PRESETS) in shown


def test_too_stiff_for_any_period_is_said(monkeypatch):
    monkeypatch.setattr("formnet.lab.scenarios.new.longest_period_s", lambda course: 0.0)
    with pytest.raises(CannotWrite, match="no control period is short enough"):
        scenario_text(WISH)
