"""What only processes can show: determinism across buses, deaths, signals, strangers on the bus."""

import os
import re
import shutil
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from plugin import install
from processes import Run, missing, until

from formnet.agent.law import Command
from formnet.formation.briefing.resolving import resolve
from formnet.formation.briefing.situation import Situation
from formnet.formation.records.events import Rejected, Waiting
from formnet.formation.records.rows import Samples
from formnet.formation.records.stream import Record, read
from formnet.formation.scenario.loading import load
from formnet.formation.wire import bus
from formnet.lab.launch.inline import Inline
from formnet.lab.launch.launch import free_port
from formnet.lab.runs import build
from formnet.lab.runs.recording import Recording
from formnet.lab.scenarios.packaged import CONFIGS

pytestmark = pytest.mark.processes

SECTION5 = "paper/section5-delay"
EVERY_ACTION = "network/every-action"
EVERY_FAULT = "faults/every-fault"
RANDOM_NETWORK = (
    'network.default.delay={distribution="uniform", low_s=0.0, high_s=0.03}',
    "network.default.loss.probability=0.2",
)


@pytest.fixture
def start(tmp_path) -> Iterator[Callable[..., Run]]:
    """Start runs; whatever is left of them afterwards is killed."""
    runs: list[Run] = []

    def starter(
        name: str, *arguments: str, env: dict[str, str] | None = None, scenario: str = SECTION5
    ) -> Run:
        overrides = [part for text in arguments if "=" in text for part in ("--set", text)]
        flags = [text for text in arguments if "=" not in text]
        file = CONFIGS / f"{scenario}.toml"
        runs.append(Run(tmp_path / name, file, *flags, *overrides, **(env or {})))
        return runs[-1]

    yield starter
    for run in runs:
        run.end()


@contextmanager
def load_on_every_core() -> Iterator[None]:
    busy = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"])
        for _ in range(2 * (os.cpu_count() or 1))
    ]
    try:
        yield
    finally:
        for process in busy:
            process.kill()


def test_distributed_inline_and_loaded_runs_are_bit_identical(start):
    """Random delays that reorder, and loss, so that every message's fate matters."""
    short = ("duration_s=0.6", *RANDOM_NETWORK)
    distributed = start("distributed", *short)
    assert distributed.wait() == 1  # 0.6 s is too short for the claims
    inline = start("inline", "--inline", *short)
    assert inline.wait() == 1
    with load_on_every_core():
        loaded = start("loaded", *short)
        assert loaded.wait() == 1
    hashes = [run.verdict()["trajectory_sha256"] for run in (distributed, inline, loaded)]
    assert len(set(hashes)) == 1
    assert distributed.verdict()["motion"]["closest"] is not None
    for run in (inline, loaded):
        assert run.verdict()["motion"] == distributed.verdict()["motion"]
    tables = [pq.read_table(run.out / "links.parquet") for run in (distributed, inline, loaded)]
    assert tables[0].num_rows == 10 * 61
    assert tables[0].equals(tables[1])
    assert tables[0].equals(tables[2])
    assert {"delivered", "lost: random", "in flight"} == set(tables[0]["fate"].to_pylist())
    # A different seed is a different network.
    other = start("other", "--inline", *short, "seed=2")
    other.wait()
    assert other.verdict()["trajectory_sha256"] != hashes[0]


def test_a_timeline_is_the_same_in_a_distributed_and_an_inline_run(start, root):
    """Every action there is, as far as their messages' fates go."""
    coarse = ("clock.control_period_s=0.01",)
    runs = [
        start("distributed", *coarse, scenario=EVERY_ACTION),
        start("inline", "--inline", *coarse, scenario=EVERY_ACTION),
    ]
    assert [run.wait() for run in runs] == [0, 0]
    assert len({run.verdict()["trajectory_sha256"] for run in runs}) == 1
    planned = [entry.what for entry in load(root / "configs" / f"{EVERY_ACTION}.toml").plan]
    for run in runs:
        assert [e["what"] for e in run.events() if e["event"] == "network"] == planned
    one, other = (pq.read_table(run.out / "links.parquet") for run in runs)
    assert one.equals(other)
    assert {"delivered", "lost: random", "lost: cut", "in flight"} == set(one["fate"].to_pylist())


def test_faults_are_the_same_in_a_distributed_an_inline_and_a_loaded_run(start):
    """Processes that are really killed, stopped and started anew, at exact ticks."""
    until_all_are_back = "duration_s=9.8"
    runs = [
        start("distributed", until_all_are_back, scenario=EVERY_FAULT),
        start("inline", "--inline", until_all_are_back, scenario=EVERY_FAULT),
    ]
    codes = [run.wait() for run in runs]
    with load_on_every_core():
        runs.append(start("loaded", until_all_are_back, scenario=EVERY_FAULT))
        codes.append(runs[-1].wait())
    assert codes == [1, 1, 1]  # too short for the claims
    assert len({run.verdict()["trajectory_sha256"] for run in runs}) == 1
    assert len({str(run.verdict()["motion"]) for run in runs}) == 1
    tables = [pq.read_table(run.out / "links.parquet") for run in runs]
    assert tables[0].equals(tables[1])
    assert tables[0].equals(tables[2])
    assert {"delivered", "in flight", "lost: receiver down"} == set(tables[0]["fate"].to_pylist())
    verbs = ("kill", "restart", "pause", "resume")
    happened = [
        [(e["t_s"], e["event"], e["robots"]) for e in run.events() if e["event"] in verbs]
        for run in runs
    ]
    assert happened[0] == happened[1] == happened[2]


def test_a_long_pause_fills_no_buffer_and_changes_no_bit(start):
    """28,000 broadcasts to a stopped process; the system's buffers hold about 20,000."""
    long = (
        "duration_s=8.5",
        "clock.broadcast_period_s=0.001",
        "formation.edges=[[1,2],[1,3],[1,4],[1,5],[2,3],[3,4],[4,5],[5,2]]",
        'timeline=[{action="pause", at_s=0.5, robots=1, resume_after_s=7.0}]',
    )
    runs = [start("inline", "--inline", *long), start("distributed", *long)]
    codes = [run.wait(120) for run in runs]
    assert codes == [1, 1]  # too short for the claims
    assert len({run.verdict()["trajectory_sha256"] for run in runs}) == 1
    one, other = (pq.read_table(run.out / "links.parquet") for run in runs)
    assert one.equals(other)


def test_a_plant_that_hangs_ends_the_run(start):
    run = start("hung", "run.patience_s=0.5", 'timeline=[{action="cut", at_s=0.5, links=[[1, 2]]}]')
    run.until_event("network")
    run.child("plant").suspend()
    assert run.wait(60) == 3
    assert (
        "the plant reported nothing for 11.5 s and was killed" in run.verdict()["outcome"]["reason"]
    )
    assert run.verdict()["simulated_s"] > 0


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
def test_the_rest_run_on_without_a_robot_that_is_lost(start, number):
    run = start("lost", "duration_s=4.0", "run.patience_s=1.0")
    run.until_event("started")
    stopped = run.child("agent", "--robot", "3")
    stopped.send_signal(number)
    assert run.wait(30) == 1  # too short for the claims
    (lost,) = [event for event in run.events() if event["event"] == "lost"]
    verdict = run.verdict()
    assert verdict["outcome"]["kind"] == "completed"
    assert verdict["robots"]["judged"] == [1, 2, 4, 5]
    assert [item["robot"] for item in verdict["robots"]["lost"]] == [3]
    assert verdict["simulated_s"] == 4.0
    assert f"lost at t = {lost['t_s']:.3f} s: robot 3" in run.output()
    states = pq.read_table(run.out / "states.parquet")
    assert states.num_rows == 5 * 401
    links = pq.read_table(run.out / "links.parquet").to_pylist()
    sent_by_3 = [row["t_sent_ns"] for row in links if row["source"] == 3]
    assert max(sent_by_3, default=0) <= lost["t_s"] * 1e9
    fates = Counter((row["source"], row["destination"], row["sequence"]) for row in links)
    assert set(fates.values()) == {1}
    assert not stopped.is_running()


def test_a_robot_lost_before_its_planned_restart_comes_back_then(start):
    plan = 'timeline=[{action="kill", at_s=2.0, robots=3, restart_after_s=1.0}]'
    run = start("back", "duration_s=4.0", plan)
    run.until_event("started")
    run.child("agent", "--robot", "3").kill()
    assert run.wait(30) == 1
    kinds = [event["event"] for event in run.events()]
    assert kinds.count("restart") == 1
    assert run.verdict()["robots"]["judged"] == [1, 2, 3, 4, 5]


def test_a_compiled_module_older_than_its_source_is_refused(root, tmp_path):
    """Before anything of the command is imported: this checkout has nothing that it needs."""
    (tmp_path / "setup.py").touch()
    needed = (
        "formnet/__init__.py",
        "formnet/__main__.py",
        "lab/__init__.py",
        "lab/cli.py",
        "lab/commands/run/laws.py",
        "lab/program.py",
        "lab/text/__init__.py",
        "lab/text/streams.py",
        "lab/runs/__init__.py",
        "lab/runs/build.py",
        "lab/runs/exits.py",
    )
    for name in needed:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes((root / name).read_bytes())
    (tmp_path / "formnet" / "lab").symlink_to(tmp_path / "lab")
    (tmp_path / "formnet" / "netem").symlink_to(root / "netem")
    source, built = tmp_path / "agent" / "robot.py", tmp_path / "agent" / "robot.cpython-3.so"
    source.parent.mkdir()
    for path, age in ((built, 100), (source, 200)):
        path.touch()
        os.utime(path, (age, age))
    for said in (
        "agent/robot.py is newer than its compiled module: run `make build`",
        "was compiled from a source that no longer exists: delete it",
    ):
        run = subprocess.run(
            [sys.executable, "-m", "formnet", "laws"], cwd=tmp_path, capture_output=True, text=True
        )
        assert run.returncode == 2
        assert said in run.stderr
        source.unlink(missing_ok=True)


def test_damaged_and_doubled_broadcasts_are_survived_and_counted(start):
    network = (
        'network.default={preset="wifi", duplicate={probability=0.2}, corrupt={probability=0.3}}'
    )
    runs = [
        start(kind, "duration_s=0.6", network, *more)
        for kind, more in (("distributed", ()), ("inline", ("--inline",)))
    ]
    tables = []
    for run in runs:
        assert run.wait() == 1  # too short for the claims
        tables.append(pq.read_table(run.out / "links.parquet"))
        reasons = {e["reason"] for e in run.events() if e["event"] == "rejected"}
        assert "damaged: its checksum is another" in reasons
    assert runs[0].verdict()["trajectory_sha256"] == runs[1].verdict()["trajectory_sha256"]
    assert tables[0].equals(tables[1])
    assert {"delivered", "duplicated", "corrupted"} <= set(tables[0]["fate"].to_pylist())


def test_compiled_and_interpreted_runs_are_bit_identical(start, root, tmp_path):
    """An install compiles the hot path where it can; the source alone must give the same bits."""
    if not build.compiled():
        missing("gcc")
    shutil.copytree(
        root / "formnet", tmp_path / "source" / "formnet", ignore=shutil.ignore_patterns("*.so")
    )
    short = ("--inline", "duration_s=0.6", *RANDOM_NETWORK)
    alone = {"PYTHONPATH": str(tmp_path / "source"), "PYTHONSAFEPATH": "1"}
    interpreted = start("interpreted", *short, env=alone)
    compiled = start("compiled", *short)
    hashes = []
    for run in (interpreted, compiled):
        assert run.wait() == 1  # too short for the claims
        hashes.append((run.verdict()["trajectory_sha256"], run.verdict()["motion"]))
        assert run.verdict()["versions"]["compiled"] == (run is compiled)
    assert hashes[0] == hashes[1]


def test_a_run_is_eight_processes_and_leaves_none(start):
    run = start("eight", "duration_s=2.0")
    run.until_event("started")
    children = run.children()
    assert len(children) == 7
    run.wait()
    assert not [child for child in children if child.is_running()]


def test_killed_robot_ends_the_run_with_its_name_and_the_data(start):
    run = start("killed", "run.on_unscheduled_loss=abort")
    run.until_event("started")
    run.child("agent", "--robot", "3").kill()
    assert run.wait(30) == 3
    lost = run.events()[-1]
    assert (lost["event"], lost["robot"]) == ("lost", 3)
    assert f"lost at t = {lost['t_s']:.3f} s: robot 3" in run.output()
    verdict = run.verdict()
    assert verdict["outcome"]["robot"] == 3
    assert verdict["claims"]["formation"]["observed"] is None
    states = pq.read_table(run.out / "states.parquet")
    assert states.num_rows % 5 == 0
    if states.num_rows:
        assert states["t_ns"][-1].as_py() <= lost["t_s"] * 1e9
    pq.read_table(run.out / "links.parquet")


def test_killed_launcher_leaves_no_process_behind(start):
    run = start("orphans")
    run.until_event("started")
    children = run.children()
    assert len(children) == 7
    run.process.kill()
    assert until(lambda: not any(c.is_running() for c in children), "the end", timeout_s=10) < 5.0


def test_killed_launcher_takes_even_a_stopped_robot_along(start):
    if sys.platform != "linux":
        pytest.skip("needs prctl(PR_SET_PDEATHSIG)")
    run = start("stopped-orphan")
    run.until_event("started")
    children = run.children()
    run.child("agent", "--robot", "2").suspend()
    run.process.kill()
    assert until(lambda: not any(c.is_running() for c in children), "the end", timeout_s=10) < 5.0


def test_killed_plant_ends_the_run(start):
    run = start("plantless")
    run.until_event("started")
    run.child("plant").kill()
    assert run.wait(30) == 3
    assert "the plant was killed by signal 9" in run.output()
    assert run.verdict()["motion"] is None
    pq.read_table(run.out / "states.parquet")


@pytest.mark.parametrize("mode", [(), ("--inline",)], ids=["distributed", "inline"])
def test_interrupt_stops_everything_within_two_seconds(start, mode):
    run = start("interrupted", *mode)
    run.until_event("started")
    children = run.children()
    run.process.send_signal(signal.SIGINT)
    begin = time.monotonic()
    assert run.wait(30) == 130
    assert time.monotonic() - begin < 2.0
    assert not [child for child in children if child.is_running()]
    assert run.verdict()["outcome"]["kind"] == "interrupted"
    assert [e["event"] for e in run.events()][-2:] == ["extremes", "interrupted"]
    assert pq.read_table(run.out / "states.parquet").num_rows % 5 == 0
    assert "Traceback" not in run.output()


@pytest.mark.parametrize("when", ["joining", "running"])
def test_a_stopped_robot_is_named_and_the_run_goes_on_when_it_does(start, when):
    reference = start("reference", "--inline", "duration_s=0.5")
    reference.wait()
    run = start("waiting", "duration_s=0.5")
    if when == "joining":
        until(lambda: len(run.children()) == 7, "the children", run.output)
    else:
        run.until_event("started")
    robot = run.child("agent", "--robot", "3")
    robot.suspend()
    run.until_event("waiting")
    robot.resume()
    assert run.wait() == 1
    assert next(e["robots"] for e in run.events() if e["event"] == "waiting") == [3]
    assert "for robot 3" in run.output()
    assert run.verdict()["trajectory_sha256"] == reference.verdict()["trajectory_sha256"]


def test_strangers_on_the_bus_are_refused_counted_and_change_nothing(start, root, tmp_path):
    """A session of our own joins the hub and shouts on a robot's and the plant's keys."""
    reference = start("reference", "--inline", "duration_s=1.0")
    reference.wait()
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    name = "by-hand"
    out = tmp_path / "record"
    plant, *agents = by_hand(root, endpoint, name, out, "duration_s=1.0")
    keys = bus.Keys(name)
    with bus.session(connect=endpoint) as session:
        while plant.poll() is None:
            session.put(keys.broadcast(1), b"\xc1 not msgpack")
            session.put(keys.from_robot(2), b"nonsense")
            time.sleep(0.02)
    assert [p.wait(30) for p in (plant, *agents)] == [0] * 6
    with out.open("rb") as stream:
        records = list(read(stream, range(1, 6)))
    rejected = {(record.robot, record.source) for record in records if isinstance(record, Rejected)}
    assert {(2, 1), (5, 1), ("plant", 2)} <= rejected
    samples = [row for record in records if isinstance(record, Samples) for row in record.rows]
    from formnet.lab.runs.recording import trajectory_sha256

    assert trajectory_sha256(samples) == reference.verdict()["trajectory_sha256"]


def by_hand(root: Path, endpoint: str, name: str, out: Path, *overrides: str) -> list:
    """A plant and five agents, started one by one as a user would in six terminals."""
    sets = [part for text in overrides for part in ("--set", text)]
    command = [sys.executable, "-m", "formnet"]
    processes = [
        subprocess.Popen(
            [
                *command,
                "plant",
                f"configs/{SECTION5}.toml",
                "--listen",
                endpoint,
                "--run",
                name,
                "--record",
                str(out),
                *sets,
            ],
            cwd=root,
        )
    ]
    processes += [
        subprocess.Popen(
            [*command, "agent", "--robot", str(robot), "--connect", endpoint, "--run", name],
            cwd=root,
        )
        for robot in range(1, 6)
    ]
    return processes


def install_law(folder: Path, body: str) -> dict[str, str]:
    """A plug-in package with one law; returns the environment in which it is installed."""
    source = textwrap.dedent(f"""
        class Law:
            def __init__(self, situation): self.robot = situation.robot
            def command(self, now_ns, own, heard):
                {body}
        """)
    install(folder, "broken", source)
    return {"PYTHONPATH": str(folder)}


@pytest.mark.parametrize(
    ("mode", "after_ns"),
    [("distributed", 10**7), ("distributed", 12 * 10**6), ("inline", 12 * 10**6), ("realtime", 0)],
    ids=["distributed, with a broadcast", "distributed", "inline", "realtime"],
)
def test_a_plug_in_law_that_raises_ends_the_run_with_its_name(start, tmp_path, mode, after_ns):
    env = install_law(
        tmp_path,
        f"return (1 / 0, 0.0) if self.robot == 4 and now_ns >= {after_ns} else (0.0, 0.0)",
    )
    options = {"inline": ("--inline",), "realtime": ("clock.mode=realtime",)}.get(mode, ())
    run = start("plug-in", "law.kind=broken", "duration_s=2.0", *options, env=env)
    assert run.wait() == 3
    said = "robot 4: ZeroDivisionError: division by zero (broken_law.py:5)"
    assert said in " ".join(run.output().split())
    if mode != "realtime":
        assert f"failed at t = {after_ns / 1e9:.3f} s: {said}" in " ".join(run.output().split())
    log = (tmp_path / "plug-in" / "logs" / "robot-4.log").read_text()
    assert "broken_law.py" in log
    assert "ZeroDivisionError: division by zero\n" in log


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_where_the_law_raises_in_every_robot_nobody_counts_as_lost(start, tmp_path, mode):
    env = install_law(tmp_path, "return 1 / 0, 0.0")
    run = start("all", "law.kind=broken", "duration_s=1.0", f"clock.mode={mode}", env=env)
    assert run.wait() == 3
    kinds = {event["event"] for event in run.events()}
    assert kinds.isdisjoint(["lost", "silent at the end"]), run.output()
    assert run.verdict()["robots"]["lost"] == []
    assert "ZeroDivisionError: division by zero (broken_law.py:5)" in run.output()


EXIT = "exit(1)", "SystemExit: 1"
INTERRUPT = "(_ for _ in ()).throw(KeyboardInterrupt)", "KeyboardInterrupt"


@pytest.mark.parametrize(
    ("mode", "leave", "named"),
    [
        ("clock.mode=lockstep", *EXIT),
        ("clock.mode=realtime", *EXIT),
        ("clock.mode=lockstep", *INTERRUPT),
        ("--inline", *INTERRUPT),
    ],
)
def test_a_law_that_leaves_ends_the_run_with_its_name(start, tmp_path, mode, leave, named):
    """Neither is a way out of a robot's process."""
    body = f"return {leave} if self.robot == 4 and now_ns > 10**8 else (0.0, 0.0)"
    run = start(
        "plug-in", "law.kind=broken", "duration_s=2.0", mode, env=install_law(tmp_path, body)
    )
    assert run.wait() == 3
    assert f"robot 4: {named} (broken_law.py:5)" in " ".join(run.output().split())


def test_a_law_that_never_comes_back_costs_its_robot(start, tmp_path):
    """Before the run it is given up, and in the run it is lost; up to there the run repeats."""
    endless = "any(False for _ in iter(int, 1))"
    body = f"return (0.0, 0.0) if self.robot != 4 or now_ns < 10**8 else {endless}"
    env = install_law(tmp_path, body)
    run = start(
        "plug-in", "law.kind=broken", "duration_s=2.0", "run.patience_s=1.0", "expect={}", env=env
    )
    assert run.wait() == 1  # nothing was claimed, but a robot is lost
    said = " ".join(run.output().split())
    assert "did not return within 10 s (it is at broken_law.py:5) in the trial" in said
    assert "lost at t = 0.100 s: robot 4: did not answer for 1 s" in said
    assert "nothing was claimed, but the run diverged or lost a robot" in said
    again = subprocess.run(
        [sys.executable, "-m", "formnet", "verify", str(run.out)],
        capture_output=True,
        text=True,
        timeout=60.0,
        env={**os.environ, **env},
    )
    assert again.returncode == 0
    assert "identical up to t = 0.1 s, where something unplanned happened" in again.stdout


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_law_that_does_not_come_back_inline_is_named_and_ended(monkeypatch, tmp_path, number):
    """A signal is taken in between ticks; where none comes, it ends the law."""
    told, interrupted = threading.Event(), threading.Event()

    class Endless:
        def __init__(self, situation: Situation) -> None:
            self.robot = situation.robot

        def command(self, now_ns: int, *_: object) -> Command:
            if self.robot == 4 and now_ns == 3 * 10**6:
                assert told.wait(60.0)
                signal.raise_signal(number)
                threading.Event().wait(60.0)
                raise AssertionError("not reached")
            return Command(0.0, 0.0)

    class Sink(Recording):
        def __call__(self, record: Record) -> None:
            super().__call__(record)
            if isinstance(record, Waiting):
                told.set()

    monkeypatch.setattr("formnet.lab.launch.stuck.PATIENCE_S", 0.05)
    monkeypatch.setattr("formnet.agent.law.load", lambda kind: Endless)
    recording = Sink(tmp_path / "run", load(Path(f"configs/{SECTION5}.toml")))
    before = signal.signal(number, lambda *_: interrupted.set())
    try:
        outcome = Inline().run(resolve(recording.scenario), recording, interrupted.is_set)
    finally:
        signal.signal(number, before)
    assert (outcome.kind, outcome.t_ns) == ("interrupted", 3 * 10**6)
    where = r"stopped by the user, in the law of robot 4 \(test_runs\.py:\d+\)"
    assert re.fullmatch(where, outcome.reason)
    (waiting,) = [event for event in recording.events if isinstance(event, Waiting)]
    assert waiting.robots == (4,)
    assert re.fullmatch(r"answer \(it is at threading\.py:\d+\)", waiting.what)
    assert len(recording.samples) == 5


def test_a_plug_in_law_runs(start, tmp_path):
    env = install_law(tmp_path, "return (0.0, 0.0)")
    run = start("plug-in", "--inline", "law.kind=broken", "duration_s=0.1", env=env)
    assert run.wait() == 1
    assert run.verdict()["theorem"] is None
    assert "not 'broken'" in run.verdict()["why"]


def test_endpoints_off_loopback_are_refused(root):
    result = subprocess.run(
        [
            sys.executable,
            "-m",
            "formnet",
            "agent",
            "--robot",
            "1",
            "--run",
            "x",
            "--connect",
            "tcp/192.0.2.1:7447",
        ],
        cwd=root,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.returncode == 3
    assert "off loopback, messages are encrypted and authorised" in result.stderr
