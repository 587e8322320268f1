"""Which certificates a hub admits: with real sessions, over TLS."""

import shutil
from contextlib import contextmanager

import pytest
from in_process import formnet
from processes import until

from formnet.formation.briefing.resolving import resolve
from formnet.formation.machines.custody import KeysError
from formnet.formation.machines.generations import Generations, common_name, parted
from formnet.formation.scenario.loading import load
from formnet.formation.wire import bus
from formnet.formation.wire.security import (
    MONITOR,
    PLANT,
    Credentials,
    access_control,
    robot_name,
)
from formnet.lab.launch.hub_log import HubLog
from formnet.lab.launch.launch import free_port
from formnet.lab.machines import keys
from formnet.lab.machines.authority import Authority
from formnet.lab.scenarios.packaged import CONFIGS

ROBOTS = [1, 2, 3, 12]


@pytest.fixture
def folder(tmp_path):
    keys.make(tmp_path / "keys", ROBOTS, [], 30)
    return tmp_path / "keys"


def copied(folder, to, name):
    """The files of ``name`` as they are on its host, or with a thief."""
    to.mkdir(mode=0o700)
    for file in ("ca.pem", f"{name}.pem", f"{name}-key.pem"):
        shutil.copy(folder / file, to / file)
    return Credentials(to, name)


def forged(folder, to, name, common):
    """A certificate of this authority with that common name, which is no party's current one."""
    to.mkdir(mode=0o700)
    shutil.copy(folder / "ca.pem", to / "ca.pem")
    pair = Authority.read(folder).issue(name, common, [], 1)
    (to / f"{name}-key.pem").write_bytes(pair.private_key)
    (to / f"{name}-key.pem").chmod(0o600)
    (to / f"{name}.pem").write_bytes(pair.certificate)

    class Unchecked(Credentials):
        def __post_init__(self):
            pass

    return Unchecked(to, name)


@contextmanager
def hub(folder):
    """A plant's session: its endpoint, and what arrives there, by the key it came on."""
    endpoint, heard = f"tls/127.0.0.1:{free_port()}", []
    credentials = Credentials(folder, PLANT)
    with bus.session(listen=endpoint, credentials=credentials, robots=ROBOTS) as session:
        subscription = session.declare_subscriber(
            "formnet/**", lambda sample: heard.append((str(sample.key_expr), bytes(sample.payload)))
        )
        yield session, endpoint, heard
        del subscription


def all_that_arrives(at, stranger, robot, honest, honest_robot):
    """What is heard while ``stranger`` speaks as ``robot``, what it hears, and who is alive there.

    After each of its words, an honest one has come through.
    """
    session, endpoint, heard = at
    heard.clear()
    as_robot, own = bus.Keys("run").from_robot(robot), bus.Keys("run").from_robot(honest_robot)
    with (
        bus.session(connect=endpoint, credentials=stranger) as one,
        bus.session(connect=endpoint, credentials=honest) as two,
    ):
        told = []
        spying = [
            one.declare_subscriber(key, lambda sample: told.append(bytes(sample.payload)))
            for key in (bus.Keys("run").to_robot(robot), bus.Keys("run").broadcasts)
        ]
        token = one.liveliness().declare_token(bus.Keys("run").robot_alive(robot))
        for word in range(10):
            one.put(as_robot, b"stranger")
            two.put(own, b"%d" % word)
            two.put(bus.Keys("run").broadcast(honest_robot), b"broadcast")
            until(lambda word=word: (own, b"%d" % word) in heard)
        alive = [str(reply.ok.key_expr) for reply in session.liveliness().get("formnet/**")]
        del spying, token
    return {payload for key, payload in heard if key == as_robot}, set(told), alive


@pytest.mark.processes
def test_a_revoked_certificate_is_denied_everything_and_its_renewal_is_admitted(folder, tmp_path):
    stolen = copied(folder, tmp_path / "stolen", "robot-3")
    two = Credentials(folder, "robot-2")
    with hub(folder) as at:
        said, told, _ = all_that_arrives(at, stolen, 3, two, 2)
        assert said == {b"stranger"}  # until then it is robot 3's
        assert told == {b"broadcast"}
    code, text = formnet("keys", "revoke", folder, "robot-3")
    assert (code, "robot-3.1: revoked" in text) == (0, True)
    with pytest.raises(KeysError, match=r"robot-3.pem \(robot-3.1\) is revoked or was renewed"):
        Credentials(folder, "robot-3")
    with hub(folder) as at:
        assert all_that_arrives(at, stolen, 3, two, 2) == (set(), set(), [])
    code, text = formnet("keys", "renew", folder, "robot-3")
    assert (code, "robot-3.2: " in text) == (0, True)
    again = Credentials(folder, "robot-3")
    with hub(folder) as at:
        assert all_that_arrives(at, stolen, 3, two, 2) == (set(), set(), [])
        said, told, _ = all_that_arrives(at, again, 3, two, 2)
        assert (said, told) == ({b"stranger"}, {b"broadcast"})


@pytest.mark.processes
@pytest.mark.parametrize(
    ("name", "common"),
    [
        ("robot-1", "robot-1"),
        ("robot-1", "robot-1.2"),
        ("robot-1", "robot-1.11"),
        ("robot-1", "robot-1.1.1"),
        ("robot-1", "robot-1x1"),
        ("robot-12", "robot-12."),
        ("robot-12", "ROBOT-12.1"),
        ("robot-12", "robot-1*"),
        ("robot-12", "*"),
    ],
)
def test_a_certificate_counts_by_its_whole_name(folder, tmp_path, name, common):
    robot, two = int(name.rpartition("-")[2]), Credentials(folder, "robot-2")
    stranger = forged(folder, tmp_path / "forged", name, common)
    with hub(folder) as at:
        assert all_that_arrives(at, stranger, robot, two, 2) == (set(), set(), [])


@pytest.mark.processes
def test_a_revoked_monitor_sees_nothing_and_init_leaves_it_so(folder, tmp_path):
    stolen = copied(folder, tmp_path / "stolen", MONITOR)
    two = Credentials(folder, "robot-2")
    with hub(folder) as at:
        assert all_that_arrives(at, stolen, 3, two, 2)[1] == {b"broadcast"}
    keys.revoke(folder, [MONITOR])
    keys.make(folder, [4], [], 30)
    with hub(folder) as at:
        assert all_that_arrives(at, stolen, 3, two, 2)[1] == set()


@pytest.mark.processes
def test_a_hub_that_admits_nobody_opens(folder):
    keys.revoke(folder, [MONITOR, *map(robot_name, ROBOTS)])
    rules = access_control(ROBOTS, Generations.read(folder))
    assert (rules["rules"], rules["subjects"], rules["policies"]) == ([], [], [])
    assert rules["default_permission"] == "deny"
    with hub(folder):
        pass


def test_what_is_refused_is_a_party_s_or_a_certificate_s_that_does_not_count(folder):
    counting = Generations.read(folder).reissued(["robot-3"])
    plan = resolve(load(CONFIGS / "paper" / "section5-delay.toml"))
    log = HubLog(plan, "run", counting)

    def denied(common, key):
        module = "zenoh::net::routing::interceptor::access_control"
        _, found = log.read(
            f"TRACE {module}: tls+CertCommonName({common})+x is unauthorized to Put (ingress) on {key}",
            0,
        )
        return None if found is None else (found.who, found.key, found.times)

    keys_ = bus.Keys("run")
    assert denied("robot-2.1", keys_.from_robot(1)) == ("robot-2", keys_.from_robot(1), 1)
    assert denied("robot-3.2", keys_.from_robot(3)) is None  # its own, which Zenoh tries once
    assert denied("robot-3.1", keys_.from_robot(3)) == ("robot-3.1", keys_.from_robot(3), 1)
    assert denied("monitor", keys_.watch) == ("monitor.0", keys_.watch, 1)  # an earlier version's


def test_no_two_parties_have_one_common_name():
    names = [PLANT, MONITOR, *map(robot_name, range(1, 130))]
    commons = {common_name(name, k): (name, k) for name in names for k in range(1, 130)}
    assert len(commons) == len(names) * 129
    assert all(parted(common) == found for common, found in commons.items())
    for odd in ("robot-1", "robot-1.0", "robot-1.01", "robot-١.1", "robot-1.1\n", "x.y.1", ""):
        assert parted(odd)[1] == 0
