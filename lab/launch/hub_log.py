"""What a hub with keys did not let through, and whom it disconnected, read from its log.

Zenoh drops what is not allowed silently. At the level TRACE it logs each decision, but for a
key that either end has declared all possible decisions at once, whether anybody asks for them
or not, and then no more. So what a party is denied on the keys that it speaks or hears in every
run says little unless it comes again and again; on any other key, it has tried something.
Whose certificate has no rights at all is logged once for each of its connections.
"""

import re
from collections import Counter
from typing import NamedTuple

from formnet.formation.briefing.plan import Plan
from formnet.formation.machines.generations import Generations
from formnet.formation.records.events import Disconnected, Event, Refused
from formnet.formation.wire.bus import Keys
from formnet.formation.wire.security import MONITOR, robot_name

_INTERCEPTOR = "zenoh::net::routing::interceptor"
LOG_FILTER = f"warn,{_INTERCEPTOR}::access_control=trace,{_INTERCEPTOR}::qos_overwrite=debug"
"""For ``RUST_LOG``."""
MANY = 8
"""How often a party must be denied a key that it hears: each new connection declares it once."""
EVERYTHING = "formnet/**"
"""The key that a party without any rights was denied."""
MOST_KEYS = 100
"""Of how many keys denied to one party each is told; the others are one, OTHER_KEYS."""
OTHER_KEYS = "other keys"
DID_NOT_READ = "did not take what was sent to it"
EXPIRED = "its certificate has expired"
_MOST_CONNECTIONS = 10_000
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_NOT_FOR_PEOPLE = re.compile(r"interceptor::(access_control|qos_overwrite):")
_DENIED = re.compile(
    r"\+CertCommonName\((?P<who>.*?)\)\+.* is unauthorized to (?P<what>.+?) \(ingress\)"
    r" on (?P<key>\S+)"
)
_WITHOUT_RIGHTS = re.compile(r" (?P<zid>[0-9a-f]+) did not match any configured ACL subject")
_CONNECTED = re.compile(
    r"qos_overwrite: New .* \{ zid: (?P<zid>[0-9a-f]+),.* dst: (?P<address>[^,]+),"
    r".* auth_identifier: Tls\((?:Some\(\"(?P<who>.*?)\"\)|None)\)"
)
_STALLED = re.compile(r"Unable to push non droppable network message to (?P<zid>[0-9a-f]+)\.")
_EXPIRED = re.compile(r"Closing TLS link \S+ => (?P<address>\S+) : remote certificate")


class _Client(NamedTuple):
    """One connection: the name in its certificate, and where it comes from."""

    who: str
    address: str


class HubLog:
    """Reads the log of the hub of ``run``, which admits what is ``counting``, line by line.

    Parties are called by their names; a certificate that does not count, by its common name.
    """

    def __init__(self, plan: Plan, run: str, counting: Generations) -> None:
        keys = Keys(run)
        self._common = {
            robot_name(robot): {
                keys.from_robot(robot),
                keys.broadcast(robot),
                keys.robot_alive(robot),
                keys.to_robot(robot),
                keys.plant_alive,
                *(keys.broadcast(other) for other in plan.neighbours_of[robot]),
            }
            for robot in plan.ids
        }
        self._common[MONITOR] = {
            keys.broadcasts,
            keys.plant_alive,
            keys.watch,
            keys.history,
            *(keys.broadcast(robot) for robot in plan.ids),
            *(keys.robot_alive(robot) for robot in plan.ids),
        }
        self._names = {counting.admitted(name): name for name in counting.issued}
        self._times: Counter[tuple[str, str, str]] = Counter()
        self._told: Counter[tuple[str, str]] = Counter()
        self._keys: Counter[str] = Counter()  # how many are told of for each party
        self._clients: dict[str, _Client] = {}  # by Zenoh's id
        self._without_rights = ""  # the id of the last such client

    def read(self, line: str, t_ns: int) -> tuple[str | None, Event | None]:
        """The line without its colours, if it is fit for people; and what it tells, at ``t_ns``.

        A refusal or a disconnection is told at the first and then at every doubling.
        """
        line = _COLOURS.sub("", line)
        if not _NOT_FOR_PEOPLE.search(line):
            return line, self._disconnected(line, t_ns)
        if denied := _DENIED.search(line):
            who = self._called(denied["who"])
            return None, self._refused(who, denied["key"], denied["what"], t_ns)
        if stranger := _WITHOUT_RIGHTS.search(line):
            self._without_rights = stranger["zid"]
        elif connected := _CONNECTED.search(line):
            return None, self._connected(connected, t_ns)
        return None, None

    def _called(self, common_name: str) -> str:
        who = self._names.get(common_name, common_name)
        earlier = who in self._common and who == common_name  # of a version without generations
        return f"{who}.0" if earlier else who

    def _connected(self, connected: re.Match[str], t_ns: int) -> Event | None:
        zid, who = connected["zid"], self._called(connected["who"] or "(nobody)")
        if len(self._clients) >= _MOST_CONNECTIONS:
            del self._clients[next(iter(self._clients))]
        self._clients[zid] = _Client(who, connected["address"].removeprefix("tls/"))
        if zid != self._without_rights:
            return None
        self._without_rights = ""
        return self._refused(who, EVERYTHING, "", t_ns)

    def _refused(self, who: str, key: str, what: str, t_ns: int) -> Event | None:
        if self._told[who, key] == 0 and self._keys[who] >= MOST_KEYS:
            key = OTHER_KEYS
        self._times[who, key, what] += 1
        times = self._times[who, key, what]
        least = MANY if key in self._common.get(who, ()) else 1
        if times < max(least, 2 * self._told[who, key]):
            return None
        self._keys[who] += self._told[who, key] == 0
        self._told[who, key] = times
        return Refused(t_ns, who, key, times)

    def _disconnected(self, line: str, t_ns: int) -> Event | None:
        if stalled := _STALLED.search(line):
            client, reason = self._clients.get(stalled["zid"]), DID_NOT_READ
        elif expired := _EXPIRED.search(line):
            address, reason = expired["address"], EXPIRED
            of_it = [known for known in self._clients.values() if known.address == address]
            client = of_it[-1] if of_it else None
        else:
            return None
        if client is None:
            return None
        self._times[client.who, "", reason] += 1
        times = self._times[client.who, "", reason]
        if times & (times - 1):
            return None
        return Disconnected(t_ns, client.who, client.address, reason, times)
