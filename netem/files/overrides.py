"""Values by key path: the one way in which settings are changed.

``--set law.beta=5``, an entry of ``[[network.links]]``, a preset, a change and a ramp of the
timeline all come down to ``path -> value`` pairs that are put into plain tables (:func:`assign`)
before the whole is validated again.
"""

import re
from collections.abc import Mapping
from typing import Any

from formnet.netem.files.bounds import LONGEST_KEY, MOST_DEPTH

Values = Mapping[str, Any]
"""Values by key path, such as ``{"delay.mean_s": 0.1}``; a later one wins."""


_NUMBER = re.compile(r"[0-9]{1,10}")


class OverrideError(ValueError):
    """A key path that leads nowhere: ``place`` is how far it goes, ``rule`` what is wrong there."""

    def __init__(self, place: str, rule: str) -> None:
        self.place, self.rule = place, rule
        super().__init__(f"{place}: {rule}")


def assign(data: dict[str, Any], path: str, value: Any) -> None:
    """Put ``value`` where ``path`` leads in nested tables, making the tables on the way.

    Items of a list are named by their ``id``, or by their numbers from 0 if they have none.

    Raises:
        OverrideError: the path goes through a value, or names an item that is not there.
    """
    keys = path.split(".")
    if len(keys) > MOST_DEPTH or max(map(len, keys)) > LONGEST_KEY:
        rule = f"must have at most {MOST_DEPTH} parts of at most {LONGEST_KEY} characters"
        raise OverrideError(f"{path[:LONGEST_KEY]}…", rule)
    here: Any = data
    for depth, key in enumerate(keys, start=1):
        last = depth == len(keys)
        if isinstance(here, list):
            known = _names_of(here)
            if not _NUMBER.fullmatch(key) or int(key) not in known:
                there = ", ".join(map(str, known))
                raise OverrideError(
                    ".".join(keys[:depth]), f"there is no {key!r} in this list (there: {there})"
                )
            index = known.index(int(key))
            if last:
                here[index] = value
            else:
                here = here[index]
        elif isinstance(here, dict):
            if last:
                here[key] = value
            else:
                here = here.setdefault(key, {})
        else:
            raise OverrideError(
                ".".join(keys[:depth]), f"{'.'.join(keys[: depth - 1])} is not a table"
            )


def _names_of(items: list[Any]) -> list[Any]:
    """By what the items of a list are addressed: their ``id``, or else their numbers from 0."""
    if any(isinstance(item, dict) and "id" in item for item in items):
        return [item.get("id") if isinstance(item, dict) else None for item in items]
    return list(range(len(items)))
