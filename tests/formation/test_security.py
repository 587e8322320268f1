"""Keys, and who may say what: with real sessions, over TLS."""

import json
import os
import shutil
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import zenoh
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from in_process import formnet
from processes import until

from formnet.formation.briefing.resolving import resolve
from formnet.formation.machines.custody import KeysError
from formnet.formation.records.events import Refused, Rejected
from formnet.formation.records.rows import Samples
from formnet.formation.records.stream import read
from formnet.formation.scenario.loading import load
from formnet.formation.wire import bus
from formnet.formation.wire.security import PLANT, Credentials
from formnet.lab.launch.hub_log import MANY
from formnet.lab.launch.launch import Launch, Place, free_port
from formnet.lab.machines import keys
from formnet.lab.runs.recording import Recording, trajectory_sha256
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.lab.verdict.model import judge

PATIENCE_S = 1.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("keys")
    keys.make(place, [1, 2, 3], ["10.1.2.3", "lab-pc"], 30)
    return place


class Hub:
    """A plant's session, and all that reaches it or its robots."""

    def __init__(self, session, endpoint):
        self.session, self.endpoint = session, endpoint
        self.heard, self.alive = [], []
        self._kept = [
            session.declare_subscriber("formnet/**", self._on_sample),
            session.declare_subscriber(bus.Keys("run").from_robots, self._on_sample),
            session.liveliness().declare_subscriber(
                "formnet/*/alive/**", lambda s: self.alive.append(str(s.key_expr)), history=True
            ),
        ]

    def _on_sample(self, sample):
        self.heard.append((str(sample.key_expr), sample.payload.to_bytes()))


@pytest.fixture(scope="module")
def hub(folder):
    endpoint = f"tls/127.0.0.1:{free_port()}"
    with bus.session(
        listen=endpoint, credentials=Credentials(folder, PLANT), robots=[1, 2, 3]
    ) as session:
        yield Hub(session, endpoint)


def client(hub, folder, name):
    return bus.session(
        connect=hub.endpoint, credentials=Credentials(folder, name), patience_s=PATIENCE_S
    )


@contextmanager
def listening(session, key):
    heard = []
    subscription = session.declare_subscriber(
        key, lambda sample: heard.append(sample.payload.to_bytes())
    )
    yield heard
    subscription.undeclare()


# --- what is let through ------------------------------------------------------------------------


@pytest.mark.processes
def test_everybody_can_do_what_is_theirs(hub, folder):
    names = bus.Keys("run")
    with (
        client(hub, folder, "robot-1") as one,
        client(hub, folder, "robot-3") as three,
        client(hub, folder, "monitor") as monitor,
        listening(one, names.to_robot(1)) as told,
        listening(one, names.broadcast(3)) as heard,
        listening(monitor, names.broadcasts) as watched,
    ):
        token = three.liveliness().declare_token(names.robot_alive(3))
        to_plant, to_all = (
            bus.publisher(three, key) for key in (names.from_robot(3), names.broadcast(3))
        )
        sense = bus.publisher(hub.session, names.to_robot(1))

        def all_through():
            to_plant.put(b"drive")
            to_all.put(b"state")
            sense.put(b"sense")
            return (
                (names.from_robot(3), b"drive") in hub.heard
                and names.robot_alive(3) in hub.alive
                and told
                and heard
                and watched
            )

        until(all_through)
        del token
    assert set(told) == {b"sense"}
    assert set(heard) == set(watched) == {b"state"}


@pytest.mark.processes
@pytest.mark.parametrize(
    ("who", "key"),
    [
        ("robot-3", "from-robot/1"),
        ("robot-3", "broadcast/1"),
        ("robot-3", "to-robot/1"),
        ("robot-3", "to-robot/3"),
        ("robot-3", "**"),
        ("robot-3", "alive/plant"),
        ("monitor", "broadcast/1"),
        ("monitor", "to-robot/1"),
        ("monitor", "from-robot/1"),
        ("monitor", "anything"),
    ],
)
def test_nobody_can_do_what_is_another_s(hub, folder, who, key):
    """A message that is allowed comes after: what did not come before it never does."""
    mine = "from-robot/2"
    with (
        client(hub, folder, who) as liar,
        client(hub, folder, "robot-1") as victim,
        client(hub, folder, "robot-2") as honest,
        listening(victim, "formnet/run/to-robot/1") as told,
        listening(victim, "formnet/run/broadcast/1") as heard,
    ):
        hub.heard.clear()
        liar.put(f"formnet/run/{key}", b"lie")
        liar.delete("formnet/run/broadcast/1")
        token = liar.liveliness().declare_token("formnet/run/alive/robot/2")
        publisher = bus.publisher(liar, f"formnet/run/{key}") if "*" not in key else None
        for _ in range(50):
            if publisher is not None:
                publisher.put(b"lie")
            honest.put(f"formnet/run/{mine}", b"truth")
            time.sleep(0.002)
        until(lambda: (f"formnet/run/{mine}", b"truth") in hub.heard)
        time.sleep(0.05)
        assert {payload for _, payload in hub.heard} == {b"truth"}
        assert told == heard == []
        assert "formnet/run/alive/robot/2" not in hub.alive
        del token


@pytest.mark.processes
def test_a_robot_cannot_listen_to_what_is_told_to_another(hub, folder):
    with (
        client(hub, folder, "robot-3") as curious,
        client(hub, folder, "robot-1") as one,
        listening(curious, "formnet/run/to-robot/1") as stolen,
        listening(curious, "formnet/**") as all_of_it,
        listening(one, "formnet/run/to-robot/1") as told,
    ):
        sense = bus.publisher(hub.session, "formnet/run/to-robot/1")
        until(lambda: sense.put(b"sense") or len(told) > 20)
        assert stolen == all_of_it == []


# --- who is not let in ----------------------------------------------------------------------------


class Unchecked(Credentials):
    """Those of somebody who does not look at what they use."""

    def __post_init__(self):
        pass


def refused(hub, credentials, endpoint=None):
    with (
        pytest.raises(bus.BusError, match="cannot reach"),
        bus.session(
            connect=endpoint or hub.endpoint, credentials=credentials, patience_s=PATIENCE_S
        ),
    ):
        pytest.fail("it was let in")


@pytest.mark.processes
def test_another_authority_s_certificate_is_refused(hub, folder, tmp_path):
    keys.make(tmp_path / "other", [1], [], 30)
    refused(hub, Credentials(tmp_path / "other", "robot-1"))
    shutil.copy(folder / "ca.pem", tmp_path / "other" / "ca.pem")  # one that knows ours
    refused(hub, Unchecked(tmp_path / "other", "robot-1"))


@pytest.mark.processes
def test_an_expired_certificate_is_refused(hub, folder, tmp_path):
    place = tmp_path / "late"
    shutil.copytree(folder, place)
    old = x509.load_pem_x509_certificate((place / "robot-1.pem").read_bytes())
    key = serialization.load_pem_private_key((place / "ca-key.pem").read_bytes(), None)
    now = datetime.now(UTC)
    builder = (
        x509.CertificateBuilder()
        .subject_name(old.subject)
        .issuer_name(old.issuer)
        .public_key(old.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(days=9))
        .not_valid_after(now - timedelta(days=1))
    )
    for extension in old.extensions:
        builder = builder.add_extension(extension.value, extension.critical)
    late = builder.sign(key, hashes.SHA256())
    (place / "robot-1.pem").write_bytes(late.public_bytes(serialization.Encoding.PEM))
    with pytest.raises(KeysError, match=r"robot-1.pem has expired, or ca.pem has"):
        Credentials(place, "robot-1")
    refused(hub, Unchecked(place, "robot-1"))


@pytest.mark.processes
def test_no_certificate_and_plaintext_are_refused(hub, folder):
    refused(hub, None, hub.endpoint.replace("tls/", "tcp/"))
    config = {
        "mode": "client",
        "connect": {"endpoints": [hub.endpoint], "timeout_ms": 1000, "exit_on_failure": True},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"link": {"tls": {"root_ca_certificate": str(folder / "ca.pem")}}},
    }
    with pytest.raises(zenoh.ZError):
        zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


# --- a run with a liar in it ------------------------------------------------------------------------


@pytest.mark.processes
def test_a_run_through_a_router_that_is_there_already(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config = {
        "mode": "router",
        "listen": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}},
    }
    router = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import sys, zenoh\nwith zenoh.open(zenoh.Config.from_json5(sys.argv[1])): sys.stdin.read()",
            json.dumps(config),
        ],
        stdin=subprocess.PIPE,
        env={name: value for name, value in os.environ.items() if name != "ZENOH_RUNTIME"},
    )
    until(lambda: connects(int(endpoint.rpartition(":")[2])))
    scenario = CONFIGS / "paper" / "section5-delay.toml"
    common = (scenario, "--no-figures", "--set", "duration_s=0.5")
    code, said = formnet("run", *common, "--connect", endpoint, "--out", tmp_path / "routed")
    router.communicate()
    assert code == 1, said
    assert formnet("run", *common, "--inline", "--out", tmp_path / "inline")[0] == 1
    hashes = {
        json.loads((tmp_path / name / "verdict.json").read_text())["trajectory_sha256"]
        for name in ("routed", "inline")
    }
    assert len(hashes) == 1
    code, said = formnet("run", *common, "--connect", "tcp/192.0.2.1:7447")
    assert code == 2
    assert "--connect: tcp/192.0.2.1:7447: off loopback" in said


def connects(port):
    try:
        socket.create_connection(("127.0.0.1", port), 1.0).close()
    except OSError:
        return False
    return True


@pytest.mark.processes
def test_a_liar_in_a_run_changes_nothing_and_a_stranger_is_told_of(tmp_path):
    place = tmp_path / "keys"
    keys.make(place, range(1, 6), [], 30)
    common = ["--set", "duration_s=1.5"]
    scenario = str(CONFIGS / "paper" / "section5-delay.toml")
    inline = ("--inline", "--no-figures", "--out", tmp_path / "inline")
    assert formnet("run", scenario, *common, *inline)[0] == 1
    endpoint, out = f"tls/127.0.0.1:{free_port()}", tmp_path / "record"
    formnet_ = [sys.executable, "-m", "formnet"]
    with (tmp_path / "plant.log").open("w") as log:
        plant = subprocess.Popen(
            [
                *formnet_,
                "plant",
                scenario,
                "--listen",
                endpoint,
                "--record",
                str(out),
                "--run",
                "run",
                "--keys",
                str(place),
                *common,
            ],
            stdout=log,
            stderr=log,
        )
    port = int(endpoint.rpartition(":")[2])
    until(lambda: connects(port))
    with (
        pytest.raises(bus.BusError),
        bus.session(connect=endpoint.replace("tls", "tcp"), patience_s=PATIENCE_S),
    ):
        pytest.fail("it was let in")
    agents = [
        subprocess.Popen(
            [
                *formnet_,
                "agent",
                "--robot",
                str(robot),
                "--connect",
                endpoint,
                "--run",
                "run",
                "--keys",
                str(place),
            ]
        )
        for robot in range(1, 6)
    ]
    with bus.session(connect=endpoint, credentials=Credentials(place, "robot-3")) as liar:
        names = bus.Keys("run")
        while plant.poll() is None:
            liar.put(names.from_robot(1), b"lie")
            liar.put(names.to_robot(2), b"lie")
            liar.put(names.broadcast(4), b"lie")
            time.sleep(0.02)
    assert [process.wait(30) for process in (plant, *agents)] == [0] * 6
    with out.open("rb") as stream:
        records = list(read(stream, range(1, 6)))
    assert not [r for r in records if isinstance(r, Rejected)]
    samples = [row for r in records if isinstance(r, Samples) for row in r.rows]
    judged = json.loads((tmp_path / "inline" / "verdict.json").read_text())
    assert trajectory_sha256(samples) == judged["trajectory_sha256"]
    assert "received corrupt message" in (tmp_path / "plant.log").read_text()


@pytest.mark.processes
def test_all_that_is_refused_is_told_and_nobody_else_accused(tmp_path):
    place, out = tmp_path / "keys", tmp_path / "run"
    keys.make(place, range(1, 6), [], 30)
    scenario = load(CONFIGS / "paper" / "section5-delay.toml", ["duration_s=1"])
    recording, names = Recording(out, scenario), bus.Keys("run")
    where = Place(endpoint=f"tls/127.0.0.1:{free_port()}", keys=place)

    def told():
        return {(e.who, e.key) for e in recording.events if isinstance(e, Refused)}

    once = [names.broadcast(1), names.from_robot(4)]  # through publishers, which Zenoh logs once
    heard = [names.broadcast(2), names.to_robot(3), names.plant_alive]  # by every robot 3
    often = [names.from_robot(1), names.to_robot(5), *heard]
    lies = {("robot-3", key) for key in [*once, *often, names.robot_alive(2)]}
    lies.add(("monitor", names.to_robot(2)))

    def lie(endpoint, run):
        """Before robots are there: of a key that somebody declares meanwhile, less is logged."""
        liar, spy = (
            stack.enter_context(bus.session(connect=endpoint, credentials=Credentials(place, who)))
            for who in ("robot-3", "monitor")
        )
        publishers = [bus.publisher(liar, key) for key in once]
        for _ in range(MANY):
            for publisher in publishers:
                publisher.put(b"lie")
            for key in often:
                liar.put(key, b"lie")
        held.append(liar.liveliness().declare_token(names.robot_alive(2)))
        spy.put(names.to_robot(2), b"lie")

    held = []
    with ExitStack() as stack:
        launch = Launch(resolve(scenario), "run", recording, out / "logs", where, lie)
        until(lambda: lies <= told())
        outcome = launch.wait(lambda: False)
        held.clear()
    recording.save()
    assert outcome.kind == "completed"
    assert told() == lies
    listed = [
        item.model_dump()
        for item in judge(recording, mode="distributed", wall_s=1.0).messages.refused
    ]
    assert {(item["who"], item["key"]) for item in listed} == lies
    assert {item["times"] for item in listed if item["key"] in often} == {MANY}
    assert "access_control" not in (out / "logs" / "plant.log").read_text()


# --- off loopback, and runs -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("endpoint", "with_keys", "words"),
    [
        ("tcp/0.0.0.0:7447", False, "off loopback, messages are encrypted and authorised"),
        ("tcp/192.0.2.1:7447", False, "off loopback, messages are encrypted and authorised"),
        ("tcp/127.0.0.1:7447", True, "with keys, an endpoint must be tls/HOST:PORT"),
        ("tls/127.0.0.1:7447", False, "a tls endpoint needs keys"),
    ],
)
def test_an_endpoint_that_is_not_allowed_says_why(folder, endpoint, with_keys, words):
    credentials = Credentials(folder, PLANT) if with_keys else None
    with (
        pytest.raises(bus.BusError, match=words),
        bus.session(listen=endpoint, credentials=credentials),
    ):
        pytest.fail("it was opened")


@pytest.mark.processes
def test_a_run_over_tls_gives_the_same_bits_and_tells_no_secret(tmp_path, folder):
    keys.make(tmp_path / "keys", range(1, 6), [], 30)
    scenario = CONFIGS / "paper" / "section5-delay.toml"
    common = (scenario, "--no-figures", "--set", "duration_s=0.5")
    assert formnet("run", *common, "--keys", tmp_path / "keys", "--out", tmp_path / "tls")[0] == 1
    assert formnet("run", *common, "--inline", "--out", tmp_path / "inline")[0] == 1
    hashes = [
        json.loads((tmp_path / name / "verdict.json").read_text())["trajectory_sha256"]
        for name in ("tls", "inline")
    ]
    assert hashes[0] == hashes[1]
    secret = (tmp_path / "keys" / "plant-key.pem").read_bytes().splitlines()[1]
    for path in Path(tmp_path / "tls").rglob("*"):
        assert path.is_dir() or secret not in path.read_bytes()
    code, said = formnet("run", *common, "--keys", folder, "--out", tmp_path / "lacks")
    assert code == 2
    assert "robot-4.pem is missing: make it with `formnet keys init`" in said
    code, said = formnet("run", *common, "--keys", folder, "--inline")
    assert code == 2
    assert "--inline uses one process" in said
