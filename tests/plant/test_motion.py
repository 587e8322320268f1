"""The extremes of a run's motion, from the plant into verdict, words, page, table and comparison."""

import copy as copies
import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from in_process import collected, formnet

from formnet.formation.briefing.resolving import resolve
from formnet.formation.records import events
from formnet.formation.records.events import Event
from formnet.formation.records.outcome import Outcome
from formnet.lab.launch.inline import Inline
from formnet.lab.nemesis import trial
from formnet.lab.pages.report import write_report
from formnet.lab.runs.difference import other_extremes
from formnet.lab.runs.recording import Collected
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.lab.verdict.model import judge
from formnet.lab.verdict.recorded import read_run, read_whole

MOTION = {
    "closest": {"distance_m": 0.0962, "robots": [2, 4], "t_s": 3.21},
    "top_speed": {"speed_mps": 74.04, "robot": 3, "t_s": 1.02},
    "top_turn_rate": {"turn_rate_radps": 9.38, "robot": 1, "t_s": 0.2},
    "top_command": {"torque_nm": 1173.4, "robot": 5, "t_s": 0.1},
}
WORDS = {
    "closest": "0.0962 m (robots 2 and 4, at 3.210 s)",
    "top speed": "74 m/s (robot 3, at 1.020 s)",
    "top turn rate": "9.38 rad/s (robot 1, at 0.200 s)",
    "top torque": "1173 N m (robot 5, at 0.100 s)",
}
PAPER = CONFIGS / "paper"


def run(out, *overrides):
    sets = [part for text in overrides for part in ("--set", text)]
    return formnet(
        "run",
        PAPER / "section5-delay.toml",
        "--inline",
        "--no-figures",
        "--no-scene",
        "--out",
        out,
        *sets,
    )


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A run's folder, and what was printed."""
    out = tmp_path_factory.mktemp("motion") / "run"
    _, said = run(out, "duration_s=0.4")
    return out, said


@pytest.fixture
def copy(recorded, tmp_path):
    """One to tamper with."""
    return Path(shutil.copytree(recorded[0], tmp_path / "copy"))


def change_verdict(folder, change):
    judged = json.loads((folder / "verdict.json").read_text())
    change(judged)
    (folder / "verdict.json").write_text(json.dumps(judged))


# --- that every run tells them -------------------------------------------------------------


@pytest.mark.parametrize(
    ("overrides", "how", "ends"),
    [
        (("duration_s=0.2",), {}, "completed"),
        (("law.length_scale_m=1", "law.beta=200"), {}, "diverged"),
        (("duration_s=9",), {"stopped": lambda: True}, "interrupted"),
        (("duration_s=9",), {"until_ns": 50_000_000}, "interrupted"),
    ],
)
def test_a_run_tells_its_extremes_once_and_before_how_it_ended(paper, overrides, how, ends):
    records = []
    scenario = paper("section5-delay", *overrides)
    outcome = Inline().run(resolve(scenario), records.append, **how)
    assert outcome.kind == ends
    assert isinstance(records[-1], Outcome)
    assert isinstance(records[-2], Event)
    assert (records[-2].name, records[-2].t_ns) == ("extremes", outcome.t_ns)
    assert [r.name for r in records if isinstance(r, Event)].count("extremes") == 1
    found = records[-2].details
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert all(some is not None and some["t_s"] <= outcome.t_ns / 1e9 for some in found.values())


def test_a_run_that_never_began_has_none(paper):
    def bad(_):
        raise ValueError("no")

    found = Collected(paper("section5-delay", "duration_s=0.1"))
    Inline(law=bad).run(resolve(found.scenario), found)
    assert found.outcome.kind == "failed"
    assert found.motion is None
    assert judge(found, mode="inline", wall_s=1.0).motion is None


def test_one_robot_alone_is_close_to_nobody(paper):
    lone = "robots=[{id=7, offset_m=[0.0, 0.0], start={x_m=3.0, y_m=0.0}, damping=4.0}]"
    found = collected(paper("theorem4", lone, "formation.edges=[]", "duration_s=0.2"))
    assert found.motion["closest"] is None
    assert found.motion["top_speed"]["robot"] == 7
    assert next(iter(events.event("extremes", 0, found.motion).titled)) == "top speed"


def test_the_verdict_has_what_the_plant_told(recorded):
    judged = json.loads((recorded[0] / "verdict.json").read_text())
    (line,) = [
        json.loads(line) for line in (recorded[0] / "events.jsonl").open() if '"extremes"' in line
    ]
    assert judged["motion"] == {name: line[name] for name in MOTION}
    rows = read_whole(recorded[0]).samples
    assert judged["motion"]["top_speed"]["speed_mps"] >= max(abs(row.speed_mps) for row in rows)
    assert judged["motion"]["top_command"]["torque_nm"] >= max(
        abs(row.torque_right_nm) for row in rows
    )


# --- in words ------------------------------------------------------------------------------


def test_extremes_in_words():
    whole = events.event("extremes", 0, MOTION)
    assert whole.titled == WORDS
    assert whole.words == "; ".join(f"{what} {words}" for what, words in WORDS.items())
    slow = dict.fromkeys(MOTION) | {"top_command": {"speed_mps": 2e9, "robot": 5, "t_s": 0.0}}
    words = events.event("extremes", 0, slow).words
    assert words == "top command 2e+09 m/s (robot 5, at 0.000 s)"
    assert events.event("extremes", 0, dict.fromkeys(MOTION)).titled == {}


def test_the_terminal_the_page_and_the_events_tell_them(recorded):
    folder, said = recorded
    told = json.loads((folder / "verdict.json").read_text())["motion"]
    words = events.event("extremes", 0, told).words
    assert words in said
    page = (folder / "report.html").read_text()
    assert f'<td class="wide">{words}</td>' in page
    for title, value in read_run(folder).verdict.motion.told.items():
        assert f"<div><dt>{title}</dt><dd>{value}</dd></div>" in page


def test_a_run_from_before_has_none_and_is_read_all_the_same(copy, tmp_path):
    change_verdict(copy, lambda judged: (judged.pop("format"), judged.pop("motion")))
    lines = (copy / "events.jsonl").read_text().splitlines(keepends=True)
    (copy / "events.jsonl").write_text("".join(x for x in lines if '"extremes"' not in x))
    assert read_whole(copy).motion is None
    write_report(copy)
    page = (copy / "report.html").read_text()
    assert "<dt>settled after</dt>" in page
    assert "top speed" not in page
    assert formnet("verify", copy)[0] == 0
    code, said = formnet("compare", copy, shutil.copytree(copy, tmp_path / "other"))
    assert (code, "top speed" in said) == (0, False)


@pytest.mark.parametrize(
    "nonsense",
    [
        3,
        MOTION | {"closest": 3},
        MOTION | {"closest": {"t_s": 1.0}},
        MOTION | {"closest": {"distance_m": 1.0}},
        MOTION | {"top_speed": {"speed_mps": None, "robot": 1, "t_s": 1.0}},
        MOTION | {"closest": {"distance_m": 1.0, "robots": [1], "t_s": 1.0}},
        MOTION | {"top_speed": {"acceleration": 1.0, "robot": 1, "t_s": 1.0}},
    ],
)
def test_what_are_no_extremes_is_said(copy, nonsense):
    change_verdict(copy, lambda judged: judged.update(motion=nonsense))
    assert any("verdict.json is not a verdict" in problem for problem in read_run(copy).problems)
    if isinstance(nonsense, dict):
        with (copy / "events.jsonl").open("a") as file:
            line = {"t_s": 0.4, "event": "extremes", "wall": "2026-01-01T00:00:00Z", **nonsense}
            file.write(json.dumps(line) + "\n")
        assert any(": extremes" in problem for problem in read_run(copy).problems)
    write_report(copy)


# --- compared ------------------------------------------------------------------------------


def test_the_first_extreme_that_differs_is_named_to_the_bit():
    assert other_extremes(MOTION, copies.deepcopy(MOTION)) is None
    assert other_extremes(None, MOTION) is None
    other = copies.deepcopy(MOTION)
    other["top_speed"]["speed_mps"] += 2e-14
    assert other_extremes(MOTION, other).startswith("top_speed: {'speed_mps': 74.04, ")
    other = copies.deepcopy(MOTION) | {"closest": None}
    assert other_extremes(MOTION, other).endswith("'t_s': 3.21} and None")
    assert other_extremes({}, MOTION).startswith("closest: None and {")


def test_verify_compares_them(copy):
    def further(judged):
        judged["motion"]["closest"]["distance_m"] *= 1 + 2**-52

    change_verdict(copy, further)
    code, said = formnet("verify", copy)
    assert code == 1
    assert "differs motion, closest: {'distance_m': " in said


def test_compare_shows_them(recorded, tmp_path):
    run(tmp_path / "kinematic", "duration_s=0.4", "law.level=kinematic")
    code, _ = formnet("compare", recorded[0], tmp_path / "kinematic", "--out", tmp_path / "out")
    assert code == 0
    with (tmp_path / "out" / "comparison.csv").open(newline="") as file:
        rows = {row[0]: row[1:] for row in csv.reader(file)}
    expected = [
        read_run(folder).verdict.motion.told for folder in (recorded[0], tmp_path / "kinematic")
    ]
    for title in ("closest", "top speed", "top turn rate"):
        assert rows[title] == [words[title] for words in expected]
    assert rows["top torque"] == [expected[0]["top torque"], "–"]
    assert rows["top command"] == ["–", expected[1]["top command"]]


def test_compare_finds_runs_that_moved_otherwise_between_their_samples(recorded, copy):
    lines = (copy / "events.jsonl").read_text()
    motion = read_run(copy).motion
    speed = motion["top_speed"]["speed_mps"]
    assert repr(speed) in lines
    (copy / "events.jsonl").write_text(lines.replace(repr(speed), repr(speed * (1 + 2**-52))))
    code, said = formnet("compare", recorded[0], copy)
    assert code == 1
    assert "differs, motion, top_speed" in said


def test_nemesis_compares_them(paper):
    first = collected(paper("section5-delay", "duration_s=0.1"))
    second = copies.copy(first)
    assert trial._differences(first, second) == []
    second.events = [
        replace(event, closest=None) if isinstance(event, events.Extremes) else event
        for event in first.events
    ]
    (problem,) = trial._differences(first, second)
    assert problem.startswith("not deterministic: motion, closest: {")
