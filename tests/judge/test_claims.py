"""The catalogue of claims, what their runs say, and how they are told."""

import json
import signal
import subprocess
import sys
import time

import networkx as nx
import pytest
from in_process import collected, formnet
from matplotlib.figure import Figure  # noqa: TID251
from verdicts import made

from formnet.agent.law import accepts
from formnet.formation.briefing.resolving import resolve
from formnet.formation.scenario.loading import load
from formnet.lab.claims import figures, report
from formnet.lab.claims.beyond import COMPARED
from formnet.lab.claims.catalogue import catalogue
from formnet.lab.claims.claim import ALL_HOLD, APART, NOT_HOME, Case, Claim
from formnet.lab.claims.results import BROKEN, Result, Row
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.lab.verdict.model import FAILS, HOLDS, NOT_JUDGED, OBSERVED
from formnet.lab.work import claims as command

CLAIMS = {claim.key: claim for claim in catalogue()}
SCENARIOS = {
    (claim.key, case.name): load(CONFIGS / case.scenario, case.all_overrides)
    for claim in CLAIMS.values()
    for case in claim.cases
}


def graph_of(scenario, without=()):
    graph = nx.Graph(scenario.formation.edges)
    graph.add_nodes_from(scenario.ids)
    graph.remove_nodes_from(without)
    return graph


# --- the catalogue ----------------------------------------------------------------------


def test_every_claim_and_case_has_a_name_of_its_own_and_a_scenario_that_loads():
    assert len(CLAIMS) == len(catalogue()) == 36
    assert len(SCENARIOS) == sum(len(claim.cases) for claim in CLAIMS.values())
    for scenario in SCENARIOS.values():
        assert accepts(resolve(scenario)) is None
    assert catalogue() == catalogue()  # the random graphs, too


def test_what_is_expected_of_a_case_is_what_its_scenario_expects():
    for claim in CLAIMS.values():
        for case in claim.cases:
            expect = SCENARIOS[claim.key, case.name].expect
            stated = {
                name: getattr(expect, name)
                for name in (*ALL_HOLD, "lyapunov")
                if getattr(expect, name) is not None
            }
            assert stated == case.asked
        assert claim.claimed == any(case.asked for case in claim.cases)


def test_all_connected_graphs_of_five_robots_are_there_once():
    graphs = [graph_of(SCENARIOS["five-robots", c.name]) for c in CLAIMS["five-robots"].cases]
    assert len(graphs) == 21
    assert all(len(graph) == 5 and nx.is_connected(graph) for graph in graphs)
    assert not any(nx.is_isomorphic(a, b) for k, a in enumerate(graphs) for b in graphs[:k])


@pytest.mark.parametrize("robots", [10, 20])
def test_random_groups_are_connected_and_differ(robots):
    key = f"{robots}-robots"
    graphs = [graph_of(SCENARIOS[key, case.name]) for case in CLAIMS[key].cases]
    assert all(len(graph) == robots and nx.is_connected(graph) for graph in graphs)
    assert len({frozenset(graph.edges) for graph in graphs}) == len(graphs) == 3


@pytest.mark.parametrize("key", ["killed-ring", "killed-path-star", "killed-cut-vertex"])
def test_a_kill_is_expected_to_end_as_the_remaining_graph_says(key):
    """Remark 9, with networkx and not the catalogue's own reasoning."""
    ends = []
    for case in CLAIMS[key].cases:
        scenario = SCENARIOS[key, case.name]
        (kill,) = scenario.timeline
        rest = graph_of(scenario, [kill.robots])
        damped = any(scenario.vehicles[robot].damping > 0 for robot in rest)
        expected = NOT_HOME if not damped else ALL_HOLD
        assert case.expected == (expected if nx.is_connected(rest) else APART)
        ends.append(case.expected)
        assert damped or scenario.network.default.delay.mean_s == 0  # no theorem else
    kinds = [APART] if key == "killed-cut-vertex" else [ALL_HOLD, NOT_HOME]
    assert all(kind in ends for kind in kinds)
    assert all(end in kinds for end in ends)


def test_every_robot_is_killed_at_both_times_on_the_ring():
    kills = {
        (
            SCENARIOS["killed-ring", c.name].timeline[0].robots,
            SCENARIOS["killed-ring", c.name].timeline[0].at_s,
        )
        for c in CLAIMS["killed-ring"].cases
    }
    assert kills == {(robot, at_s) for robot in range(1, 6) for at_s in (2.0, 10.0)}


def test_delays_are_those_that_are_named():
    scenario = SCENARIOS["delays-differ", "delays-differ"]
    found = {
        source: {
            scenario.link_settings(source, d).constant_ns
            for s, d in scenario.directed_links
            if s == source
        }
        for source in scenario.ids
    }
    assert found == {
        1: {50_000_000},
        2: {400_000_000},
        3: {100_000_000},
        4: {300_000_000},
        5: {200_000_000},
    }
    delays = [
        SCENARIOS["delay-independence", c.name].network.default.delay.mean_s
        for c in CLAIMS["delay-independence"].cases
    ]
    assert delays == [0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0]


# --- what runs say ----------------------------------------------------------------------


def result(case, *, kind="completed", lost=(), **observed):
    """A result with errors of half or twice the tolerance, as observed."""
    claims = {
        name: {
            "observed": observed.get(name),
            "largest": 0.05 if observed.get(name) else 0.2,
        }
        for name in (*ALL_HOLD, "lyapunov")
    }
    return Result(case, made(kind=kind, lost=lost, claims=claims), 1.0)


def row(*results):
    return Row(Claim("key", "says", "where", "should", tuple(r.case for r in results)), results)


HOLD = {"formation": True, "heading": True, "centroid": True}


def test_a_row_holds_only_if_every_run_ends_as_it_should():
    good = Case("good", "s.toml", (), ALL_HOLD)
    apart = Case("apart", "s.toml", (), APART)
    assert row(result(good, **HOLD)).verdict == HOLDS
    assert row(result(good, **HOLD), result(apart)).verdict == FAILS  # nothing was observed
    not_one = dict.fromkeys(HOLD, False)
    assert row(result(good, **HOLD), result(apart, **not_one)).verdict == HOLDS
    assert row(result(apart, **{**not_one, "heading": True})).verdict == FAILS
    wrong = row(result(good, **HOLD), result(apart, **HOLD))
    assert wrong.verdict == FAILS
    assert wrong.happened == "not as predicted in 1 of 2 runs: apart"
    assert row(result(good, kind="lost", **HOLD)).verdict == BROKEN
    assert row(result(good, lost=[3], **HOLD)).verdict == BROKEN


def test_a_run_that_should_diverge_must_and_no_other_may():
    diverging = Case("d", "s.toml", (), APART, diverges=True)
    not_one = dict.fromkeys(HOLD, False)
    assert row(result(diverging, kind="diverged", **not_one)).verdict == HOLDS
    assert row(result(diverging, **not_one)).verdict == FAILS
    assert row(result(Case("c", "s", (), APART), kind="diverged", **not_one)).verdict == FAILS


def test_a_row_whose_v_would_not_show_a_rise_is_not_judged():
    case = Case("c", "s.toml", (), {"lyapunov": True})
    assert row(result(case, lyapunov=True)).verdict == HOLDS
    unknown = row(result(case, lyapunov=True), result(case))
    assert unknown.verdict == NOT_JUDGED
    assert unknown.happened == "V not judged in 1 of 2 runs: c"
    assert row(result(case), result(case, lyapunov=False)).verdict == FAILS
    both = Case("b", "s.toml", (), {"lyapunov": True, "heading": True})
    assert row(result(both, heading=True)).verdict == NOT_JUDGED
    assert row(result(both, heading=False)).verdict == FAILS


def test_where_nothing_is_claimed_it_is_said_what_was_observed():
    case = Case("c", "s.toml")
    half = row(result(case, **HOLD), result(case, formation=True, heading=False, centroid=False))
    assert half.verdict == OBSERVED
    assert half.happened == ("not claimed; observed: Eq. 3 holds, Eq. 4 in 1 of 2, Eq. 5 in 1 of 2")
    gone = row(result(case, kind="diverged"))
    assert gone.verdict == OBSERVED
    assert gone.happened == "not claimed; observed: diverges at 3 s"


def test_the_telling_error_is_the_worst_for_the_claim():
    good, apart = Case("g", "s", (), ALL_HOLD), Case("a", "s", (), APART)
    not_one = dict.fromkeys(HOLD, False)
    mixed = row(result(good, **HOLD), result(apart, **not_one))
    assert mixed.telling("formation") == (True, 0.05)
    assert row(result(apart, **not_one)).telling("formation") == (False, 0.2)
    assert row(result(apart, kind="diverged", **not_one)).telling("heading") == (
        False,
        float("inf"),
    )
    assert row(result(Case("c", "s"), **HOLD)).telling("centroid") == (None, 0.05)
    v_alone = Case("v", "s", (), {"lyapunov": True})
    assert row(result(v_alone, lyapunov=True)).telling("heading") == (None, None)


# --- how they are told --------------------------------------------------------------------


def test_the_table_has_a_line_for_every_row_and_goes_into_a_file(tmp_path):
    good, apart = Case("g", "s", (), ALL_HOLD), Case("a", "s", (), APART)
    rows = [row(result(good, **HOLD)), row(result(apart, **dict.fromkeys(HOLD, False)))]
    table = report.markdown(rows)
    assert table.splitlines()[2:] == [
        "| says (`key`) | where | 1 | should | as predicted | 5.0e-02 | 5.0e-02 | 5.0e-02 | holds |",
        "| says (`key`) | where | 1 | should | as predicted | (2.0e-01) | (2.0e-01) | (2.0e-01) "
        "| holds |",
    ]
    file = tmp_path / "README.md"
    file.write_text(f"before\n{report.BEGIN}\nold\n{report.END}\nafter\n")
    report.put_into(file, table)
    report.put_into(file, table)
    assert file.read_text() == f"before\n{report.BEGIN}\n{table}{report.END}\nafter\n"
    told = report.as_json(rows, mode="inline")
    assert [claim["verdict"] for claim in told["claims"]] == ["holds", "holds"]
    json.dumps(told, allow_nan=False)


@pytest.mark.parametrize(
    "text",
    ["", report.BEGIN, f"{report.END}{report.BEGIN}", f"{report.BEGIN}{report.END}{report.BEGIN}"],
)
def test_a_file_without_a_place_for_the_table_is_left_alone(tmp_path, text):
    file = tmp_path / "README.md"
    file.write_text(text)
    with pytest.raises(report.NoBlock, match="must have one line"):
        report.put_into(file, "table")
    assert file.read_text() == text


def test_the_summary_marks_every_error_on_the_right_side():
    good, apart, open_ = Case("g", "s", (), ALL_HOLD), Case("a", "s", (), APART), Case("c", "s")
    rows = [
        row(result(good, **HOLD)),
        row(result(apart, **dict.fromkeys(HOLD, False))),
        row(result(open_, kind="diverged")),
    ]
    figure = figures.summary(rows)
    marks = [line for line in figure.axes[0].lines if line.get_marker() in ("o", "x")]
    places = [(round(float(m.get_ydata()[0])), float(m.get_xdata()[0])) for m in marks]
    assert places == [(0, 0.5)] * 3 + [(1, 2.0)] * 3 + [(2, 1e5)] * 3
    assert [m.get_marker() for m in marks] == ["o"] * 6 + ["x"] * 3
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert labels == ["key", "key", "key"]


def test_remark_9_s_figure_shows_both_laws_from_the_kill_on():
    runs = []
    for name in COMPARED:
        case = next(c for c in CLAIMS["leader-follower"].cases if c.name == name)
        overrides = [text.replace("at_s=30", "at_s=0.3") for text in case.all_overrides]
        runs.append(collected(load(CONFIGS / case.scenario, [*overrides, "duration_s=0.6"])))
    assert [run.scenario.law.kind for run in runs] == ["cooperative", "leader_follower"]
    assert [[(e.t_ns, e.details) for e in run.events if e.name == "kill"] for run in runs] == [
        [(300_000_000, {"robots": [4]})]
    ] * 2
    figure = figures.compared(*runs)
    assert isinstance(figure, Figure)
    assert [axes.get_title() for axes in figure.axes[:2]] == [
        "cooperative law (Theorem 4)",
        "leader-follower control (Desai et al. 2001)",
    ]


# --- the command --------------------------------------------------------------------------


@pytest.mark.processes
def test_claims_are_run_judged_and_written_down(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "catalogue", lambda: [CLAIMS["printed-eq-19"]])
    out, readme = tmp_path / "out", tmp_path / "README.md"
    readme.write_text(f"{report.BEGIN}\n{report.END}\n")
    code, said = formnet("claims", "--inline", "--out", out, "--into", readme)
    assert code == 0
    assert "printed-eq-19" in said
    told = json.loads((out / "claims.json").read_text())
    assert [claim["key"] for claim in told["claims"]] == ["printed-eq-19"]
    assert {run["outcome"]["kind"] for run in told["claims"][0]["runs"]} == {"diverged"}
    assert (out / "claims.md").read_text() in readme.read_text()
    assert (out / "claims.png").stat().st_size > 10_000
    verdicts = sorted(path.parent.name for path in out.glob("cases/*/*/verdict.json"))
    assert verdicts == ["theorem-4", "theorem-6"]
    assert not list(out.glob("cases/*/*/*.parquet"))  # kept of runs that surprise
    before = readme.read_text()
    code, said = formnet("claims", "--inline", "--out", out, "--into", readme)
    assert code == 2
    assert "exists already" in said
    assert readme.read_text() == before


@pytest.mark.processes
@pytest.mark.parametrize(
    ("case", "code", "word"),
    [
        (Case("wrong", "paper/theorem2.toml", ("duration_s=0.5",), ALL_HOLD), 1, "FAILS"),
        (
            Case("broken", "faults/leader-follower.toml", ('law.parameters={follows={"1"=2}}',)),
            3,
            "BROKEN",
        ),
    ],
)
def test_a_claim_that_does_not_hold_is_told_with_its_data(tmp_path, monkeypatch, case, code, word):
    claim = Claim("mine", "says", "where", "should", (case,))
    monkeypatch.setattr(command, "catalogue", lambda: [claim])
    found, said = formnet("claims", "--inline", "--out", tmp_path / "out")
    assert found == code
    assert f"not as predicted: mine, {case.name}" in said
    assert word in (tmp_path / "out" / "claims.md").read_text()
    assert (tmp_path / "out" / "cases" / "mine" / case.name / "states.parquet").exists()


def test_bad_use_is_said(tmp_path):
    code, said = formnet("claims", "--only", "theorem-7")
    assert code == 2
    assert "--only: theorem-7 matches no claim (theorem-1, " in said
    file = tmp_path / "README.md"
    file.write_text("no place")
    code, said = formnet("claims", "--inline", "--only", "theorem-1", "--into", file)
    assert code == 2
    assert "--into: needs all claims and excludes --only" in said
    code, said = formnet("claims", "--jobs", 2)
    assert code == 2
    assert "--jobs requires --inline" in said
    code, said = formnet("claims", "--inline", "--into", file, "--out", tmp_path / "out")
    assert code == 2
    assert "must have one line <!-- formnet claims: begin -->" in said


def test_the_list_names_every_claim():
    code, said = formnet("claims", "--list")
    assert code == 0
    assert all(key in said for key in ("theorem-1", "killed-restarted", "partition"))


@pytest.mark.processes
def test_interrupted_claims_end_soon_and_keep_what_is_complete(root, tmp_path):
    out = tmp_path / "out"
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "formnet",
            "claims",
            "--inline",
            "--only",
            "theorem-*",
            "--only",
            "20-robots",
            "--out",
            str(out),
        ],
        cwd=root,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    deadline = time.monotonic() + 60.0
    while not list(out.glob("cases/*/*/events.jsonl")):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    began = time.monotonic()
    said, _ = process.communicate(timeout=60.0)
    assert process.returncode == 130, said
    assert time.monotonic() - began < 10.0
    assert "interrupted after" in said
    assert "Traceback" not in said
    assert (out / "claims.json").exists()


# --- the README ---------------------------------------------------------------------------


@pytest.mark.processes
def test_the_readme_s_table_is_the_catalogue_s_and_its_numbers_are_those_of_a_run(root, tmp_path):
    readme = (root / "README.md").read_text(encoding="utf-8")
    table = readme.split(report.BEGIN)[1].split(report.END)[0]
    lines = table.strip().splitlines()[2:]
    assert [line.split("`")[1] for line in lines] == list(CLAIMS)
    for line, claim in zip(lines, CLAIMS.values(), strict=True):
        assert line.endswith("| observed |" if not claim.claimed else "| holds |")
    formnet(
        "claims",
        "--inline",
        "--only",
        "theorem-4",
        "--only",
        "figures-6-7",
        "--out",
        tmp_path / "out",
    )
    for line in (tmp_path / "out" / "claims.md").read_text().splitlines()[2:]:
        assert line in lines


@pytest.mark.processes
def test_results_that_cannot_be_written_are_told_and_the_table_still_shown(tmp_path, monkeypatch):
    def no_room(path, data):
        raise OSError(28, "No space left on device", str(path))

    case = Case("short", "paper/theorem2.toml", ("duration_s=0.5",), ALL_HOLD)
    claim = Claim("mine", "says", "where", "should", (case,))
    monkeypatch.setattr(command, "catalogue", lambda: [claim])
    monkeypatch.setattr(command.files, "write_new", no_room)
    code, said = formnet("claims", "--inline", "--out", tmp_path / "out")
    assert code == 3
    assert "mine" in said
    assert f"{tmp_path / 'out' / 'claims.json'}: No space left on device" in said
