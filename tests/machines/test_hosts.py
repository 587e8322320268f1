"""Robots on other hosts, over SSH: three network namespaces with a server in each."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from base_install import base, built, copied
from in_process import collected
from machines.network import HOSTS, PORT

from formnet.formation.machines.hosts import load_hosts
from formnet.formation.scenario.loading import load
from formnet.lab.runs.recording import trajectory_sha256
from formnet.lab.scenarios.packaged import CONFIGS


@pytest.fixture
def start(network, tmp_path):
    runs = []

    def starter(scenario, *overrides, hosts=("--hosts", network.folder / "hosts.toml")):
        out = tmp_path / f"run{len(runs)}"
        sets = [part for text in overrides for part in ("--set", text)]
        environment = {**os.environ, "HOME": str(network.folder / "home")}
        process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "formnet",
                "run",
                "--no-figures",
                str(CONFIGS / scenario),
                "--out",
                str(out),
                *map(str, hosts),
                "--keys",
                str(network.folder / "keys"),
                *sets,
            ],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        runs.append(process)
        return process, out

    yield starter
    for process in runs:
        process.kill()
        process.wait()


def events(out):
    path = out / "events.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def until_event(out, kind):
    deadline = time.monotonic() + 60.0
    while not any(event["event"] == kind for event in events(out)):
        assert time.monotonic() < deadline, events(out)
        time.sleep(0.02)


def told_of_machines(network, folder):
    """Names, addresses, users and folders of keys that any file of a run's folder tells of."""
    words = ["tester", network.subnet, str(network.folder / "keys"), "alpha"]  # beta is a gain
    return {
        (path.name, word)
        for path in folder.rglob("*")
        for word in words
        if path.is_file() and word.encode() in path.read_bytes()
    }


def left_on(network, host):
    found = subprocess.run(
        ["ip", "netns", "pids", network.name(host)], capture_output=True, text=True
    ).stdout.split()
    commands = []
    for pid in found:
        line = Path("/proc", pid, "cmdline")
        if line.exists():
            commands.append(line.read_bytes().replace(b"\0", b" ").decode())
    return [command for command in commands if "agent" in command]


@pytest.fixture(scope="module")
def small(root, tmp_path_factory):
    """The interpreter of an environment with the base install alone."""
    folder = tmp_path_factory.mktemp("small")
    copied(root, folder / "source")
    python, _ = base(built(folder / "source", folder / "wheels"), folder / "venv")
    return python


@pytest.mark.namespaces
@pytest.mark.processes
def test_lockstep_over_three_hosts_gives_the_same_bits(start, network, small, tmp_path):
    """The hosts have the base install alone; and they stand in the scenario here."""
    hosts = (network.folder / "hosts.toml").read_text()
    assert sys.executable in hosts
    (network.folder / "small.toml").write_text(hosts.replace(sys.executable, str(small)))
    hosts = (network.folder / "small.toml").read_text()
    listen, machines = hosts.split("\n", 1)
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(
        (CONFIGS / "paper" / "section5-delay.toml").read_text()
        + f"\n[hosts]\n{listen}\n"
        + machines.replace("[[hosts]]", "[[hosts.hosts]]")
    )
    process, out = start(scenario, "duration_s=2.0", hosts=("--hosts", "scenario"))
    said, _ = process.communicate(timeout=90)
    assert process.returncode == 1, said  # too short for the claims
    for host in HOSTS:
        shown = f"({host}): logs in to tester@{network.address(host)}:{PORT} with your SSH keys"
        assert shown in said
    assert told_of_machines(network, out) == set()
    assert load_hosts(scenario) == load_hosts(network.folder / "small.toml")
    subprocess.run(
        [
            sys.executable,
            "-m",
            "formnet",
            "run",
            "--no-figures",
            str(scenario),
            "--inline",
            "--set",
            "duration_s=2.0",
            "--out",
            str(tmp_path / "inline"),
        ],
        capture_output=True,
    )
    hashes = [
        json.loads((folder / "verdict.json").read_text())["trajectory_sha256"]
        for folder in (out, tmp_path / "inline")
    ]
    assert hashes[0] == hashes[1]
    for host in HOSTS:
        assert left_on(network, host) == []


@pytest.mark.namespaces
@pytest.mark.processes
def test_a_gamma_delay_needs_no_more_than_the_base_install(start, network, small):
    file = network.folder / "gamma.toml"
    file.write_text((network.folder / "hosts.toml").read_text().replace(sys.executable, str(small)))
    gamma = 'network.default.delay={distribution="gamma",mean_s=0.1,stddev_s=0.05}'
    short = (gamma, "duration_s=0.6")
    process, out = start("paper/section5-delay.toml", *short, hosts=("--hosts", file))
    said, _ = process.communicate(timeout=90)
    judged = json.loads((out / "verdict.json").read_text())
    assert judged["outcome"]["kind"] == "completed", said
    inline = collected(load(CONFIGS / "paper" / "section5-delay.toml", short))
    assert judged["trajectory_sha256"] == trajectory_sha256(inline.samples)


@pytest.mark.namespaces
@pytest.mark.processes
def test_real_time_over_three_hosts(start):
    process, out = start("yard.toml", "duration_s=5.0")
    said, _ = process.communicate(timeout=90)
    assert process.returncode == 1, said
    judged = json.loads((out / "verdict.json").read_text())
    assert judged["outcome"]["kind"] == "completed"
    assert judged["robots"]["lost"] == []
    assert set(judged["realtime"]["robots"]) == {"1", "2", "3", "4", "5"}
    assert all(link["delivered"] > 20 for link in judged["links"])


@pytest.mark.namespaces
@pytest.mark.processes
@pytest.mark.parametrize("scenario", ["paper/section5-delay.toml", "yard.toml"])
def test_a_host_whose_interface_goes_down_is_named_and_the_rest_run_on(start, network, scenario):
    cut = 'timeline=[{action="cut", at_s=0.5, links=[[1, 2]], heal_after_s=0.1}]'
    process, out = start(scenario, "duration_s=9.0", cut)
    until_event(out, "network")  # it is under way
    with network.down("beta"):
        said, _ = process.communicate(timeout=90)
    assert process.returncode in (0, 1), said  # as it comes
    judged = json.loads((out / "verdict.json").read_text())
    assert judged["outcome"]["kind"] == "completed"
    lost = {item["robot"] for item in judged["robots"]["lost"]}
    assert lost >= set(HOSTS["beta"])
    if scenario == "yard.toml":  # in lockstep the others wait until the connection is dropped
        assert lost == set(HOSTS["beta"])
        assert judged["robots"]["judged"] == [1, 2, 5]
    (gone,) = [event for event in events(out) if event["event"] == "host lost"]
    assert (gone["host"], gone["robots"]) == ("host 2", [3, 4])
    assert "host lost: host 2, with robots 3, 4: its connection has ended" in said
    assert "host 2 (beta): logs in to tester@" in said
    assert told_of_machines(network, out) == set()


@pytest.mark.namespaces
@pytest.mark.processes
def test_faults_reach_robots_on_other_hosts(start, tmp_path):
    faults = (
        "duration_s=2.0",
        'timeline=[{action="kill", at_s=0.3, robots=3, restart_after_s=0.5}, '
        '{action="pause", at_s=0.4, robots=1, resume_after_s=0.5}]',
    )
    process, out = start("paper/section5-delay.toml", *faults)
    said, _ = process.communicate(timeout=90)
    assert process.returncode == 1, said
    sets = [part for text in faults for part in ("--set", text)]
    subprocess.run(
        [
            sys.executable,
            "-m",
            "formnet",
            "run",
            "--no-figures",
            str(CONFIGS / "paper/section5-delay.toml"),
            "--inline",
            *sets,
            "--out",
            str(tmp_path / "inline"),
        ],
        capture_output=True,
    )
    hashes = [
        json.loads((folder / "verdict.json").read_text())["trajectory_sha256"]
        for folder in (out, tmp_path / "inline")
    ]
    assert hashes[0] == hashes[1]


@pytest.mark.namespaces
@pytest.mark.processes
def test_a_host_that_cannot_be_reached_ends_the_run(start, network, tmp_path):
    text = (network.folder / "hosts.toml").read_text()
    other = network.folder / "hosts.toml"
    other.write_text(text.replace(f"{network.address('gamma')}:{PORT}", f"{network.here}:9"))
    try:
        process, out = start("paper/section5-delay.toml", "duration_s=2.0")
        said, _ = process.communicate(timeout=90)
    finally:
        other.write_text(text)
    assert process.returncode == 3
    assert "host gamma (tester@" in " ".join(said.split())
    assert "Traceback" not in said
    reason = json.loads((out / "verdict.json").read_text())["outcome"]["reason"]
    assert reason == "host 3, of robot 5, cannot be reached over SSH"
    assert told_of_machines(network, out) == set()
    deadline = time.monotonic() + 10.0  # their leash ends them, once they have started
    while left_on(network, "alpha"):
        assert time.monotonic() < deadline
        time.sleep(0.05)
