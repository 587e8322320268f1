"""A hub with keys: who connects and says nothing, whose certificate expires, who has no rights."""

import json
import shutil
import socket
import ssl
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from processes import until

from formnet.formation.briefing.resolving import resolve
from formnet.formation.records.events import Refused
from formnet.formation.scenario.loading import load
from formnet.formation.wire import bus
from formnet.formation.wire.security import PLANT, Credentials
from formnet.lab.launch.hub_log import EVERYTHING
from formnet.lab.launch.launch import Launch, Place, free_port
from formnet.lab.machines import keys
from formnet.lab.runs.recording import Recording
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.lab.verdict.model import judge

ZENOH_S = 10.0
"""How long Zenoh itself gives who connects and says nothing."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("keys")
    keys.make(place, range(1, 7), [], 30)
    return place


def expiring(folder, name, seconds):
    """Have the certificate of ``name`` end in so many seconds."""
    old = x509.load_pem_x509_certificate((folder / f"{name}.pem").read_bytes())
    key = serialization.load_pem_private_key((folder / "ca-key.pem").read_bytes(), None)
    now = datetime.now(UTC)
    builder = (
        x509.CertificateBuilder()
        .subject_name(old.subject)
        .issuer_name(old.issuer)
        .public_key(old.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(seconds=seconds))
    )
    for extension in old.extensions:
        builder = builder.add_extension(extension.value, extension.critical)
    late = builder.sign(key, hashes.SHA256())
    (folder / f"{name}.pem").write_bytes(late.public_bytes(serialization.Encoding.PEM))


def hello(folder):
    """The first bytes of a TLS handshake."""
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    context = ssl.create_default_context(cafile=folder / "ca.pem")
    with pytest.raises(ssl.SSLWantReadError):
        context.wrap_bio(incoming, outgoing, server_hostname="localhost").do_handshake()
    return outgoing.read()


def in_tls(folder, connection):
    """A robot's side of an established TLS connection."""
    context = ssl.create_default_context(cafile=folder / "ca.pem")
    context.load_cert_chain(folder / "robot-1.pem", folder / "robot-1-key.pem")
    return context.wrap_socket(connection, server_hostname="localhost")


def closed(connection):
    """Whether the other end has closed it."""
    connection.setblocking(False)
    try:
        while connection.recv(4096):
            pass
    except (BlockingIOError, ssl.SSLWantReadError):
        return False
    except OSError:
        pass
    return True


@pytest.mark.processes
def test_who_connects_and_says_nothing_is_disconnected(folder):
    port = free_port()
    credentials = Credentials(folder, PLANT)
    with (
        bus.session(listen=f"tls/127.0.0.1:{port}", credentials=credentials, robots=[1]),
        ExitStack() as stack,
    ):
        silent, half, idle = (
            stack.enter_context(socket.create_connection(("127.0.0.1", port))) for _ in range(3)
        )
        half.sendall(hello(folder)[:100])
        idle = stack.enter_context(in_tls(folder, idle))
        for connection in (silent, half, idle):
            until(lambda: closed(connection), "its end", timeout_s=ZENOH_S - 2.0)  # noqa: B023


@pytest.mark.processes
@pytest.mark.parametrize("name", ["robot-1", "plant"])
def test_a_connection_ends_with_either_certificate(folder, tmp_path, name):
    place = tmp_path / "keys"
    shutil.copytree(folder, place)
    expiring(place, name, 6)
    endpoint, names = f"tls/127.0.0.1:{free_port()}", bus.Keys("run")
    robots, plants = [], []
    with (
        bus.session(listen=endpoint, credentials=Credentials(place, PLANT), robots=[1]) as hub,
        bus.session(connect=endpoint, credentials=Credentials(place, "robot-1")) as robot,
    ):
        kept = [
            hub.liveliness().declare_token(names.plant_alive),
            robot.liveliness().declare_token(names.robot_alive(1)),
            hub.liveliness().declare_subscriber(
                names.robots_alive, lambda sample: robots.append(str(sample.kind)), history=True
            ),
            robot.liveliness().declare_subscriber(
                names.plant_alive, lambda sample: plants.append(str(sample.kind)), history=True
            ),
        ]
        until(lambda: robots and plants)
        until(lambda: len(robots) == len(plants) == 2, "the end", timeout_s=30.0)
        assert robots == plants == ["SampleKind.PUT", "SampleKind.DELETE"]
        del kept


@pytest.mark.processes
def test_certificates_without_any_rights_are_told_of_once_with_a_count(folder, tmp_path):
    """Robot 6 is not in the scenario, and nobody but the hub is the plant."""
    out = tmp_path / "run"
    scenario = load(CONFIGS / "paper" / "section5-delay.toml", ["duration_s=1"])
    recording = Recording(out, scenario)
    where = Place(endpoint=f"tls/127.0.0.1:{free_port()}", keys=folder)

    def try_everything(endpoint, run):
        for who in ("robot-6", "plant", "robot-6"):
            with bus.session(connect=endpoint, credentials=Credentials(folder, who)) as session:
                names = bus.Keys(run)
                session.put(names.from_robot(1), b"lie")
                session.put(names.plant_alive, b"lie")

    def told():
        return {(e.who, e.key, e.times) for e in recording.events if isinstance(e, Refused)}

    expected = {("robot-6", EVERYTHING, 1), ("robot-6", EVERYTHING, 2), ("plant", EVERYTHING, 1)}
    launch = Launch(resolve(scenario), "run", recording, out / "logs", where, try_everything)
    until(lambda: expected <= told(), "the refusals", lambda: json.dumps(sorted(told())))
    assert launch.wait(lambda: False).kind == "completed"
    recording.save()
    assert told() == expected
    listed = judge(recording, mode="distributed", wall_s=1.0).messages.refused
    assert {(item.who, item.times) for item in listed} == {("robot-6", 2), ("plant", 1)}
