"""What a hub's log tells of its clients; lines as Zenoh 1.10.2 writes them."""

import pytest

from formnet.formation.briefing.resolving import resolve
from formnet.formation.machines.generations import Generations
from formnet.formation.records.events import Disconnected, Refused
from formnet.lab.launch.hub_log import (
    DID_NOT_READ,
    EVERYTHING,
    EXPIRED,
    MOST_KEYS,
    OTHER_KEYS,
    HubLog,
)

AC = "2026-11-28T08:40:27Z  INFO acc-0 zenoh::net::routing::interceptor::access_control: "
QOS = "2026-11-28T08:40:27Z DEBUG acc-0 rt{zid=78aa06de}: zenoh::net::routing::interceptor::qos_overwrite: "
TX = "\x1b[2m2026-11-28T08:33:57Z\x1b[0m \x1b[31mERROR\x1b[0m net-65 zenoh_transport::unicast::universal::tx: "
MS = 10**6
COUNTING = Generations(issued={"monitor": 1, **{f"robot-{k}": 1 for k in range(1, 6)}})
"""Robot 9 has a certificate of which this folder of keys knows nothing."""


def connected(zid, who, port=45532):
    name = "None" if who is None else f'Some("{who}.1")'
    return (
        f"{QOS}New egress qos overwriter on transport unicast Transport Unicast {{ zid: {zid}, "
        "whatami: Client, is_qos: false, is_shm: false, links: [Link { src: tls/127.0.0.1:7447, "
        f"dst: tls/127.0.0.1:{port}, group: None, mtu: 49152, is_streamed: true, interfaces: "
        f'["lo"], auth_identifier: Tls({name}), priorities: None, reliability: None }}], '
        "sn_resolution: U32 }\n"
    )


def without_rights(zid):
    return f"{AC}{zid} did not match any configured ACL subject. Default permission `Deny` will\n"


def stalled(zid):
    return f"{TX}Unable to push non droppable network message to {zid}. Closing transport!\n"


def denied(who, key):
    return (
        f"{AC}ad6d on Interface(lo)+CertCommonName({who}.1)+Transport(Tls)+ad6d is unauthorized to "
        f"Put (ingress) on {key}\n"
    )


@pytest.fixture
def told(paper):
    log = HubLog(resolve(paper("section5-delay")), "run", COUNTING)

    def tell(*lines):
        return [event for line in lines if (event := log.read(line, MS)[1]) is not None]

    return tell


def test_a_certificate_without_any_rights_is_told_of_once_with_a_count(told):
    lines = [
        line
        for number in range(5)
        for line in (without_rights(f"a{number}"), connected(f"a{number}", "robot-9"))
    ]
    assert told(*lines, connected("b", "robot-1")) == [
        Refused(MS, "robot-9.1", EVERYTHING, times) for times in (1, 2, 4)
    ]


def test_who_does_not_read_is_named_with_where_it_is(told):
    lines = [connected("a1", "robot-3", 4001), connected("b2", "monitor", 4002)]
    assert told(*lines, stalled("b2"), stalled("c3")) == [
        Disconnected(MS, "monitor", "127.0.0.1:4002", DID_NOT_READ, 1)
    ]
    assert told(stalled("b2"), stalled("b2"), stalled("a1")) == [
        Disconnected(MS, "monitor", "127.0.0.1:4002", DID_NOT_READ, 2),
        Disconnected(MS, "robot-3", "127.0.0.1:4001", DID_NOT_READ, 1),
    ]


def test_whose_certificate_expires_is_named(told):
    line = (
        "2026-11-28T09:00:00Z WARN acc-0 zenoh_link_commons::tls::expiration: Closing TLS link "
        "127.0.0.1:7447 => 127.0.0.1:4001 : remote certificate chain expired\n"
    )
    assert told(connected("a1", "robot-3", 4001), line) == [
        Disconnected(MS, "robot-3", "127.0.0.1:4001", EXPIRED, 1)
    ]


def test_a_certificate_without_a_name_is_nobody_s(told):
    assert told(without_rights("a"), connected("a", None)) == [
        Refused(MS, "(nobody)", EVERYTHING, 1)
    ]


def test_many_keys_are_told_of_as_one(told):
    found = told(*(denied("robot-3", f"formnet/run/x/{number}") for number in range(10_000)))
    keys = [event.key for event in found]
    assert keys[:MOST_KEYS] == [f"formnet/run/x/{number}" for number in range(MOST_KEYS)]
    assert set(keys[MOST_KEYS:]) == {OTHER_KEYS}
    assert len(keys) < MOST_KEYS + 20


def test_what_is_for_people_is_kept_without_colours(paper):
    log = HubLog(resolve(paper("section5-delay")), "run", COUNTING)
    assert log.read(stalled("a"), 0)[0].startswith("2026-11-28T08:33:57Z ERROR net-65")
    assert log.read(connected("a", "robot-1"), 0) == (None, None)
