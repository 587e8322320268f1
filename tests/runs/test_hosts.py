"""Robots on other hosts, over SSH: three network namespaces with a server in each."""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import asyncssh
import pytest
from base_install import base, built, copied
from in_process import collected
from processes import missing

from formnet.formation.scenario.hosts import HostsError, load_hosts
from formnet.formation.scenario.loading import ScenarioError, load
from formnet.lab.machines import keys
from formnet.lab.machines.place import BadPlace, Where
from formnet.lab.runs.recording import trajectory_sha256
from formnet.lab.scenarios.packaged import CONFIGS

HOSTS = {"alpha": [1, 2], "beta": [3, 4], "gamma": [5]}
PORT = 2222


def ip(*words):
    subprocess.run(["ip", *words], check=True, capture_output=True)


class Network:
    """Namespaces on a bridge; ours has address .254, host k has .k."""

    def __init__(self, folder):
        self.folder = folder
        self.prefix = f"f{os.getpid() % 100000}"
        self.subnet = f"10.{50 + os.getpid() % 150}.77"
        self.servers = {}

    def name(self, host):
        return f"{self.prefix}{host[0]}"

    def address(self, host):
        return f"{self.subnet}.{1 + list(HOSTS).index(host)}"

    @property
    def here(self):
        return f"{self.subnet}.254"

    def build(self):
        bridge = f"{self.prefix}br"
        ip("link", "add", bridge, "type", "bridge")
        ip("addr", "add", f"{self.here}/24", "dev", bridge)
        ip("link", "set", bridge, "up")
        for host in HOSTS:
            name = self.name(host)
            ip("netns", "add", name)
            ip("link", "add", f"{name}0", "type", "veth", "peer", "name", "eth0", "netns", name)
            ip("link", "set", f"{name}0", "master", bridge)
            ip("link", "set", f"{name}0", "up")
            ip("-n", name, "addr", "add", f"{self.address(host)}/24", "dev", "eth0")
            ip("-n", name, "link", "set", "lo", "up")
            ip("-n", name, "link", "set", "eth0", "up")

    def serve(self):
        home = self.folder / "home" / ".ssh"
        home.mkdir(parents=True)
        client, host_key = (asyncssh.generate_private_key("ssh-ed25519") for _ in range(2))
        client.write_private_key(home / "id_ed25519")
        client.write_public_key(self.folder / "authorized")
        host_key.write_private_key(self.folder / "host-key")
        public = host_key.export_public_key().decode().strip()
        known = [f"[{self.address(host)}]:{PORT} {public}" for host in HOSTS]
        (home / "known_hosts").write_text("\n".join(known) + "\n")
        for host in HOSTS:
            self.servers[host] = subprocess.Popen(
                [
                    "ip",
                    "netns",
                    "exec",
                    self.name(host),
                    sys.executable,
                    str(Path(__file__).parents[1] / "helpers" / "sshd.py"),
                    self.address(host),
                    str(PORT),
                    str(self.folder / "host-key"),
                    str(self.folder / "authorized"),
                ],
                stdout=subprocess.PIPE,
                text=True,
            )
        for host, server in self.servers.items():
            assert server.stdout.readline() == "listening\n", host

    def tear_down(self):
        for server in self.servers.values():
            server.kill()
            server.wait()
        for host in HOSTS:
            subprocess.run(["ip", "netns", "del", self.name(host)], capture_output=True)
        subprocess.run(["ip", "link", "del", f"{self.prefix}br"], capture_output=True)

    @contextmanager
    def down(self, host):
        ip("link", "set", f"{self.name(host)}0", "down")
        yield
        ip("link", "set", f"{self.name(host)}0", "up")


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    if shutil.which("ip") is None:
        missing("iproute2")
    found = Network(tmp_path_factory.mktemp("hosts"))
    try:
        try:
            found.build()
        except subprocess.CalledProcessError as error:
            pytest.skip(f"no network namespaces can be made here: {error.stderr.decode().strip()}")
        found.serve()
        place = found.folder / "keys"
        keys.make(place, range(1, 6), [found.here], 30)
        text = f'listen = "tls/{found.here}:7447"\n'
        for host, robots in HOSTS.items():
            text += (
                f'[[hosts]]\nname = "{host}"\nssh = "tester@{found.address(host)}:{PORT}"\n'
                f'robots = {robots}\npython = "{sys.executable}"\nkeys = "{place}"\n'
            )
        (found.folder / "hosts.toml").write_text(text)
        yield found
    finally:
        found.tear_down()


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
    process, out = start(scenario, "duration_s=2.0", hosts=())
    said, _ = process.communicate(timeout=90)
    assert process.returncode == 1, said  # too short for the claims
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
    assert (gone["host"], gone["robots"]) == ("beta", [3, 4])
    assert "host lost: beta, with robots 3, 4: its connection has ended" in said


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
        process, _ = start("paper/section5-delay.toml", "duration_s=2.0")
        said, _ = process.communicate(timeout=90)
    finally:
        other.write_text(text)
    assert process.returncode == 3
    assert "host gamma" in " ".join(said.split())
    assert "Traceback" not in said
    deadline = time.monotonic() + 10.0  # their leash ends them, once they have started
    while left_on(network, "alpha"):
        assert time.monotonic() < deadline
        time.sleep(0.05)


# --- the doctor ---------------------------------------------------------------------------------


def doctor(network, *changes):
    text = (network.folder / "hosts.toml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    file = network.folder / "doctor.toml"
    file.write_text(text)
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "formnet",
            "doctor",
            "--hosts",
            str(file),
            "--keys",
            str(network.folder / "keys"),
        ],
        env={**os.environ, "HOME": str(network.folder / "home"), "COLUMNS": "500"},
        capture_output=True,
        text=True,
    )
    assert "Traceback" not in done.stdout + done.stderr
    return done.returncode, done.stdout


def python_that(tmp_path, name, code):
    """An interpreter in which ``code`` runs first."""
    folder = tmp_path / name
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(code)
    script = folder / "python"
    script.write_text(f'#!/bin/sh\nPYTHONPATH={folder} exec {sys.executable} "$@"\n')
    script.chmod(0o755)
    return script


@pytest.mark.namespaces
@pytest.mark.processes
def test_the_doctor_finds_nothing_where_all_is_well(network):
    code, said = doctor(network)
    assert code == 0, said
    assert (
        said.count("✓") == 5 + 2 + 1 + 3 * 4 + 5
    )  # here: what there is, keys, port; hosts; robots
    assert "no problems found" in said


@pytest.mark.namespaces
@pytest.mark.processes
def test_the_doctor_names_what_is_wrong_and_the_remedy(network, tmp_path):
    late = python_that(tmp_path, "late", "import time\nt = time.time\ntime.time = lambda: t() - 2")
    old = python_that(
        tmp_path, "old", "import formnet.formation.wire.messages as m\nm.PROTOCOL = 1"
    )
    place = tmp_path / "keys"
    shutil.copytree(network.folder / "keys", place)
    (place / "robot-5.pem").unlink()
    python, folder = f'python = "{sys.executable}"', f'keys = "{network.folder / "keys"}"'
    code, said = doctor(
        network,
        (python, f'python = "{late}"'),
        (python, f'python = "{old}"'),
        (f"robots = [5]\n{python}\n{folder}", f'robots = [5]\n{python}\nkeys = "{place}"'),
    )
    assert code == 3
    lines = said.splitlines()
    for problem, remedy in [
        ("✗ alpha: clock: -", "run an NTP client"),
        ("✗ beta: formnet: has ", "install the same there"),
        ("✗ gamma: certificate of robot-5: ", "formnet keys init"),
    ]:
        (number,) = [k for k, line in enumerate(lines) if line.startswith(problem)]
        assert remedy in lines[number + 1]
    assert "problems: 3" in said


@pytest.mark.namespaces
@pytest.mark.processes
def test_the_doctor_tries_the_port_and_the_way_in(network):
    listen = f"tls/{network.here}:7447"
    code, said = doctor(
        network,
        (listen, "tls/127.0.0.1:7447"),
        (f"{network.address('gamma')}:{PORT}", f"{network.address('gamma')}:9"),
        (f'python = "{sys.executable}"', 'python = "/nowhere/python"'),
    )
    assert code == 3
    assert "✗ alpha: formnet: /nowhere/python has no formnet" in said
    assert "✗ beta: port: cannot reach 127.0.0.1:7447: " in said
    assert "open that port for beta in the firewall" in said
    assert "✗ gamma: SSH: host gamma (" in said
    code, said = doctor(network, (listen, "tls/192.0.2.1:7447"))
    assert code == 3
    assert "✗ here: port: cannot listen at tls/192.0.2.1:7447" in said


@pytest.mark.namespaces
@pytest.mark.processes
def test_the_doctor_sees_expired_and_foreign_certificates(network, tmp_path, monkeypatch):
    place = tmp_path / "keys"
    keys.make(place, [1, 2], [], 1)  # another authority's
    real = keys.datetime

    class Past(real):
        @classmethod
        def now(cls, zone):
            return real.now(zone) - keys.timedelta(days=9)

    monkeypatch.setattr(keys, "datetime", Past)
    keys.make(tmp_path / "past", [3, 4], [], 3)
    folder = f'keys = "{network.folder / "keys"}"'
    code, said = doctor(
        network, (folder, f'keys = "{place}"'), (folder, f'keys = "{tmp_path / "past"}"')
    )
    assert code == 3
    assert (
        "✗ alpha: certificate of robot-1: is signed by another authority than the plant's" in said
    )
    assert "✗ beta: certificate of robot-3: expired " in said
    assert "make them again (`formnet keys init`) and copy them there" in said


# --- the file of hosts ---------------------------------------------------------------------------


GOOD = 'listen = "tls/10.0.0.1:7447"\n[[hosts]]\nname = "a"\nssh = "x"\nrobots = [1]\nkeys = "k"\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "listen: is required"),
        (GOOD.replace("tls/10.0.0.1:7447", "10.0.0.1"), "listen = "),
        (GOOD + 'passwords = "x"\n', "unknown key"),
        (GOOD.replace("[1]", "[]"), "hosts[0].robots"),
        (GOOD + GOOD.split("\n", 1)[1].replace('"a"', '"b"'), "robot 1 runs on a and on b"),
        ("= 3", "hosts.toml: not TOML: "),
    ],
)
def test_a_bad_file_of_hosts_is_said(tmp_path, text, words):
    file = tmp_path / "hosts.toml"
    file.write_text(text)
    with pytest.raises(HostsError) as found:
        load_hosts(file)
    assert words in str(found.value)


def test_the_hosts_of_a_scenario_are_checked_with_it(tmp_path):
    text = (CONFIGS / "yard.toml").read_text() + "\n[hosts]\n"
    file = tmp_path / "scenario.toml"
    file.write_text(text + GOOD.replace("[[hosts]]", "[[hosts.hosts]]").replace("[1]", "[1, 9]"))
    with pytest.raises(ScenarioError, match=r"hosts.a.robots = 9: robot 9 does not exist"):
        load(file)


def test_hosts_and_an_impatient_run_do_not_go_together(tmp_path):
    file = tmp_path / "hosts.toml"
    file.write_text(GOOD)
    keys.make(tmp_path / "keys", range(1, 6), [], 1)
    scenario = load(CONFIGS / "yard.toml", ["run.patience_s=1.0"])
    with pytest.raises(BadPlace, match=r"run.patience_s = 1: must be at least 4 with hosts"):
        Where(file, tmp_path / "keys").hosts(scenario)


@pytest.mark.parametrize(
    ("change", "with_keys", "words"),
    [
        (("[1]", "[9]"), True, "hosts.a.robots: robot 9 is not in the scenario"),
        (('keys = "k"\n', ""), True, "hosts.a.keys: is required with --keys"),
        (("x", "x"), False, "needs --keys DIR"),
        (("tls/", "tcp/"), False, "off loopback it must be tls/HOST:PORT"),
    ],
)
def test_hosts_that_do_not_suit_the_run_are_said(tmp_path, change, with_keys, words):
    file = tmp_path / "hosts.toml"
    file.write_text(GOOD.replace(*change))
    scenario = load(CONFIGS / "yard.toml")
    keys.make(tmp_path / "keys", scenario.ids, [], 1)
    with pytest.raises(BadPlace, match=re.escape(words)):
        Where(file, tmp_path / "keys" if with_keys else None).hosts(scenario)
