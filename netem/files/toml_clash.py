"""Where a TOML text gives a key or a table twice, by name and line.

:mod:`tomllib` refuses such a text without saying which key it is, or where it was before. This
follows the text as far as that is well formed TOML 1.0, and no further.
"""

import re
import tomllib
from bisect import bisect_left
from itertools import accumulate
from typing import NamedTuple

Key = tuple[str | int, ...]
"""Parts of a dotted key; a number is a place in an array of tables."""

_SKIP = re.compile(r"(?:[ \t\n]|#[^\n]*)*")
_BLANK = re.compile(r"[ \t]*")
_PART = re.compile(r"""[A-Za-z0-9_-]+|"(?:\\.|[^"\\\n])*"|'[^'\n]*'""")
_STRING = re.compile(
    r'''"""(?:\\.|(?!""")[^\\])*"{3,5}|\'\'\'(?:(?!\'\'\').)*'{3,5}'''
    r"""|"(?:\\.|[^"\\\n])*"|'[^'\n]*'""",
    re.DOTALL,
)
_SCALAR = re.compile(r"[^\s,\[\]{}#\"'=]+(?: [0-9:.+Z-]+)?")


class Clash(NamedTuple):
    """``key`` is given on the lines ``begin`` to ``end`` (from 1), and clashes with an earlier one.

    ``earlier`` is the key on line ``first``: the same, or one that is part of the other.
    """

    key: str
    begin: int
    end: int
    earlier: str
    first: int

    def __str__(self) -> str:
        if self.key == self.earlier:
            return (
                f"{self.key} is given twice: on line {self.begin}, "
                f"and before that on line {self.first}"
            )
        return (
            f"{self.key} on line {self.begin} contradicts {self.earlier} on line {self.first}: a "
            "key is either a table or a value, and a table that is complete takes no more keys"
        )


def clash(text: str) -> Clash | None:
    """The first key or table of ``text`` that another before it excludes, if there is one.

    None, too, if the text is broken before that. Lines end with a line feed.
    """
    try:
        _Scanner(text).document()
    except _Found as found:
        return found.clash
    except (_Broken, RecursionError):
        pass
    return None


class _Broken(Exception):
    """This is no TOML."""


class _Found(Exception):
    def __init__(self, clash: Clash) -> None:
        self.clash = clash


class _Node:
    """What is known of a key: where it was given first, and what may still be added to it."""

    def __init__(self, line: int, *, by: str) -> None:
        self.line = line
        self.by = by  # "value", "inline", "dotted", "header", "implied" (by a header) or "array"
        self.inside: dict[str, _Node] = {}
        self.items: list[_Node] = []  # of an array of tables


class _Scanner:
    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self._begin = 1  # the line on which the statement begins
        self._ends = list(accumulate(len(line) + 1 for line in text.split("\n")))

    def document(self) -> None:
        """Follow the whole text; raises _Found or _Broken."""
        root = _Node(1, by="header")
        table, place = root, Key()
        while self._skip():
            self._begin = self._line()
            if self._take("[["):
                table, place = self._array_header(root)
            elif self._take("["):
                table, place = self._header(root)
            else:
                self._pair(table, place)
            self._end_of_line()

    # --- statements ----------------------------------------------------------------------

    def _header(self, root: _Node) -> tuple[_Node, Key]:
        parts = self._dotted()
        self._need("]")
        node, place = self._walk_header(root, parts)
        found = node.inside.get(parts[-1])
        key = (*place, parts[-1])
        if found is None:
            found = node.inside[parts[-1]] = _Node(self._begin, by="header")
        elif found.by == "implied":
            found.by = "header"
        else:
            self._clash(key, key, found)
        return found, key

    def _array_header(self, root: _Node) -> tuple[_Node, Key]:
        parts = self._dotted()
        self._need("]]")
        node, place = self._walk_header(root, parts)
        key = (*place, parts[-1])
        found = node.inside.setdefault(parts[-1], _Node(self._begin, by="array"))
        if found.by != "array":
            self._clash(key, key, found)
        found.items.append(_Node(self._begin, by="header"))
        return found.items[-1], (*key, len(found.items) - 1)

    def _walk_header(self, node: _Node, parts: list[str]) -> tuple[_Node, Key]:
        """The table in which the last of ``parts`` is, as a header names it."""
        place = Key()
        for part in parts[:-1]:
            place = (*place, part)
            node = node.inside.setdefault(part, _Node(self._begin, by="implied"))
            if node.by in ("value", "inline"):
                self._clash((*place, *parts[len(place) :]), place, node)
            if node.by == "array":
                place, node = (*place, len(node.items) - 1), node.items[-1]
        return node, place

    def _pair(self, node: _Node, place: Key) -> None:
        """``dotted.key = value`` in the table at ``place``."""
        begin = self._line()
        parts = self._dotted()
        self._need("=")
        end = place
        hit: tuple[Key, _Node] | None = None
        for part in parts[:-1]:
            end = (*end, part)
            node = node.inside.setdefault(part, _Node(begin, by="dotted"))
            if node.by == "implied":
                node.by = "dotted"
            elif node.by != "dotted" and hit is None:
                hit = end, node
        end = (*end, parts[-1])
        if hit is None and parts[-1] in node.inside:
            hit = end, node.inside[parts[-1]]
        found = _Node(begin, by="value")
        self._value(found, end)
        if hit is not None:  # said by tomllib once it has read the value
            self._clash((*place, *parts), *hit, begin=begin)
        node.inside[parts[-1]] = found

    def _value(self, node: _Node, place: Key) -> None:
        self._blank()
        if self._take("{"):
            node.by = "inline"
            if not self._take("}"):
                self._pair(node, place)
                while not self._take("}"):
                    self._need(",")
                    self._pair(node, place)
        elif self._take("["):
            count = 0
            while self._skip() and not self._take("]"):
                self._value(_Node(self._line(), by="value"), (*place, count))
                count += 1
                self._skip()
                if not self._take(","):
                    self._need("]")
                    return
        elif not self._match(_STRING) and not self._match(_SCALAR):
            raise _Broken

    # --- pieces ----------------------------------------------------------------------------

    def _dotted(self) -> list[str]:
        parts = []
        while True:
            self._blank()
            part = self._match(_PART)
            if not part:
                raise _Broken
            parts.append(_unquoted(part))
            self._blank()
            if not self._take("."):
                return parts

    def _match(self, pattern: re.Pattern[str]) -> str:
        found = pattern.match(self._text, self._at)
        if found is None:
            return ""
        self._at = found.end()
        return found[0]

    def _take(self, word: str) -> bool:
        """Whether ``word`` comes next, after blanks; then it is behind us."""
        self._blank()
        there = self._text.startswith(word, self._at)
        self._at += len(word) * there
        return there

    def _need(self, word: str) -> None:
        if not self._take(word):
            raise _Broken

    def _blank(self) -> None:
        self._match(_BLANK)

    def _skip(self) -> bool:
        """Whether anything follows after blanks, lines and comments."""
        self._match(_SKIP)
        return self._at < len(self._text)

    def _end_of_line(self) -> None:
        self._blank()
        if self._text[self._at : self._at + 1] not in ("", "\n", "#"):
            raise _Broken

    def _line(self) -> int:
        return bisect_left(self._ends, self._at + 1) + 1

    def _clash(self, key: Key, earlier: Key, node: _Node, begin: int | None = None) -> None:
        raise _Found(
            Clash(
                _written(key),
                self._begin if begin is None else begin,
                self._line(),
                _written(earlier),
                node.line,
            )
        )


def _unquoted(part: str) -> str:
    if part[0] == "'":
        return part[1:-1]
    if part[0] != '"':
        return part
    try:
        value: str = tomllib.loads(f"value = {part}")["value"]
    except tomllib.TOMLDecodeError:
        raise _Broken from None
    return value


def _written(key: Key) -> str:
    """A dotted key as messages have it: ``robots[2].start.x_m``."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            plain = re.fullmatch(r"[A-Za-z0-9_-]+", part) is not None
            text += ("." if text else "") + (part if plain else f'"{part}"')
    return text
