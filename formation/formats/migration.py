"""From an older format of scenarios to the current one, as plain tables.

A scenario states its format with its first key, ``format = 2``; without it, it is of format 1.
Every reader migrates in memory (:func:`migrate`), so older files and recorded runs stay usable;
``formnet migrate`` rewrites them. A new format is one more function in ``_STEPS``.
"""

from collections.abc import Callable, MutableMapping
from typing import Any, Final

Tables = MutableMapping[str, Any]

FORMAT: Final = 2
"""The current format."""


class FormatError(ValueError):
    """Tables of a format that cannot be migrated: ``place`` and ``value`` say what is wrong."""

    def __init__(self, place: str, value: object, rule: str) -> None:
        self.place, self.value, self.rule = place, value, rule
        super().__init__(f"{place}: {rule}")


def format_of(data: Tables) -> int:
    """The format of a scenario.

    Raises:
        FormatError: it names none that there is.
    """
    found = data.get("format", 1)
    if isinstance(found, bool) or not isinstance(found, int) or found < 1:
        raise FormatError("format", found, f"must be a whole number from 1 to {FORMAT}")
    if found > FORMAT:
        raise FormatError(
            "format",
            found,
            f"is newer than this version of formnet, which reads 1 to {FORMAT}: update it",
        )
    return found


def migrate(data: Tables) -> list[str]:
    """Bring ``data`` to the current format, in place; returns what was changed, in words.

    Raises:
        FormatError: see :func:`format_of`; or an older key with a value that it never could have.
    """
    changes = []
    for number in range(format_of(data), FORMAT):
        changes += _STEPS[number](data)
    if "format" in data:  # where it stands already, it stays
        data["format"] = FORMAT
    return changes


def _playout_of_links(data: Tables) -> list[str]:
    """Format 2: a playout buffer is a setting of links alone (``playout_s``).

    Format 1 had ``neighbours.playout = "fixed"`` beside it, which gave every link that had no
    buffer of its own one of ``neighbours.playout_s``.
    """
    neighbours = data.get("neighbours")
    if not isinstance(neighbours, MutableMapping) or not {"playout", "playout_s"} & set(neighbours):
        return []
    playout = neighbours.pop("playout", "latest")
    playout_s = neighbours.pop("playout_s", None)
    if playout not in ("latest", "fixed"):
        rule = "must be 'latest' or 'fixed'; since format 2 it is network.default.playout_s"
        raise FormatError("neighbours.playout", playout, rule)
    if not neighbours:
        del data["neighbours"]
    if playout == "latest":
        return ['neighbours.playout = "latest" is gone: it was the default']
    if playout_s is None:
        rule = '"fixed" needs playout_s; since format 2 it is network.default.playout_s alone'
        raise FormatError("neighbours.playout", playout, rule)
    network = data.setdefault("network", {})
    tables = [network.setdefault("default", {})] if isinstance(network, MutableMapping) else []
    for rule_of_links in network.get("links", []) if tables else []:
        names = isinstance(rule_of_links, MutableMapping) and {"preset", "playout_s"}
        if names and names & set(rule_of_links):  # what would take the buffer away again
            tables.append(rule_of_links)
    for table in tables:
        if isinstance(table, MutableMapping) and not table.get("playout_s"):
            table["playout_s"] = playout_s
    return [f"neighbours.playout_s = {playout_s} is network.default.playout_s now"]


_STEPS: Final[dict[int, Callable[[Tables], list[str]]]] = {1: _playout_of_links}
"""The way from each format to the next."""
