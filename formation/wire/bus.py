"""Zenoh as this project uses it: keys of a run, and sessions that stay where they should.

Sessions find each other by the endpoints they are given, never by multicast or
gossip, and only on loopback. The plant's session is the hub (a full Zenoh
router inside its process); everybody else is its client.
"""

import json
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from ipaddress import ip_address
from typing import Any

from formnet.formation.wire import threads  # noqa: F401 (first: Zenoh reads what it sets, when it is loaded)

# isort: split
import zenoh
from mypy_extensions import mypyc_attr

from formnet.formation.wire.security import Credentials, access_control

LOOPBACK = "127.0.0.1"
LONG_LEASE_S = 3600.0
"""On one machine a process that is stopped must not count as gone; the plant has its patience."""
LEASE_S = 2.0
"""A machine that has said nothing for so long is gone, and whoever sends to it is not held up."""
STALL_S = 0.75
"""A hub with keys disconnects a client that, with all buffers full, takes nothing for so long.

Less than a second, after which the plant says on whom the run waits.
"""
HANDSHAKE_S = 5.0
"""Who connects to a hub with keys has so long to show a certificate, and to open a session."""
_SEND_BUFFER = 200_000
"""Bytes that the kernel may keep for a client, before its queue fills (socket(7) doubles it)."""
_HURRY_S = 0.01
"""How long a message waits for a client that does not keep up where nobody may wait longer."""


@mypyc_attr(native_class=False)
class BusError(RuntimeError):
    """A session cannot be opened; the text says which endpoint and why."""


class Keys:
    """The key expressions of one run: ``formnet/<run>/...``."""

    def __init__(self, run: str) -> None:
        self._prefix = f"formnet/{run}"
        self.from_robots = f"{self._prefix}/from-robot/*"
        self.broadcasts = f"{self._prefix}/broadcast/*"
        self.robots_alive = f"{self._prefix}/alive/robot/*"
        self.watch = f"{self._prefix}/watch"
        self.history = f"{self._prefix}/history"
        self.plant_alive = f"{self._prefix}/alive/plant"

    def to_robot(self, robot: int) -> str:
        """What the plant tells ``robot``."""
        return f"{self._prefix}/to-robot/{robot}"

    def from_robot(self, robot: int) -> str:
        """What ``robot`` tells the plant."""
        return f"{self._prefix}/from-robot/{robot}"

    def broadcast(self, robot: int) -> str:
        """What ``robot`` tells its neighbours."""
        return f"{self._prefix}/broadcast/{robot}"

    def robot_alive(self, robot: int) -> str:
        """The liveliness token of ``robot``."""
        return f"{self._prefix}/alive/robot/{robot}"


@contextmanager
def session(
    *,
    connect: str | None = None,
    listen: str | None = None,
    credentials: Credentials | None = None,
    robots: Iterable[int] = (),
    plaintext: bool = False,
    patience_s: float = 10.0,
    lease_s: float = LONG_LEASE_S,
    batching: bool = False,
    blocking: bool = True,
    stall_s: float | None = STALL_S,
) -> Iterator[zenoh.Session]:
    """An open session, closed at the end (an unclosed one hangs the interpreter's exit).

    With ``credentials`` it speaks mutual TLS (endpoints ``tls/...``), and one that listens lets
    ``robots`` and a monitor do no more than :func:`formation.wire.security.access_control` says.
    Off loopback that is required, unless ``plaintext`` is explicit.

    The other end takes this one for gone once it has said nothing for ``lease_s``. With
    ``batching``, as with a short lease, Zenoh puts a queue between it and the socket: what may be
    dropped is, where this end does not keep up, and the other is not held up. (A lease that ends
    closes the connection, which holds it up for ten seconds on a single thread.)

    One that listens with ``credentials`` disconnects a client that takes nothing for ``stall_s``
    (None: never), and holds up nobody for longer, see :func:`_guard`.
    ``blocking`` is whether others wait for that long, because nothing may be dropped before.

    Raises:
        BusError: an endpoint is not allowed, is taken, or nobody answers there within
            ``patience_s`` (which is what a refused certificate looks like).
    """
    for endpoint in filter(None, (connect, listen)):
        check_endpoint(endpoint, secure=credentials is not None, plaintext=plaintext)
    config: dict[str, Any] = {
        "mode": "router" if listen else "client",
        "listen": {"endpoints": [listen] if listen else []},
        "connect": {
            "endpoints": [connect] if connect else [],
            "timeout_ms": round(1000 * patience_s),
            "exit_on_failure": True,
            "retry": {"period_init_ms": 50, "period_max_ms": 500, "period_increase_factor": 1.5},
        },
        "scouting": {
            "delay": 0,
            "multicast": {"enabled": False},
            "gossip": {"enabled": False},
        },
        # One class of traffic and no batching layer: halves the cost of a lockstep tick. But
        # without that layer, whoever sends to a machine that is gone stands still. A transport is
        # of low latency only if both ends want it, so no client gets one from a hub with keys.
        "transport": {
            "unicast": {
                "lowlatency": credentials is None and lease_s >= LONG_LEASE_S and not batching,
                "qos": {"enabled": False},
            },
            # Where there is a batching layer, room for a burst at the end of a run.
            "link": {"tx": {"lease": round(1000 * lease_s), "queue": {"size": {"data": 16}}}},
            "shared_memory": {"enabled": False},
        },
    }
    if credentials is not None:
        config["transport"]["link"]["tls"] = credentials.tls(listening=listen is not None)
        if listen:
            config["access_control"] = access_control(robots, credentials.generations())
            _guard(config, listen, lease_s, blocking=blocking, stall_s=stall_s)
    try:
        opened = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    except zenoh.ZError as error:
        what = f"listen on {listen}" if listen else f"reach {connect}"
        hint = ""
        if credentials is not None and connect:
            hint = " (or it refuses this certificate, or is not of this authority)"
        reason = re.sub(r"\s+at \S+\.rs:\d+", "", str(error))  # Zenoh says where in its source
        if connect and "Timeout" in reason:
            reason = f"no answer for {patience_s:g} s"
        raise BusError(f"cannot {what}: {reason}{hint}") from None
    try:
        yield opened
    finally:
        opened.close()  # type: ignore[no-untyped-call]


def _guard(
    config: dict[str, Any], listen: str, lease_s: float, *, blocking: bool, stall_s: float | None
) -> None:
    """Have a hub at ``listen`` put up with no client that hangs, in the handshake or later.

    What is put is sent on with Zenoh's BLOCK_FIRST, whatever its sender asked for: the first
    message that finds the queue of a client full waits for room on a thread of its own, and if
    there is none within ``stall_s`` the client is disconnected. Those behind it wait for the first
    (with ``blocking``, so that nothing is lost; otherwise for a moment, and are dropped): for all
    clients that hang at the same time together, not for one after the other. (With BLOCK, those
    who send to the same client would wait on its queue's lock, one client after the other. With
    DROP, a client that has not kept up once gets nothing more, ever: Zenoh 1.10 notes without
    priorities that a queue is full under one priority, and that it has room under another.)
    """
    stall_s = LONG_LEASE_S if stall_s is None else stall_s
    hurry_s = 2.0 * stall_s if blocking else _HURRY_S
    config["qos"] = {
        "network": [
            {
                "id": "nobody-waits-for-a-client",
                "messages": ["put", "delete"],
                "flows": ["egress"],
                "overwrite": {"congestion_control": "block_first"},
            }
        ]
    }
    patience_ms = round(1000 * HANDSHAKE_S)
    unicast, tx = config["transport"]["unicast"], config["transport"]["link"]["tx"]
    unicast |= {"accept_timeout": patience_ms, "accept_pending": 1000}
    tx["queue"]["congestion_control"] = {
        "drop": {"wait_before_drop": round(1e6 * hurry_s)},
        "block": {"wait_before_close": round(1e6 * stall_s)},
    }
    config["transport"]["link"]["tls"]["so_sndbuf"] = _SEND_BUFFER
    # A connection that is closed may take one interval to write what is left: a second at most.
    tx["keep_alive"] = max(4, round(lease_s))
    config["listen"]["endpoints"] = [
        f"{listen}{';' if '#' in listen else '#'}tls_handshake_timeout_ms={patience_ms}"
    ]


def publisher(
    opened: zenoh.Session, key: str, *, blocking: bool = True, hurried: bool = True
) -> zenoh.Publisher:
    """A publisher that, where the network is full, blocks (or else drops).

    It sends at once; if it is not ``hurried``, together with what follows soon.
    """
    control = zenoh.CongestionControl
    return opened.declare_publisher(
        key, express=hurried, congestion_control=control.BLOCK if blocking else control.DROP
    )


def check_endpoint(endpoint: str, *, secure: bool, plaintext: bool) -> None:
    """Whether a session may use ``endpoint``: with keys (``secure``) or without.

    Raises:
        BusError: it may not.
    """
    tls = endpoint.startswith("tls/")
    if secure and not tls:
        raise BusError(f"{endpoint}: with keys, an endpoint must be tls/HOST:PORT")
    if not secure and tls:
        raise BusError(f"{endpoint}: a tls endpoint needs keys (--keys DIR; `formnet keys init`)")
    if not (tls or plaintext or on_loopback(endpoint)):
        raise BusError(
            f"{endpoint}: off loopback, messages are encrypted and authorised: give --keys DIR and "
            "an endpoint tls/HOST:PORT (or --plaintext, on a network that you trust)"
        )


def on_loopback(endpoint: str) -> bool:
    """Whether an endpoint such as ``tcp/127.0.0.1:7447`` is on this machine alone."""
    address = endpoint.partition("/")[2].rpartition(":")[0].strip("[]")
    try:
        return address == "localhost" or ip_address(address).is_loopback
    except ValueError:
        return False
