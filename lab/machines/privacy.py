"""What is recorded of a run tells nothing of the machines: addresses, users, folders of keys.

Logs and texts come from processes, libraries and systems that know nothing of that, so what is
known of the machines, and what looks like an address or a home folder, is replaced in them.
"""

import dataclasses
import re
import socket
from collections.abc import Callable, Iterable
from ipaddress import ip_address
from pathlib import Path, PurePosixPath
from typing import Any

from formnet.formation.machines.addresses import endpoint
from formnet.formation.machines.hosts import Hosts
from formnet.formation.records.events import Event
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.stream import Record

_SHORTEST_NAME = 3
"""A shorter name would be found in words that have nothing to do with it."""
_FREE = {"reason", "what", "address"}
"""Fields of events and outcomes in which a process may say anything, or that say where one is."""
_HOME = re.compile(r"(?<![\w.])/(?:home|Users)/[^/\s:'\",)]+|(?<![\w./])/root(?![\w.-])")
_ADDRESS = re.compile(
    r"(?<![\w.:])(?:\d{1,3}(?:\.\d{1,3}){3}|[0-9a-fA-F]{0,4}(?::[0-9a-fA-F]{0,4}){2,7})(?![\w.])"
)


class Private:
    """Replaces in texts what tells of ``hosts``, this machine and the folder ``keys``."""

    def __init__(self, hosts: Hosts | None, keys: Path | None) -> None:
        folders = set() if keys is None else {str(keys), str(keys.absolute()), str(keys.resolve())}
        names, users, pythons = {socket.gethostname()}, set(), set()
        if hosts is not None:
            names.add(endpoint(hosts.listen)[1])
            for host in hosts.hosts:
                names |= {host.target.address}
                users |= {host.target.user} - {""}
                if host.keys is not None:
                    folders.add(host.keys)
                path = PurePosixPath(host.python)
                if path.parent != PurePosixPath("."):
                    pythons |= {str(path.parent.parent), str(path)}
        self._replacements = [
            (_any(folders - {"", ".", "/"}, r"(?<![\w.])", r"(?![\w.-])"), "KEYS"),
            (_any(pythons - {"", ".", "/", "/usr"}, r"(?<![\w.])", r"(?![\w.-])"), "PYTHON"),
            (_any(users, r"(?<![\w.])", "@"), "USER@"),
            (_HOME, "~"),
            (
                _any((n for n in names if len(n) >= _SHORTEST_NAME), r"(?<![\w.-])", r"(?![\w-])"),
                "ADDRESS",
            ),
        ]

    def __call__(self, text: str) -> str:
        """``text`` without what it tells."""
        for pattern, instead in self._replacements:
            text = pattern.sub(instead, text)
        return _ADDRESS.sub(_unless_loopback, text)

    def record(self, record: Record) -> Record:
        """``record`` with its texts so."""
        if not isinstance(record, Event | Outcome):
            return record
        there = {field.name for field in dataclasses.fields(record)}
        texts: dict[str, Any] = {name: self(getattr(record, name)) for name in _FREE & there}
        return dataclasses.replace(record, **texts)

    def sink(self, sink: Callable[[Record], None]) -> Callable[[Record], None]:
        """What takes records and gives them on to ``sink`` with such texts."""
        return lambda record: sink(self.record(record))


def _any(words: Iterable[str], before: str, after: str) -> re.Pattern[str]:
    """One of ``words``, the longest first; of none, a pattern that matches nothing."""
    listed = sorted(words, key=len, reverse=True)
    return re.compile(
        f"{before}(?:{'|'.join(map(re.escape, listed))}){after}" if listed else "(?!)"
    )


def _unless_loopback(found: re.Match[str]) -> str:
    try:
        address = ip_address(found[0])
    except ValueError:
        return found[0]
    return found[0] if address.is_loopback or address.is_unspecified else "ADDRESS"
