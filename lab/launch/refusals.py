"""What the hub's access control did not let through, read from its log.

Zenoh drops what is not allowed silently. At the level TRACE it logs each decision, but for a
key that either end has declared all possible decisions at once, whether anybody asks for them
or not, and then no more. So what a party is denied on the keys that it speaks or hears in every
run says little unless it comes again and again; on any other key, it has tried something.
"""

import re
from collections import Counter
from typing import NamedTuple

from formnet.formation.briefing.plan import Plan
from formnet.formation.machines.generations import Generations
from formnet.formation.wire.bus import Keys
from formnet.formation.wire.security import MONITOR, robot_name

LOG_FILTER = "warn,zenoh::net::routing::interceptor::access_control=trace"
"""For ``RUST_LOG``."""
MANY = 8
"""How often a party must be denied a key that it hears: each new connection declares it once."""
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_MODULE = "interceptor::access_control:"
_DENIED = re.compile(
    r"\+CertCommonName\((?P<who>.*?)\)\+.* is unauthorized to (?P<what>.+?) \(ingress\)"
    r" on (?P<key>\S+)"
)


class Refusal(NamedTuple):
    """``who`` was denied ``key``, so often up to now (at least).

    It is the name of a party or, with a certificate that does not count, its common name.
    """

    who: str
    key: str
    times: int


class Refusals:
    """Reads the log of the hub of ``run``, which admits what is ``counting``, line by line."""

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
        self._names = {counting.admitted(name): name for name in self._common}
        self._times: Counter[tuple[str, str, str]] = Counter()
        self._told: Counter[tuple[str, str]] = Counter()

    def read(self, line: str) -> tuple[str | None, Refusal | None]:
        """The line without its colours, if it is fit for people; and what it tells.

        A refusal is told at the first and then at every doubling.
        """
        line = _COLOURS.sub("", line)
        if _MODULE not in line:
            return line, None
        denied = _DENIED.search(line)
        if denied is None:
            return None, None
        what, key = denied["what"], denied["key"]
        who = self._names.get(denied["who"], denied["who"])
        if who in self._common and who == denied["who"]:  # of an earlier version
            who = f"{who}.0"
        self._times[who, key, what] += 1
        times = self._times[who, key, what]
        least = MANY if key in self._common.get(who, ()) else 1
        if times < max(least, 2 * self._told[who, key]):
            return None, None
        self._told[who, key] = times
        return None, Refusal(who, key, times)
