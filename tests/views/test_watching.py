"""The scene: run.rrd and the live stream read back, and watching that changes nothing."""

import json
import re
import shutil
import signal
import subprocess
import sys
import threading
import warnings

import numpy as np
import psutil
import pytest
import rerun as rr
from in_process import formnet
from playwright.sync_api import sync_playwright
from processes import missing, until
from rerun.chunk import RrdReader

from formnet.formation.briefing.resolving import resolve
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.rows import LinkRow, LinkRows, Sample, Samples
from formnet.formation.scenario.loading import load
from formnet.formation.wire import bus
from formnet.lab.launch.distributed import Distributed
from formnet.lab.launch.launch import LocalChild, Place, free_port
from formnet.lab.machines import keys
from formnet.lab.runs.recording import Recording, trajectory_sha256
from formnet.lab.runs.tables import read_states
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.lab.scene.blueprint import scale_bar
from formnet.lab.scene.rrd import RunFile
from formnet.lab.scene.scene import Scene
from formnet.lab.scene.viewer import binary

PATIENCE_S = 60.0
SECTION5 = CONFIGS / "paper" / "section5-delay.toml"
HAPPENINGS = (
    'timeline=[{action="cut", at_s=0.5, links=[[1, 2]], heal_after_s=0.4}, '
    '{action="kill", at_s=1.0, robots=4, restart_after_s=0.5}]'
)


def columns(file, entity, component):
    """(seconds of simulated time, value) of a component, in the order of time."""
    found = []
    for chunk in RrdReader(str(file)).stream():
        if chunk.entity_path == entity and "sim_time" in chunk.timeline_names:
            table = chunk.to_record_batch()
            if component in table.schema.names:
                t_s = (table.column("sim_time").cast("int64").to_numpy() / 1e9).tolist()
                assert table.column("wall_time").null_count == 0
                found += zip(t_s, table.column(component).to_pylist(), strict=True)
    return sorted(found, key=lambda entry: entry[0])


def check_scene(file, folder, robots):
    """Every shown position is that of states.parquet, and every event is there."""
    states = {}
    for sample in read_states(folder):
        states.setdefault(round(sample.t_ns / 1e9, 6), []).append((sample.x_m, -sample.y_m))
    shown = columns(file, "/field/robots", "Points2D:positions")
    assert len(shown) > 50
    for t_s, positions in shown:
        assert np.array_equal(np.float32(positions), np.float32(states[round(t_s, 6)])), (
            f"at {t_s} s"
        )
        assert len(positions) == robots
    assert round(shown[-1][0], 6) == max(states)
    lines = (folder / "events.jsonl").read_text().splitlines()
    happened = sorted((round(e["t_s"], 6), e["event"]) for e in map(json.loads, lines))
    told = columns(file, "/events", "TextLog:text")
    assert sorted((round(t, 6), text[0].partition(":")[0]) for t, text in told) == happened
    return shown


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    out = tmp_path_factory.mktemp("watching") / "run"
    code, said = formnet(
        "run",
        SECTION5,
        "--inline",
        "--no-figures",
        "--set",
        "duration_s=3",
        "--set",
        HAPPENINGS,
        "--out",
        out,
    )
    assert code in (0, 1), said
    return out


@pytest.mark.processes
def test_a_run_s_file_is_its_states_and_events(recorded):
    file = recorded / "run.rrd"
    shown = check_scene(file, recorded, 5)
    assert len(shown) == 301
    verified = subprocess.run([binary(), "rrd", "verify", file], capture_output=True, text=True)
    assert verified.returncode == 0, verified.stderr
    judged = json.loads((recorded / "verdict.json").read_text())
    t_s, error = columns(file, "/errors/formation", "Scalars:scalars")[-1]
    assert t_s == 3.0
    assert error[0] == pytest.approx(np.log10(judged["formation_error_m"]), abs=1e-12)
    t_s, v = columns(file, "/lyapunov/v", "Scalars:scalars")[-1]
    assert v[0] == pytest.approx(np.log10(judged["lyapunov"]["final"]), abs=1e-12)


@pytest.mark.processes
def test_the_pattern_is_its_places_and_the_edges_between_them(recorded):
    edges = load(SECTION5).formation.edges
    assert len(edges) == 5
    strips = dict(columns(recorded / "run.rrd", "/field/pattern", "LineStrips2D:strips"))
    places = dict(columns(recorded / "run.rrd", "/field/places", "Points2D:positions"))
    assert strips.keys() == places.keys()
    for t_s, lines in strips.items():
        at = np.array(places[t_s])
        assert np.array(lines) == pytest.approx(
            np.array([at[[a - 1, b - 1]] for a, b in edges]), abs=1e-4
        )


@pytest.mark.processes
def test_a_cut_link_is_dashed_and_a_dead_robot_grey(recorded):
    file = recorded / "run.rrd"
    strips = dict(columns(file, "/field/links", "LineStrips2D:strips"))
    whole = len(strips[0.4])
    assert {t for t, lines in strips.items() if len(lines) > whole} == {
        t for t in strips if 0.5 <= t < 0.9
    }
    colours = columns(file, "/field/robots", "Points2D:colors")
    grey = {t for t, five in colours if five[3] == 0x9A9A9AFF}
    assert grey == {t for t, _ in colours if 1.0 <= t < 1.5}
    ages = dict(columns(file, "/field/links", "LineStrips2D:colors"))
    assert len(set(ages[0.3])) == 1  # all were heard alike
    assert len(set(ages[0.85])) > 1  # the cut one is older


@pytest.mark.processes
@pytest.mark.parametrize("live", [True, False])
def test_who_watches_live_sees_links_where_the_robots_are(recorded, tmp_path, live):
    """What became of messages is known later; a file waits for it."""
    file = tmp_path / "seen.rrd"
    stream = rr.RecordingStream("formnet")
    stream.save(file)
    scene = Scene(load(SECTION5), stream, live=live)
    samples = [sample for sample in read_states(recorded) if sample.t_ns <= 2_000_000_000]
    scene.take(Samples(samples), 0)
    scene.flush()
    stream.flush()
    stream.disconnect()
    links = columns(file, "/field/links", "LineStrips2D:strips")
    robots = columns(file, "/field/robots", "Points2D:positions")
    assert robots[-1][0] == 2.0
    assert links[-1][0] == (2.0 if live else 0.8)
    ends = np.array(links[-1][1]).reshape(-1, 2)
    there = np.array(dict(robots)[links[-1][0]])
    gaps = np.linalg.norm(ends[:, None] - there[None], axis=-1).min(axis=1)
    assert gaps.max() < 1.5  # m, of a field of 60: beside its robot


@pytest.mark.parametrize("size_m", [0.7, 3.0, 60.0, 2000.0])
def test_the_scale_is_a_round_number_in_sight(size_m):
    scenario = load(SECTION5)
    bar, length = scale_bar(scenario, half_m := size_m / 2)
    assert np.linalg.norm(bar[1] - bar[0]) == pytest.approx(length)
    assert 0.2 * half_m < length <= 0.5 * half_m
    assert f"{length:.0e}"[0] in "125"
    middle = scale_bar(scenario, 1e-9)[0][0]
    assert np.abs(bar - middle).max() < half_m


@pytest.mark.processes
def test_losses_and_delays_of_links(recorded):
    file = recorded / "run.rrd"
    delays = columns(file, "/links/delay/1-2", "Scalars:scalars")
    heard = [ms for _, (ms,) in delays if not np.isnan(ms)]
    assert heard == pytest.approx([100.0] * len(heard), abs=1e-9)
    assert {t for t, (ms,) in delays if np.isnan(ms)} == {
        t for t, _ in delays if 0.65 < t < 1.05
    }  # a stretch is told at its end
    losses = columns(file, "/links/loss/1-2", "Scalars:scalars")
    assert {100.0} == {share for t, (share,) in losses if 0.65 < t < 0.85}
    assert {0.0} == {share for t, (share,) in losses if t < 0.45}


@pytest.mark.long
def test_the_file_of_a_long_run_of_many_robots_is_bounded(tmp_path):
    """As the documentation says: 60 bytes a cell and 5 MB."""
    text = "\n".join(
        f"[[robots]]\nid = {k}\noffset_m = [{k}.0, 0.0]\nstart = {{ x_m = {k}.0, y_m = 1.0 }}"
        for k in range(1, 41)
    )
    edges = [[k, k + 1] for k in range(1, 40)]
    file = tmp_path / "many.toml"
    file.write_text(
        f'name = "many"\nduration_s = 200.0\nformation = {{ edges = {edges} }}\n{text}\n'
    )
    scenario = load(file)
    random = np.random.default_rng(1)  # the worst for a compressor
    scene = RunFile(tmp_path, scenario)
    for start in range(0, 20001, 1000):
        ticks = range(start, min(start + 1000, 20001))
        states = iter(random.normal(size=(len(ticks) * 40, 5)).tolist())
        scene.take(
            Samples(
                [
                    Sample(tick * 10**7, robot, *next(states), None, None)
                    for tick in ticks
                    for robot in scenario.ids
                ]
            ),
            0,
        )
        scene.take(
            LinkRows(
                [
                    LinkRow(tick * 10**7, tick * 10**7 + 10**6, *link, tick, "delivered")
                    for tick in ticks[::10]
                    for link in scenario.directed_links
                ]
            ),
            0,
        )
        scene.refresh()
    scene.take(Outcome("completed", 200 * 10**9, None, ""), 0)
    scene.close(None)
    frames = columns(tmp_path / "run.rrd", "/field/robots", "Points2D:positions")
    assert 1000 <= len(frames) <= 3001
    cells = len(frames) * (40 + 78)
    assert (tmp_path / "run.rrd").stat().st_size < 60 * cells + 5e6


@pytest.mark.processes
def test_a_run_that_is_killed_leaves_a_file_that_can_be_read(tmp_path):
    out = tmp_path / "run"
    run = subprocess.Popen(
        [sys.executable, "-m", "formnet", "run", "--no-figures", str(SECTION5), "--out", str(out)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    file = out / "run.rrd"

    def frames():
        return len(columns(file, "/field/robots", "Points2D:positions"))

    def a_piece_is_there():
        try:
            return file.exists() and file.stat().st_size > 100_000 and frames() > 10
        except RuntimeError:  # in the middle of being written; the next comes in two seconds
            return False

    until(a_piece_is_there)
    there = file.stat().st_size
    (writer,) = (
        child
        for child in psutil.Process(run.pid).children()
        if "formnet.lab.scene.rrd" in child.cmdline()
    )
    run.kill()
    run.wait()
    writer.wait(PATIENCE_S)  # it writes what it has got, and ends
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of a file that was not completed
        assert frames() > 10
    cut, whole = tmp_path / "cut.rrd", tmp_path / "whole.rrd"
    written = file.read_bytes()
    assert len(written) > there + 1
    cut.write_bytes(written[: (there + len(written)) // 2])  # in the middle of a write
    for words in (["merge", cut, "-o", whole], ["verify", whole]):
        done = subprocess.run([binary(), "rrd", *words], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    assert len(columns(whole, "/field/robots", "Points2D:positions")) > 10
    code, said = formnet("monitor", out)
    assert code == 2, said  # live.json is there still, the run is not
    assert "cannot reach" in said


# --- live --------------------------------------------------------------------------------------------


def watched_run(folder, monitor_options, *sets, meanwhile=lambda monitor: None, secure=None):
    """A distributed run that a monitor joins before the first tick; both, when they are over."""
    scenario = load(SECTION5, ["duration_s=3", HAPPENINGS, *sets])
    recording = Recording(folder / "run", scenario)
    monitors = []

    def begun(endpoint, run):
        secured = [] if secure is None else ["--keys", str(secure)]
        monitor = LocalChild(
            [
                sys.executable,
                "-m",
                "formnet",
                "monitor",
                "--connect",
                endpoint,
                "--run",
                run,
                "--leash",
                *monitor_options,
                *secured,
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        monitors.append(monitor)
        line = monitor.stdout.readline().decode()
        assert line.startswith(f"watching {run}"), line + monitor.stdout.read().decode()
        meanwhile(monitor)

    scheme = "tcp" if secure is None else "tls"
    place = Place(endpoint=f"{scheme}/127.0.0.1:{free_port()}", keys=secure) if secure else Place()
    outcome = Distributed(place=place, begun=begun).run(resolve(recording.scenario), recording)
    recording.save()
    assert outcome.kind == "completed", outcome
    return recording, monitors[0]


@pytest.mark.processes
@pytest.mark.parametrize("secured", [False, True])
def test_what_is_seen_live_is_what_is_recorded(tmp_path, recorded, secured):
    if secured:
        keys.make(tmp_path / "keys", range(1, 6), [], 30)
    recording, monitor = watched_run(
        tmp_path,
        ["--save", str(tmp_path / "seen.rrd")],
        secure=tmp_path / "keys" if secured else None,
    )
    assert monitor.wait(PATIENCE_S) == 0, monitor.stdout.read().decode()
    check_scene(tmp_path / "seen.rrd", tmp_path / "run", 5)
    judged = json.loads((recorded / "verdict.json").read_text())
    assert trajectory_sha256(recording.samples) == judged["trajectory_sha256"]
    assert (
        columns(tmp_path / "seen.rrd", "/lyapunov/v", "Scalars:scalars")[-1]
        == columns(recorded / "run.rrd", "/lyapunov/v", "Scalars:scalars")[-1]
    )


@pytest.mark.processes
@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_monitor_that_hangs_or_dies_is_not_noticed(tmp_path, recorded, number):
    recording, monitor = watched_run(
        tmp_path,
        ["--save", str(tmp_path / "seen.rrd")],
        meanwhile=lambda monitor: monitor.send_signal(number),
    )
    monitor.kill()
    monitor.wait()
    judged = json.loads((recorded / "verdict.json").read_text())
    assert trajectory_sha256(recording.samples) == judged["trajectory_sha256"]
    assert not [event for event in recording.events if event.name == "waiting" and event.t_ns]


@pytest.mark.processes
def test_who_comes_late_gets_the_events_before_and_sees_the_rest(tmp_path):
    out, seen = tmp_path / "run", tmp_path / "seen.rrd"
    run = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "formnet",
            "run",
            str(SECTION5),
            "--no-figures",
            "--out",
            str(out),
            "--set",
            HAPPENINGS,
            "--set",
            "duration_s=12",
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    events = out / "events.jsonl"
    until(lambda: events.exists() and "restart" in events.read_text())
    monitor = subprocess.run(
        [sys.executable, "-m", "formnet", "monitor", str(out), "--save", str(seen)],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert run.wait(PATIENCE_S) in (0, 1)
    assert monitor.returncode == 0, monitor.stdout + monitor.stderr
    told = [text[0].partition(":")[0] for _, text in columns(seen, "/events", "TextLog:text")]
    happened = [json.loads(line)["event"] for line in events.read_text().splitlines()]
    assert sorted(told) == sorted(happened)
    shown = columns(seen, "/field/robots", "Points2D:positions")
    assert shown[0][0] > 1.0
    assert shown[-1][0] == 12.0
    assert not (out / "live.json").exists()


@pytest.mark.browser
@pytest.mark.processes
def test_in_a_browser_the_scene_moves(tmp_path):
    """The page is open during the run; its field is another picture a little later."""
    browser = shutil.which("chromium")
    if browser is None:
        missing("chromium")
    run = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "formnet",
            "run",
            str(CONFIGS / "yard.toml"),
            "--web",
            "--out",
            str(tmp_path / "run"),
            "--set",
            "duration_s=60",
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    said = []
    reader = threading.Thread(target=lambda: said.extend(run.stdout), daemon=True)
    reader.start()
    try:
        until(lambda: re.search(r"http://127.0.0.1:\S+", " ".join(said)))
        page_url = re.search(r"http://127.0.0.1:\S+", " ".join(said))[0]
        with sync_playwright() as tool:
            chromium = tool.chromium.launch(
                executable_path=browser,
                args=[
                    "--no-sandbox",
                    "--enable-unsafe-swiftshader",
                    "--use-angle=swiftshader",
                    "--ignore-gpu-blocklist",
                    "--disable-background-networking",
                    "--disable-quic",
                    "--disable-component-update",
                    "--disable-sync",
                    "--no-first-run",
                ],
            )
            page = chromium.new_page(viewport={"width": 1000, "height": 640})
            page.goto(page_url + "&renderer=webgl")
            field = {"x": 5, "y": 60, "width": 560, "height": 380}
            pictures = set()

            def another():
                pictures.add(page.screenshot(clip=field))
                return len(pictures) >= 6  # loading, connecting, and then robots on their way

            until(another)
            assert run.poll() is None  # it went on meanwhile
            chromium.close()
        run.send_signal(signal.SIGINT)
        run.wait(PATIENCE_S)
    finally:
        run.kill()
        run.wait()


@pytest.mark.processes
def test_a_replay_that_is_ended_takes_its_viewer_along(recorded):
    replay = subprocess.Popen(
        [sys.executable, "-m", "formnet", "replay", str(recorded), "--web"],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert "until Ctrl-C" in replay.stdout.readline()
    (viewer,) = psutil.Process(replay.pid).children()
    replay.terminate()
    assert replay.wait(PATIENCE_S) == 0
    assert not viewer.is_running()


# --- what cannot be watched ----------------------------------------------------------------------------


def test_what_cannot_be_watched_is_said(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    for arguments, words in [
        (["monitor"], "runs: no run in progress there"),
        (["monitor", "nonsuch"], "nonsuch: no such folder"),
        (["monitor", "empty"], "empty: no run in progress there"),
        (["monitor", "empty", "--connect", "tcp/127.0.0.1:1"], "it excludes --connect"),
        (["monitor", "--view", "--web"], "--view and --web exclude each other"),
        (["monitor", "--connect", "tcp/192.0.2.1:1"], "off loopback"),
        (["replay", "empty"], "has no run.rrd"),
        (["replay", "nonsuch"], "nonsuch: no such folder"),
        (["replay", str(SECTION5)], "is a file"),
        (["run", str(SECTION5), "--inline", "--web"], "use formnet replay RUN afterwards"),
    ]:
        code, said = formnet(*arguments)
        assert (code, words in said) == (2, True), said


@pytest.mark.processes
def test_where_no_run_goes_on_nothing_can_be_watched(monkeypatch):
    monkeypatch.setattr("formnet.lab.watch.monitor._SEARCH_S", 0.5)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with bus.session(listen=endpoint):
        code, said = formnet("monitor", "--connect", endpoint, "--web")
    assert code == 2
    assert f"{endpoint}: no run in progress here" in said
