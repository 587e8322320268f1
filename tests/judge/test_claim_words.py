"""A law that is not of the paper is not told of by the paper's equations and theorems."""

import csv
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from plugin import install
from verdicts import made

from formnet.formation.scenario.loading import load
from formnet.lab.cli import main
from formnet.lab.figures import run_figures as figures
from formnet.lab.pages import listing as runs
from formnet.lab.pages.report import write_report
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.lab.verdict.recorded import read_whole

THE_PAPER = re.compile(r"Eqs?\.|[Tt]heorem|Assumption|V never rises|\bV\b|the theory")
LAW = """
class Law:
    def __init__(self, situation): pass
    def command(self, now_ns, own, heard): return 0.0, 0.0
"""
SECTION5 = CONFIGS / "paper" / "section5-delay.toml"


def formnet(*arguments):
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    return result.exit_code, result.output


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """What ``formnet run`` of a foreign law says, and its folder."""
    place = tmp_path_factory.mktemp("foreign")
    install(place, "mine", LAW)
    out = place / "runs" / "mine"
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "formnet",
            "run",
            SECTION5,
            "--inline",
            "--out",
            out,
            "--set",
            "law.kind=mine",
            "--set",
            "duration_s=0.2",
            "--set",
            "law.w1.bias=0.0",
        ],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(place)},
    )
    assert done.returncode == 1, done.stderr
    return done.stdout + done.stderr, out


def told_by(folder):
    """The text and the attributes of the page."""
    write_report(folder)
    text = (folder / "report.html").read_text(encoding="utf-8")
    text = re.sub(r"data:[^\"]*", "", text.partition("</style>")[2])
    return text.partition("<details><summary>scenario.toml")[0]


@pytest.mark.processes
def test_the_terminal_speaks_of_no_theorem(ran):
    said, _ = ran
    assert not THE_PAPER.search(said.replace("results are in", "")), said
    assert re.search(r"formation +yes +no", said)
    assert "FAILS: formation, heading, centroid" in said


@pytest.mark.processes
def test_the_page_speaks_of_no_theorem(ran):
    page = told_by(ran[1])
    assert not THE_PAPER.search(page), THE_PAPER.search(page)
    assert "Formation does not hold: " in page
    assert "How connected the graph is" in page
    assert "algebraic connectivity" in page
    assert 'alt="Errors over time' in page


@pytest.mark.processes
def test_the_figures_name_errors_alone(ran):
    axes = figures.errors(read_whole(ran[1])).axes[0]
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels[:3] == ["formation (m)", "heading (rad)", "centroid (m)"]


@pytest.mark.processes
def test_check_has_the_graph_alone(ran, monkeypatch):
    done = subprocess.run(
        [sys.executable, "-m", "formnet", "check", ran[1] / "scenario.toml"],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ran[1].parents[1])},
    )
    assert done.returncode == 0
    assert "algebraic connectivity" in done.stdout
    assert not THE_PAPER.search(done.stdout + done.stderr)


@pytest.mark.processes
def test_what_is_claimed_of_v_is_told_all_the_same(ran, tmp_path):
    folder = Path(shutil.copytree(ran[1], tmp_path / "mine"))
    judged = json.loads((folder / "verdict.json").read_text())
    assert "lyapunov" not in read_whole(folder).verdict.told
    judged["claims"]["lyapunov"] |= {"expected": True}
    (folder / "verdict.json").write_text(json.dumps(judged))
    assert "V never rises" in told_by(folder)


@pytest.fixture(scope="module")
def of_the_paper(tmp_path_factory):
    """A run of the paper's law and one of its baseline, by kind of law."""
    found = {}
    for kind, file in (
        ("cooperative", SECTION5),
        ("leader_follower", CONFIGS / "faults" / "leader-follower.toml"),
    ):
        found[kind] = tmp_path_factory.mktemp("paper") / kind
        formnet(
            "run", file, "--inline", "--no-scene", "--out", found[kind], "--set", "duration_s=0.2"
        )
    return found


@pytest.mark.long
@pytest.mark.parametrize("kind", ["cooperative", "leader_follower"])
def test_a_law_of_the_paper_is_held_against_its_equations(of_the_paper, kind):
    page = told_by(of_the_paper[kind])
    for words in ("formation (Eq. 3)", "Errors of Eqs. 3–5", "What the theory says"):
        assert words in page
    assert ("Theorem 6" in page) == (kind == "cooperative")
    assert ("V never rises" in page) == (kind == "cooperative")  # V is of that law alone


@pytest.mark.processes
def test_runs_of_both_kinds_are_compared_without_equations(ran, of_the_paper, tmp_path):
    paper = of_the_paper["cooperative"]
    formnet("compare", paper, ran[1], "--out", tmp_path / "mixed")
    formnet("compare", paper, of_the_paper["leader_follower"], "--out", tmp_path / "own")

    def titles(name):
        with (tmp_path / name / "comparison.csv").open(newline="") as file:
            return [row[0] for row in csv.reader(file)]

    assert "at the end: formation, Eq. 3 (m)" in titles("own")
    assert "at the end: formation (m)" in titles("mixed")
    assert not any("Eq" in title for title in titles("mixed"))


# --- settled --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "judged", "at_s", "words"),
    [
        ("completed", [1, 2], 3.456, "3.46 s"),
        ("completed", [1, 2], None, "never"),
        ("completed", [], None, "–"),
        ("diverged", [1, 2], None, "–"),
        ("interrupted", [1, 2], None, "–"),
    ],
)
def test_when_a_run_settled(kind, judged, at_s, words):
    assert made(kind=kind, judged=judged, settling_time_s=at_s).settled == words


@pytest.mark.processes
def test_a_run_that_never_settles_says_so_everywhere(ran):
    folder = ran[1]
    assert load(folder / "scenario.toml").expect.formation
    assert "<dt>settled after</dt><dd>never</dd>" in told_by(folder)
    assert runs.look_at(folder).settled == "never"
    code, said = formnet("list", folder.parent)
    assert (code, "never" in said) == (0, True)
    assert 'data-label="settled">never<' in (folder.parent / "index.html").read_text()
