"""How much a TOML text may hold, so that reading it ends soon whoever wrote it.

What would keep a parser busy is found in the text before it is parsed (:func:`check_text`), the
rest in the tables (:func:`check_tables`). Both take time in proportion to the text.
"""

import re
from typing import Any

from formnet.netem.files.problems import dotted

MOST_BYTES = 2 * 2**20
"""Of a TOML file: 100,000 edges, or 1000 robots with all their values, take less."""
MOST_DEPTH = 32
"""Of tables and lists in one another, and of the parts of a dotted key."""
LONGEST_KEY = 100
_SHOWN = 30

_PART = r"""(?:[A-Za-z0-9_-]++|"(?:\\.|[^"\\\n])*+"|'[^'\n]*+')"""
_TOKEN = re.compile(
    r"""\"{3}(?:\\.|(?!\"{3})[^\\])*+(?:\"{3,5}|\Z)|'{3}(?:(?!'{3}).)*+(?:'{3,5}|\Z)|#[^\n]*+"""
    rf"""|(?P<key>{_PART}(?:[ \t]*+\.[ \t]*+{_PART})*+)"""
    r"""|"(?:\\.|[^"\\\n])*+|'[^'\n]*+""",
    re.DOTALL,
)
"""Strings, comments, and the words and numbers outside of them, with dots: no character is tried
twice."""
_QUOTED = re.compile(r""""(?:\\.|[^"\\\n])*+\"|'[^'\n]*+'""")
_WORD = re.compile(r"[A-Za-z0-9_-]+")


class TooMuch(ValueError):
    """Beyond a bound: ``place`` and ``value`` say where and what, ``rule`` the bound."""

    def __init__(self, place: str, value: str, rule: str) -> None:
        self.place, self.value, self.rule = place, value, rule
        super().__init__(f"{place} = {value}: {rule}" if place else f"{value}: {rule}")


def check_text(text: str) -> None:
    """See that a TOML text is short enough, and no dotted key of it has too many parts.

    Raises:
        TooMuch: it is not so; of a key, the line is named.
    """
    if len(text) > MOST_BYTES:
        raise TooMuch("", f"{len(text)} characters", f"must be at most {MOST_BYTES >> 20} MiB")
    for found in _TOKEN.finditer(text):
        key = found["key"]
        if key is None or (len(key) <= LONGEST_KEY and key.count(".") < MOST_DEPTH):
            continue
        line = text.count("\n", 0, found.start()) + 1
        plain = _QUOTED.sub("", key)
        parts = 1 + plain.count(".")
        if parts > MOST_DEPTH:
            rule = f"must have at most {MOST_DEPTH} parts (line {line})"
            raise TooMuch(f"{key[:_SHOWN]}…", f"a key of {parts} parts", rule)
        if any(len(word) > LONGEST_KEY for word in _WORD.findall(plain)):
            rule = f"must have at most {LONGEST_KEY} characters (line {line})"
            raise TooMuch(f"{key[:_SHOWN]}…", f"a key or number of {len(key)} characters", rule)


def check_tables(data: dict[str, Any]) -> None:
    """See that what was read is not too deep, keys are not too long, and numbers have 64 bits.

    TOML 1.0 demands whole numbers of 64 bits, and no more.

    Raises:
        TooMuch: it is not so.
    """
    waiting: list[tuple[tuple[str | int, ...], Any]] = [((), data)]
    while waiting:
        place, value = waiting.pop()
        if isinstance(value, dict | list):
            if len(place) > MOST_DEPTH:
                rule = f"must be at most {MOST_DEPTH} deep"
                raise TooMuch(_short(dotted(place)), "lists or tables in one another", rule)
            if isinstance(value, dict):
                for key in value:
                    if len(key) > LONGEST_KEY:
                        rule = f"must have at most {LONGEST_KEY}"
                        where = _short(dotted((*place, key[:_SHOWN])))
                        raise TooMuch(where, f"a key of {len(key)} characters", rule)
            items = value.items() if isinstance(value, dict) else enumerate(value)
            waiting.extend(((*place, key), item) for key, item in items)
        elif type(value) is int and not -(2**63) <= value < 2**63:
            rule = "must be within ±2^63, a whole number of 64 bits"
            raise TooMuch(dotted(place), f"a number of {value.bit_length()} bits", rule)


def _short(place: str) -> str:
    return place if len(place) <= 2 * _SHOWN else f"{place[: 2 * _SHOWN]}…"
