"""Looking back at runs: what is read, shown, listed, drawn, compared and exported is what was
recorded, whatever state a folder is in."""

import csv
import json
import math
import shutil
import sys
from html.parser import HTMLParser
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from in_process import formnet
from verdicts import made

from formnet.formation.briefing.resolving import resolve
from formnet.formation.records.events import Lost
from formnet.formation.records.outcome import Outcome
from formnet.formation.scenario.expect import ERRORS
from formnet.formation.scenario.loading import load, loads
from formnet.lab.cli import main
from formnet.lab.launch.inline import Inline
from formnet.lab.pages import listing as runs
from formnet.lab.pages import report
from formnet.lab.runs.keypaths import by_path, shown
from formnet.lab.runs.recording import Recording, being_written
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.lab.scene import foxglove
from formnet.lab.verdict.files import Unreadable
from formnet.lab.verdict.recorded import read_run, read_whole

SECTION5 = CONFIGS / "paper" / "section5-delay.toml"
NASTY = '<script>alert("1")</script> & <b>'
SHORT = (
    "duration_s=0.4",
    "network.default.loss.probability=0.2",
    "robots.3.damping=1.0",
    f"description='{NASTY}'",
    'timeline=[{at_s=0.1, action="cut", links=[[1, 2]], heal_after_s=0.05}, '
    '{at_s=0.2, action="kill", robots=[4]}]',
)


def run(out, *overrides):
    sets = [part for text in overrides for part in ("--set", text)]
    return formnet("run", SECTION5, "--inline", "--no-scene", "--out", out, *sets)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A short run in which something happens, in a folder ``runs``."""
    out = tmp_path_factory.mktemp("back") / "runs" / "short"
    code, _ = run(out, *SHORT)
    assert code == 1
    return out


@pytest.fixture
def copy(recorded, tmp_path):
    """One to tamper with."""
    return Path(shutil.copytree(recorded, tmp_path / "runs" / "copy"))


class Page(HTMLParser):
    """What a browser would make of a page."""

    def __init__(self, file):
        super().__init__()
        self.tags, self.text = [], ""
        self.feed(file.read_text(encoding="utf-8"))
        self.text = " ".join(self.text.split())

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += f" {data}"

    def all(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]


# --- reading --------------------------------------------------------------------------


def test_what_is_read_is_what_was_recorded(tmp_path):
    scenario = load(SECTION5, SHORT)
    recording = Recording(tmp_path / "run", scenario)
    Inline().run(resolve(scenario), recording)
    recording.save()
    back = read_run(tmp_path / "run")
    assert back.problems == ["has no verdict.json"]
    assert repr(back.samples) == repr(recording.samples)
    assert back.link_rows == recording.sorted_link_rows
    assert back.events == recording.events
    assert {"network", "kill"} <= {event.name for event in back.events}
    assert json.dumps([e.details for e in back.events]) == json.dumps(
        [e.details for e in recording.events]
    )
    assert back.outcome == recording.outcome
    assert back.up_at(back.now_ns()) == [1, 2, 3, 5]
    assert back.scenario == scenario


def test_an_unplanned_loss_is_no_outcome(tmp_path, paper):
    recording = Recording(tmp_path / "run", paper("section5"))
    recording(Lost(10**9, 2, "gone", 1000))
    assert read_run(tmp_path / "run").outcome is None
    recording(Outcome("lost", 10**9, 2, "gone"))
    back = read_run(tmp_path / "run")
    assert back.outcome == Outcome("lost", 10**9, 2, "gone")
    assert back.events == [Lost(10**9, 2, "gone", 1000)]
    assert 2 not in back.up_at(2 * 10**9)


def test_a_run_is_known_to_go_on_until_its_recording_is_closed(tmp_path, paper):
    recording = Recording(tmp_path / "run", paper("section5"))
    assert being_written(tmp_path / "run")
    assert runs.look_at(tmp_path / "run").standing == "running"
    assert report.write_report(tmp_path / "run")
    assert "It is still running" in Page(tmp_path / "run" / "report.html").text
    recording.close()
    assert not being_written(tmp_path / "run")
    assert runs.look_at(tmp_path / "run").standing == "did not end"


def line_with(**fields):
    """A line of events.jsonl with these fields."""
    kill = {"t_s": 0.1, "event": "kill", "robots": [1], "wall": "2026-01-01T00:00:00Z"}
    return json.dumps(kill | fields) + "\n"


BROKEN = [
    ("verdict.json", None, "has no verdict.json"),
    ("verdict.json", "{}", "verdict.json is not a verdict"),
    ("events.jsonl", "[1]\n", "events.jsonl cannot be read: line 1: [1]: must be a table"),
    ("events.jsonl", line_with(t_s="x"), "line 1: t_s: 'x': must be a time in seconds"),
    ("events.jsonl", line_with(t_s=math.inf), "line 1: t_s: inf: must be a time in seconds"),
    ("events.jsonl", line_with(wall=3), "line 1: wall: 3: must be a time such as 20"),
    ("events.jsonl", line_with(event="lots"), "line 1: event: 'lots': is none of started, "),
    (
        "events.jsonl",
        line_with(event="lost"),
        "line 1: outcome: 'robots': is none of robot, reason",
    ),
    (
        "events.jsonl",
        line_with(robots=[1, 9]),
        "line 1: kill.robots[1]: 9: no such robot (robots: ",
    ),
    ("events.jsonl", line_with(robots=1), "line 1: kill.robots: 1: must be a list"),
    ("events.jsonl", line_with(why=1), "line 1: kill: 'why': is none of robots"),
    ("events.jsonl", "\xff\n", "line 1: b'\\xc3\\xbf\\n': is not JSON"),
    ("events.jsonl", None, "has no events.jsonl"),
    ("links.parquet", None, "has no links.parquet"),
    ("states.parquet", "rubbish", "states.parquet or links.parquet cannot be read"),
]


@pytest.mark.long
@pytest.mark.parametrize(("file", "content", "words"), BROKEN)
def test_what_is_broken_is_said_on_the_page_and_in_the_list(copy, file, content, words):
    if content is None:
        (copy / file).unlink()
    else:
        (copy / file).write_text(content)
    assert any(words in problem for problem in read_run(copy).problems)
    with pytest.raises(Unreadable, match=words.split(":")[0]):
        read_whole(copy)
    assert formnet("report", copy)[0] == 0
    if "parquet" not in file:
        assert words in Page(copy / "report.html").text
    assert formnet("list", copy.parent)[0] == 0
    for command in (("compare", copy, copy), ("export", copy, "--format", "csv")):
        code, said = formnet(*command)
        assert (code, words in said) == (2, True)


def test_a_line_that_was_cut_off_by_a_crash_is_left_out(copy):
    with (copy / "events.jsonl").open("a") as file:
        file.write('{"t_s": 0.4, "event": "wai')
    assert read_run(copy).problems == []


def test_a_verdict_of_another_version_is_refused_and_the_rest_is_shown(copy):
    judged = json.loads((copy / "verdict.json").read_text())
    del judged["theorem"], judged["why"], judged["links"]
    (copy / "verdict.json").write_text(json.dumps(judged))
    assert formnet("report", copy)[0] == 0
    page = Page(copy / "report.html").text
    assert "verdict.json is not a verdict of format 2" in page
    assert "theorem: is required; why: is required; links: is required" in page


# --- report.html ----------------------------------------------------------------------


def test_the_page_tells_what_held_and_why(recorded):
    text = Page(recorded / "report.html").text
    judged = json.loads((recorded / "verdict.json").read_text())
    assert "section5-delay FAILS Formation (Eq. 3) does not hold: " in text
    assert judged["why"] in text
    assert "Not judged: robot 4, down at the end." in text
    assert judged["trajectory_sha256"] in text
    assert "0.200 kill robot 4" in text
    assert "0.100 network cut 1→2, in flight kept" in text
    assert "formnet run scenario.toml --inline formnet verify ." in text
    assert "robots.3.damping" not in text  # a robot's own values are in the table of robots
    assert "network.default.loss.probability 0.2" in text
    for link in judged["links"]:
        assert f"{link['source']}→{link['destination']} {link['sent']} {link['delivered']}" in text
    for version in judged["versions"].values():
        assert shown(version) in text


def test_the_page_needs_nothing_else_and_can_be_read_by_all(recorded):
    page = Page(recorded / "report.html")
    assert {tag for tag, _ in page.tags}.isdisjoint({"script", "link", "iframe", "object", "base"})
    assert all(image["src"].startswith("data:image/") for image in page.all("img"))
    assert len(page.all("img")) == 7
    assert all(len(image["alt"]) > 40 for image in page.all("img"))
    anchors = {attributes.get("id") for _, attributes in page.tags}
    for link in page.all("a"):
        assert link["href"] == "../index.html" or link["href"].removeprefix("#") in anchors
    assert page.all("html")[0]["lang"] == "en"
    assert any(meta.get("name") == "viewport" for meta in page.all("meta"))
    assert any("default-src 'none'" in meta.get("content", "") for meta in page.all("meta"))
    assert all("scope" in head for head in page.all("th"))
    style = (recorded / "report.html").read_text(encoding="utf-8").partition("</style>")[0]
    assert "url(" not in style
    assert "prefers-color-scheme: dark" in style


def test_text_of_scenarios_and_events_is_escaped(copy):
    with (copy / "events.jsonl").open("a") as file:
        file.write(line_with(event="host lost", host=NASTY, reason=NASTY))
        file.write(line_with(event=NASTY))
    report.write_report(copy)
    page = Page(copy / "report.html")
    assert not page.all("script")
    assert not page.all("b")
    assert page.text.count('<script>alert("1")</script> & <b>') >= 3


def test_a_long_list_of_events_is_bounded(copy):
    line = line_with(event="waiting", **{"for": "x" * 10_000})
    own = len((copy / "events.jsonl").read_text().splitlines())
    with (copy / "events.jsonl").open("a") as file:
        file.writelines(line for _ in range(5000))
    report.write_report(copy)
    hidden = 5000 + own - report.FIRST_EVENTS - report.LAST_EVENTS
    text = Page(copy / "report.html").text
    assert f"{hidden:,} more are in events.jsonl" in text
    assert "0.400 completed" in text  # the end is told all the same
    assert (copy / "report.html").stat().st_size < 5_000_000


def test_an_interrupted_run_has_a_page_and_gets_its_figures_with_report(copy):
    judged = json.loads((copy / "verdict.json").read_text())
    judged["outcome"] |= {"kind": "interrupted", "t_s": 0.2, "reason": "Ctrl-C"}
    (copy / "verdict.json").write_text(json.dumps(judged))
    shutil.rmtree(copy / "figures")
    assert report.leave(copy) is None
    page = Page(copy / "report.html")
    assert "section5-delay interrupted The run was interrupted at t = 0.200 s: Ctrl-C." in page.text
    assert "There are no figures yet" in page.text
    (copy / "links.parquet").unlink()
    assert formnet("report", copy)[0] == 0
    assert not Page(copy / "report.html").all("img")  # half of a record is not drawn
    assert formnet("report", copy.parent / "none")[0] == 2


@pytest.mark.long
def test_a_run_that_shall_not_draw_does_not(tmp_path):
    out = tmp_path / "run"
    assert (
        formnet(
            "run",
            SECTION5,
            "--inline",
            "--no-figures",
            "--no-scene",
            "--out",
            out,
            "--set",
            "duration_s=0.4",
        )[0]
        == 1
    )
    assert not (out / "figures").exists()
    assert "There are no figures yet" in Page(out / "report.html").text
    assert formnet("report", out)[0] == 0
    assert len(list((out / "figures").glob("*.png"))) == 8


def test_a_run_that_fell_short_is_told_that_it_did(copy):
    judged = json.loads((copy / "verdict.json").read_text())
    assert "still decreasing" not in Page(copy / "report.html").text
    for name, claim in judged["claims"].items():
        if name in ERRORS:
            judged[ERRORS[name].error_key] = claim["largest_in_window"] / 2
    (copy / "verdict.json").write_text(json.dumps(judged))
    report.write_report(copy)
    assert "still decreasing at the end" in Page(copy / "report.html").text


@pytest.mark.long
def test_a_run_that_diverged_says_where_why_and_what_had_been_feared(tmp_path):
    out = tmp_path / "run"
    code, said = formnet(
        "run",
        SECTION5,
        "--inline",
        "--no-scene",
        "--out",
        out,
        "--set",
        "law.length_scale_m=1",
        "--set",
        "law.beta=200",
        "--set",
        "duration_s=1",
    )
    assert code == 1
    assert "messages in flight at the end: 10" in said
    page = Page(out / "report.html")
    assert (
        "section5-delay diverged The run diverged at t = 0.001 s, robot 1: it runs away, at "
        "-1.4e+05 m/s and 4.7e+04 rad/s." in page.text
    )
    (warning,) = json.loads((out / "verdict.json").read_text())["warnings"]
    assert "Try smaller gains, or a larger law.length_scale_m" in warning
    assert warning in page.text
    assert "Messages that neither arrived nor were lost: 10" in page.text


# --- list and index -------------------------------------------------------------------


def test_list_tells_every_kind_of_folder(copy, recorded):
    place = copy.parent
    (place / "claims-x").mkdir()
    (place / "claims-x" / "claims.json").write_text(
        '{"mode": "inline", "claims": [{"verdict": "holds"}, {"verdict": "FAILS"}]}'
    )
    (place / "nemesis-x").mkdir()
    (place / "nemesis-x" / "nemesis.json").write_text('[{"mode": "inline", "problems": []}]')
    (place / "going" / "cases").mkdir(parents=True)
    (place / "bad").mkdir()
    (place / "bad" / "nemesis.json").write_text("{")
    (place / "photos").mkdir()
    code, said = formnet("list", place)
    assert code == 0
    assert "other folders: photos" in said
    result = CliRunner().invoke(main, ["list", str(place), "--json"])
    found = {Path(e["folder"]).name: e for e in json.loads(result.stdout)}
    assert {name: (e["kind"], e["standing"]) for name, e in found.items()} == {
        "copy": ("run", "FAILS"),
        "claims-x": ("claims", "FAILS"),
        "nemesis-x": ("nemesis", "holds"),
        "going": ("claims", "did not end"),
        "bad": ("broken", "unreadable"),
    }
    assert found["copy"]["claims"] == dict.fromkeys(("formation", "heading", "centroid"), False)
    assert found["copy"]["simulated_s"] == 0.4
    assert found["claims-x"]["note"] == "1 of 2 claims as predicted (claims.md)"


def test_who_was_lost_is_listed(copy):
    judged = json.loads((copy / "verdict.json").read_text())
    judged["robots"]["lost"] = [{"robot": 3, "t_s": 0.2, "reason": "x", "tick": 20}]
    (copy / "verdict.json").write_text(json.dumps(judged))
    said = "FAILS: formation, heading, centroid; lost robot 3"
    assert said in " ".join(formnet("list", copy.parent)[1].split())
    assert said in Page(copy.parent / "index.html").text


def test_the_newest_run_comes_first(copy, tmp_path):
    older = Path(shutil.copytree(copy, tmp_path / "runs" / "a-older"))
    text = (older / "events.jsonl").read_text()
    (older / "events.jsonl").write_text(text.replace('"wall": "20', '"wall": "19'))
    entries, _ = runs.look_into(copy.parent)
    assert [entry.folder.name for entry in entries] == ["copy", "a-older"]


def test_list_of_one_run_says_where_to_look(recorded):
    code, said = formnet("list", recorded)
    assert (code, "is one run; give the folder that it is in" in said) == (2, True)


def test_list_without_runs(tmp_path):
    assert formnet("list", tmp_path / "none")[0] == 2
    code, said = formnet("list", tmp_path)
    assert (code, "no runs in" in said) == (0, True)
    assert not list(tmp_path.iterdir())


def test_a_run_keeps_the_index_of_its_folder(recorded):
    page = Page(recorded.parent / "index.html")
    assert [link["href"] for link in page.all("a")] == ["short/report.html"]
    assert [image["src"] for image in page.all("img")] == ["short/figures/thumbnail.png"]
    assert (recorded.parent / page.all("img")[0]["src"]).is_file()
    assert "FAILS: formation, heading, centroid" in page.text


def test_the_index_never_takes_the_place_of_another_page(copy):
    (copy.parent / "index.html").write_text("<h1>mine</h1>")
    assert "not formnet's" in report.leave(copy)
    assert "no index page" in formnet("list", copy.parent)[1]
    assert (copy.parent / "index.html").read_text() == "<h1>mine</h1>"


@pytest.mark.parametrize(
    ("kind", "expected", "holds", "word"),
    [
        ("completed", True, True, "holds"),
        ("completed", False, False, "FAILS"),
        ("completed", None, None, "observed"),
        ("completed, a robot lost", None, None, "lost"),
        ("completed, a robot lost", True, True, "holds"),
        ("diverged", False, True, "holds"),
        ("diverged", True, False, "diverged"),
        ("diverged", None, None, "diverged"),
        ("interrupted", True, None, "interrupted"),
        ("failed", True, None, "failed"),
        ("completed", True, None, "not judged"),
    ],
)
def test_standing(kind, expected, holds, word):
    kind, _, lost = kind.partition(", ")
    claims = {"heading": {"expected": expected, "holds": holds}}
    judged = made(kind=kind, claims=claims, lost=[1] if lost else [])
    assert runs.standing(judged, None, running=False) == word


# --- plot -----------------------------------------------------------------------------


@pytest.mark.long
def test_plot_draws_what_the_run_drew(recorded, tmp_path):
    assert formnet("plot", recorded, "--out", tmp_path / "again")[0] == 0
    drawn = {file.name: file.read_bytes() for file in (recorded / "figures").glob("*.png")}
    again = {file.name: file.read_bytes() for file in (tmp_path / "again").glob("*.png")}
    assert len(drawn) == 8
    assert again == drawn
    code, said = formnet("plot", recorded, "--out", tmp_path / "again")
    assert (code, "exists already" in said) == (2, True)
    code, said = formnet("plot", tmp_path)
    assert (code, "has no scenario.toml" in said) == (2, True)


# --- compare --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def another(tmp_path_factory):
    """The same with other gains, longer."""
    out = tmp_path_factory.mktemp("another") / "another"
    run(out, *SHORT, "law.beta=5.0", "duration_s=0.5")
    return out


@pytest.mark.long
def test_compare_tells_what_differs(recorded, another, copy, tmp_path):
    code, said = formnet("compare", recorded, copy, another, "--out", tmp_path / "out")
    assert code == 0
    with (tmp_path / "out" / "comparison.csv").open(newline="") as file:
        rows = {row[0]: row[1:] for row in csv.reader(file)}
    assert rows[""] == ["short", "copy", "another"]
    assert rows["beside short"] == ["–", "identical", "another scenario"]
    assert rows["law.beta"] == ["10", "10", "5"]
    assert rows["duration_s"] == ["0.4", "0.4", "0.5"]
    judged = json.loads((another / "verdict.json").read_text())
    assert float(rows["at the end: formation, Eq. 3 (m)"][2]) == pytest.approx(
        judged["formation_error_m"], rel=1e-2
    )
    assert rows["sha256"][0] == rows["sha256"][1] != rows["sha256"][2]
    text = (tmp_path / "out" / "comparison.md").read_text()
    assert "| law.beta | 10 | 10 | 5 |" in text
    assert (tmp_path / "out" / "errors.png").stat().st_size > 10_000
    assert "law.beta 10 10 5" in said
    assert formnet("compare", recorded, copy, "--out", tmp_path / "out")[0] == 2


def test_one_scenario_with_other_bits_is_the_first_difference(recorded, copy):
    table = pq.read_table(copy / "states.parquet")
    values = table.column("x_m").to_pylist()
    values[7] += 1e-12
    pq.write_table(table.set_column(2, "x_m", pa.array(values)), copy / "states.parquet")
    code, said = formnet("compare", recorded, copy)
    assert code == 1
    assert "t = 0.01 s (tick 10)" in said


def test_compare_needs_two(recorded):
    code, said = formnet("compare", recorded)
    assert (code, "at least two runs" in said) == (2, True)


def test_key_paths_are_those_of_set():
    scenario = load(SECTION5, SHORT)
    found = by_path(scenario)
    assert found["robots.3.damping"] == 1.0
    assert found["timeline[1].action"] == "kill"
    plain = {path: value for path, value in found.items() if "[" not in path}
    sets = [f"{path}={json.dumps(value)}" for path, value in plain.items()]
    again = by_path(loads(SECTION5.read_text(), overrides=sets))
    assert again == plain | {"timeline": []}


# --- export ---------------------------------------------------------------------------


def test_csv_holds_every_row(recorded, tmp_path):
    assert formnet("export", recorded, "--format", "csv", "--out", tmp_path / "csv")[0] == 0
    back = read_whole(recorded)

    def rows(name):
        with (tmp_path / "csv" / name).open(newline="") as file:
            return list(csv.DictReader(file))

    states = [[float(v) if v else None for v in row.values()] for row in rows("states.csv")]
    assert states == [list(sample) for sample in back.samples]
    for row, link in zip(rows("links.csv"), back.link_rows, strict=True):
        assert row["fate"] == link.fate
        assert row["t_usable_ns"] == ("" if link.t_usable_ns is None else str(link.t_usable_ns))
    events = rows("events.csv")
    assert [(float(e["t_s"]), e["event"]) for e in events[:-1]] == [
        (e.t_ns / 1e9, e.name) for e in back.events
    ]
    assert [json.loads(e["details"]) for e in events[:-1]] == [e.details for e in back.events]
    code, said = formnet("export", recorded, "--format", "csv", "--out", tmp_path / "csv")
    assert (code, "exists already" in said) == (2, True)


@pytest.fixture(scope="module")
def mcap(recorded, tmp_path_factory):
    """(schema name, topic, log time, publish time, message) of everything in an exported file."""
    from mcap.reader import make_reader

    file = tmp_path_factory.mktemp("mcap") / "run.mcap"
    assert formnet("export", recorded, "--format", "mcap", "--out", file)[0] == 0
    code, said = formnet("export", recorded, "--format", "mcap", "--out", file)
    assert (code, "exists already" in said) == (2, True)
    with file.open("rb") as stream:
        reader = make_reader(stream)
        found = list(reader.iter_messages(log_time_order=False))
    assert all(channel.message_encoding == "json" for _, channel, _ in found)
    assert {(schema.name, schema.encoding) for schema, _, _ in found} == {
        (name, "jsonschema") for name in foxglove.SCHEMAS
    }
    for schema, _, _ in found:
        assert json.loads(schema.data) == foxglove.SCHEMAS[schema.name]
    return [
        (schema.name, channel.topic, m.log_time, m.publish_time, json.loads(m.data))
        for schema, channel, m in found
    ]


def test_mcap_holds_every_sample_message_and_event(recorded, mcap):
    back = read_whole(recorded)
    states = [data for name, _, _, _, data in mcap if name == "formnet.State"]
    assert [tuple(state.values()) for state in states] == [tuple(s) for s in back.samples]
    links = [data for name, _, _, _, data in mcap if name == "formnet.Delivery"]
    assert sorted(repr(tuple(link.values())[:6]) for link in links) == sorted(
        repr(tuple(row)) for row in back.link_rows
    )
    events = [(at, data) for name, _, at, _, data in mcap if name == "foxglove.Log"]
    assert [(at, log["name"]) for at, log in events] == [
        *((e.t_ns, e.name) for e in back.events),
        (back.outcome.t_ns, back.outcome.kind),
    ]
    for (_, log), event in zip(events, back.events, strict=False):
        assert log["message"] == f"{event.name} {json.dumps(event.details, ensure_ascii=False)}"


def test_mcap_puts_everything_at_its_time(mcap):
    times = [at for _, _, at, _, _ in mcap]
    assert times == sorted(times)
    for name, topic, at, published, data in mcap:
        if name == "formnet.State":
            assert (at, topic) == (data["t_ns"], f"/robot_{data['robot']}/state")
        elif name == "formnet.Delivery":
            assert at == (data["t_usable_ns"] or data["t_sent_ns"])
            assert published == data["t_sent_ns"]
            assert topic == f"/links/{data['source']}_to_{data['destination']}"
        elif "timestamp" in data:
            assert data["timestamp"] == {"sec": at // 10**9, "nsec": at % 10**9}


def test_mcap_transforms_and_poses_are_the_states(recorded, mcap):
    at = {(s.t_ns, s.robot): s for s in read_whole(recorded).samples}
    transforms = [
        (t, item)
        for name, _, t, _, data in mcap
        if name == "foxglove.FrameTransforms"
        for item in data["transforms"]
    ]
    poses = [(t, topic, data) for name, topic, t, _, data in mcap if name == "foxglove.PoseInFrame"]
    assert len(transforms) == len(poses) == len(at)
    for (t, item), (t_pose, topic, pose) in zip(transforms, poses, strict=True):
        sample = at[t, int(item["child_frame_id"].removeprefix("robot_"))]
        assert (t_pose, topic) == (t, f"/robot_{sample.robot}/pose")
        assert item["translation"] == {"x": sample.x_m, "y": sample.y_m, "z": 0.0}
        assert pose["pose"]["position"] == item["translation"]
        turned = 2 * math.atan2(item["rotation"]["z"], item["rotation"]["w"])
        assert math.cos(turned - sample.heading_rad) == pytest.approx(1.0)


def test_mcap_errors_end_as_in_the_verdict(recorded, mcap):
    judged = json.loads((recorded / "verdict.json").read_text())
    errors = [data for name, _, _, _, data in mcap if name == "formnet.Errors"]
    assert errors[-1] == {
        "formation_m": judged["formation_error_m"],
        "heading_rad": judged["heading_error_rad"],
        "centroid_m": judged["centroid_error_m"],
    }
    v = [data["v"] for name, _, _, _, data in mcap if name == "formnet.Lyapunov"]
    assert len(v) == len(errors)
    assert v[-1] == pytest.approx(judged["lyapunov"]["final"])


def test_mcap_messages_are_what_their_schemas_say(mcap):
    kinds = {
        "number": (int, float, type(None)),
        "integer": (int, type(None)),
        "string": str,
        "boolean": bool,
        "array": list,
        "object": dict,
    }

    def agrees(schema, value):
        assert isinstance(value, kinds[schema["type"]])
        if isinstance(value, dict):
            assert value.keys() == schema["properties"].keys()
            for key, item in value.items():
                agrees(schema["properties"][key], item)
        elif isinstance(value, list):
            for item in value:
                agrees(schema["items"], item)

    for name, _, _, _, data in mcap:
        agrees(foxglove.SCHEMAS[name], data)


def test_mcap_of_what_diverged_has_null_for_what_is_no_number(recorded):
    back = read_whole(recorded)
    back.samples[-1] = back.samples[-1]._replace(x_m=math.inf, speed_mps=math.nan)
    found = list(foxglove.messages(back))
    json.dumps([message.data for message in found], allow_nan=False)
    last = [m.data for m in found if m.topic == f"/robot_{back.samples[-1].robot}/state"][-1]
    assert (last["x_m"], last["speed_mps"]) == (None, None)


def test_export_without_mcap_says_what_to_install(recorded, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap", None)
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    monkeypatch.delitem(sys.modules, "formnet.lab.scene.foxglove")
    monkeypatch.delattr("formnet.lab.scene.foxglove", raising=False)
    code, said = formnet("export", recorded, "--format", "mcap", "--out", tmp_path / "x.mcap")
    assert code == 2
    assert "pip install 'formnet[export]'" in said
    assert not (tmp_path / "x.mcap").exists()
