"""formnet verify: a run repeats to the bit, and whatever differs is named."""

import json
import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from in_process import formnet
from plugin import install

from formnet.agent.law import installed
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.rows import LinkRow, Sample
from formnet.lab.launch.inline import Inline
from formnet.lab.runs.borrowed import borrowed
from formnet.lab.runs.difference import first_difference
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.lab.work import verify

SHORT = ("duration_s=0.5", "network.default.loss.probability=0.1")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A short run of Section 5 in one process."""
    out = tmp_path_factory.mktemp("verify") / "run"
    sets = [part for text in SHORT for part in ("--set", text)]
    formnet(
        "run",
        CONFIGS / "paper" / "section5-delay.toml",
        "--inline",
        "--no-scene",
        "--out",
        out,
        *sets,
    )
    return out


@pytest.fixture
def copy(recorded, tmp_path):
    """One to tamper with."""
    return Path(shutil.copytree(recorded, tmp_path / "copy"))


def change(file, column, row, value):
    table = pq.read_table(file)
    values = table.column(column).to_pylist()
    values[row] = value
    place = table.schema.get_field_index(column)
    field = table.schema.field(place)
    pq.write_table(table.set_column(place, field, pa.array(values, field.type)), file)


@pytest.mark.long
def test_a_run_is_identical(recorded):
    code, said = formnet("verify", recorded)
    assert code == 0
    sha256 = json.loads((recorded / "verdict.json").read_text())["trajectory_sha256"]
    assert "identical: 255 samples, 510 messages" in said
    assert sha256 in said


def test_a_changed_state_is_named(copy):
    before = pq.read_table(copy / "states.parquet").column("heading_rad")[123].as_py()
    change(copy / "states.parquet", "heading_rad", 123, before + 1e-15)
    code, said = formnet("verify", copy)
    assert code == 1
    assert "states.parquet does not match the SHA-256 in verdict.json" in said
    assert "first at t = 0.24 s (tick 240), robot 4, heading_rad: " in said
    assert f"{before + 1e-15!r} and {before!r} (recorded, and repeated)" in said


def test_a_changed_message_is_named(copy):
    change(copy / "links.parquet", "fate", 200, "lost: cut")
    code, said = formnet("verify", copy)
    assert code == 1
    assert (
        "first at t = 0.2 s (tick 200), message 20 from 1 to 2, fate: 'lost: cut' and 'deli" in said
    )
    assert "SHA-256" not in said


def test_another_scenario_is_named_by_what_it_does_first(copy):
    text = (copy / "scenario.toml").read_text().replace("beta = 10.0", "beta = 10.5")
    (copy / "scenario.toml").write_text(text)
    code, said = formnet("verify", copy)
    assert code == 1
    assert "first at t = 0 s (tick 0), robot 1, torque_right_nm: " in said


def test_a_difference_tells_other_versions(copy):
    judged = json.loads((copy / "verdict.json").read_text())
    judged["versions"]["numpy"] = "0.1"
    (copy / "verdict.json").write_text(json.dumps(judged))
    assert "numpy" not in formnet("verify", copy)[1]  # identical all the same
    change(copy / "states.parquet", "x_m", 0, 1.0)
    assert "numpy: recorded with 0.1, now " in formnet("verify", copy)[1]


def test_a_run_with_an_unplanned_loss_is_compared_up_to_it(copy):
    judged = json.loads((copy / "verdict.json").read_text())
    judged["robots"]["lost"] = [{"t_s": 0.3, "robot": 2, "reason": "…", "tick": 300}]
    (copy / "verdict.json").write_text(json.dumps(judged))
    change(copy / "links.parquet", "fate", 200, "lost: cut")  # depends on what came after
    code, said = formnet("verify", copy)
    assert code == 0
    assert (
        "identical up to t = 0.3 s, where something unplanned happened: 150 of 255 samples" in said
    )
    change(copy / "states.parquet", "x_m", 140, 1.0)
    code, said = formnet("verify", copy)
    assert code == 1
    assert "first at t = 0.28 s (tick 280), robot 1, x_m: 1.0 and" in said


def test_a_run_that_ended_early_is_compared_up_to_there(copy):
    judged = json.loads((copy / "verdict.json").read_text())
    judged["outcome"] |= {"kind": "interrupted", "t_s": 0.2}
    (copy / "verdict.json").write_text(json.dumps(judged))
    code, said = formnet("verify", copy)
    assert code == 0
    assert "identical up to t = 0.2 s, where the recorded run ended (interrupted; whether" in said


def test_a_run_that_fails_again_as_it_did_is_identical_and_else_it_could_not_be_run(
    copy, monkeypatch
):
    class Failing(Inline):
        def run(self, plan, sink, stopped, until_ns):
            super().run(plan, sink, stopped, min(until_ns, 200_000_000))
            return Outcome("failed", 200_000_000, 3, "ValueError: no")

    monkeypatch.setattr(verify, "engine", lambda *_: Failing())
    code, said = formnet("verify", copy)
    assert code == 3
    assert "could not be repeated: failed, ValueError: no" in said
    judged = json.loads((copy / "verdict.json").read_text())
    judged["outcome"] |= {"kind": "failed", "t_s": 0.2}
    (copy / "verdict.json").write_text(json.dumps(judged))
    assert formnet("verify", copy)[0] == 0


def test_a_run_that_is_said_to_have_gone_on_is_not_repeated(copy):
    """The scenario of a run of 0.5 s, changed to 1e9 s, was repeated for years."""
    text = (copy / "scenario.toml").read_text()
    (copy / "scenario.toml").write_text(text.replace("duration_s = 0.5", "duration_s = 1e9"))
    code, said = formnet("verify", copy)
    assert code == 2
    assert "states.parquet ends at t = 0.5 s, not at 1e+09 s, where the scenario does" in said


@pytest.mark.parametrize("kind", ["completed", "diverged", "interrupted"])
@pytest.mark.parametrize("gap", [False, True])
def test_no_more_is_repeated_than_was_recorded(copy, monkeypatch, kind, gap):
    """Whatever the scenario, the verdict and a last row after a gap say of the end."""
    asked_s = []

    class Watched(Inline):
        def run(self, plan, sink, stopped, until_ns):
            asked_s.append(until_ns / 1e9)
            return super().run(plan, sink, stopped, min(until_ns, 600_000_000))

    monkeypatch.setattr(verify, "engine", lambda *_: Watched())
    text = (copy / "scenario.toml").read_text()
    (copy / "scenario.toml").write_text(text.replace("duration_s = 0.5", "duration_s = 1e6"))
    judged = json.loads((copy / "verdict.json").read_text())
    judged["outcome"] |= {"kind": kind, "t_s": 1e6}
    (copy / "verdict.json").write_text(json.dumps(judged))
    if gap:
        for row in range(250, 255):
            change(copy / "states.parquet", "t_ns", row, 10**15)
    code, said = formnet("verify", copy)
    if kind == "completed" and not gap:
        assert code == 2
        assert asked_s == []
        return
    assert code == 1
    assert asked_s == [pytest.approx(0.5 if gap else 0.51)]
    missing = 0.5 if gap else 0.51
    assert f"first at t = {missing:g} s (tick {1000 * missing:g}), robot 1, the whole row" in said


def test_a_run_of_which_nothing_can_be_compared_is_not_identical(copy):
    judged = json.loads((copy / "verdict.json").read_text())
    judged["outcome"] |= {"kind": "lost", "t_s": 0.0}
    (copy / "verdict.json").write_text(json.dumps(judged))
    code, said = formnet("verify", copy)
    assert code == 2
    assert "nothing to compare" in said


def test_every_run_is_looked_at_and_the_gravest_counts(recorded, tmp_path):
    code, said = formnet("verify", tmp_path / "none", recorded)
    assert code == 2
    assert "none: no such folder" in said
    assert "identical" in said


@pytest.mark.parametrize(
    ("file", "content", "words"),
    [
        ("verdict.json", None, "has no verdict.json"),
        ("verdict.json", "[]", "verdict.json is not a verdict"),
        ("verdict.json", "{", "verdict.json is not a verdict"),
        ("verdict.json", '{"outcome": {}}', "verdict.json is not a verdict of format 1"),
        ("states.parquet", "rubbish", "states.parquet or links.parquet cannot be read"),
        ("links.parquet", None, "has no links.parquet"),
        ("scenario.toml", "name = 3", "scenario.toml: name = 3"),
    ],
)
def test_what_cannot_be_repeated_is_said(copy, file, content, words):
    if content is None:
        (copy / file).unlink()
    else:
        (copy / file).write_text(content)
    code, said = formnet("verify", copy)
    assert code == 2
    assert words in said


def sample(t_ns, robot, x=0.0):
    return Sample(t_ns, robot, x, 0.0, 0.0, 0.0, 0.0, None, None)


def test_first_difference():
    rows = [sample(t, robot) for t in (0, 10, 20) for robot in (1, 2)]
    assert first_difference(rows, list(rows), 10) is None
    assert first_difference([], [], 10) is None
    for place in range(len(rows)):
        found = first_difference(rows, rows[:place] + rows[place + 1 :], 10)
        assert (found.t_ns, found.tick, found.whose) == (
            rows[place].t_ns,
            rows[place].t_ns // 10,
            f"robot {rows[place].robot}",
        )
        assert str(found).endswith("the whole row: something and nothing")
        changed = [*rows[:place], rows[place]._replace(x_m=1.0), *rows[place + 1 :]]
        found = first_difference(rows, changed, 10)
        assert (found.what, found.first, found.second) == ("x_m", 0.0, 1.0)
    nan = [sample(0, 1, float("nan"))]
    assert first_difference(nan, [sample(0, 1, float("nan"))], 10) is None
    found = first_difference([sample(0, 1, 0.0)], [sample(0, 1, -0.0)], 10)
    assert str(found) == "t = 0 s (tick 0), robot 1, x_m: 0.0 and -0.0"
    links = [LinkRow(0, 5, 1, 2, 0, "delivered"), LinkRow(10, None, 1, 2, 1, "in flight")]
    assert first_difference(links, links[:1], 10).whose == "message 1 from 1 to 2"


def test_a_run_of_another_arithmetic_says_what_to_install(copy):
    judged = json.loads((copy / "verdict.json").read_text())
    judged["arithmetic"] = 1
    judged["versions"]["formnet"] = "0.2.0"
    (copy / "verdict.json").write_text(json.dumps(judged))
    code, said = formnet("verify", copy)
    assert code == 2
    assert "its bits come from version 1 of the arithmetic, and this formnet has version 2" in said
    assert "pip install 'formnet[lab]==0.2.0'" in said


@pytest.mark.parametrize("version", ["\x1b]0;title\x07" + "9" * 10**6, None, True, "[red]0[/]"])
def test_what_another_arithmetic_says_of_itself_is_shown_and_no_more(copy, version):
    judged = json.loads((copy / "verdict.json").read_text())
    judged["arithmetic"] = 10**30
    judged["versions"] = {} if version is None else {"formnet": version}
    (copy / "verdict.json").write_text(json.dumps(judged))
    code, said = formnet("verify", copy)
    assert code == 2
    assert "\x1b" not in said
    assert len(said) < 1000


LAW = """
import math
import numpy as np
from math import sin, sqrt
from formnet.exact.trigonometry import sin_cos

class Law:
    def __init__(self, situation):
        self.gain = math.sqrt(2.0)

    def command(self, now_ns, own, heard):
        return sqrt(own[0] ** 2) * 0.0, math.atan2(0.0, 1.0) + sin(0.0) * sin_cos(0.0)[0]
"""


@pytest.mark.parametrize(
    ("source", "named"),
    [
        (LAW, ["**", "math.atan2", "math.sin", "numpy"]),
        (LAW.replace("math.atan2(0.0, 1.0) + sin(0.0) *", "0.0 *"), ["**", "math.sin", "numpy"]),
        (
            "from formnet.exact.trigonometry import sin_cos\nimport math as m\n"
            "class Law:\n"
            "    def __init__(self, situation):\n        self.gain = m.sqrt(2.0)\n"
            "    def command(self, now_ns, own, heard):\n        return m.inf * 0 + 1, m.floor(0.5)\n",
            [],
        ),
    ],
)
def test_a_plug_in_is_named_with_what_it_borrows(tmp_path, monkeypatch, source, named):
    install(tmp_path, "lent", source)
    monkeypatch.syspath_prepend(tmp_path)
    installed.cache_clear()
    try:
        assert borrowed("lent") == named
        assert borrowed("cooperative") == []
    finally:
        monkeypatch.undo()
        installed.cache_clear()


@pytest.mark.processes
def test_verify_names_a_plug_in_that_borrows(tmp_path, monkeypatch):
    install(tmp_path, "lent2", LAW)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    installed.cache_clear()
    try:
        sets = ("--set", "law.kind=lent2", "--set", "duration_s=0.2")
        yard = CONFIGS / "paper" / "section5-delay.toml"
        formnet(
            "run", yard, "--inline", "--no-scene", "--no-figures", "--out", tmp_path / "run", *sets
        )
        code, said = formnet("verify", tmp_path / "run")
    finally:
        monkeypatch.undo()
        installed.cache_clear()
    assert code == 0, said
    assert "law.kind = 'lent2' is a law that uses **, math.atan2, math.sin, numpy" in said
