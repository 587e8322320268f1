"""Frozen dataclasses to and from plain data (as JSON and msgpack have it), by their annotations.

What is read comes from strangers: every value is checked, and what is wrong is named with its
place, its value and the rule. A field may have a rule of its own::

    t_ns: Annotated[int, not_negative]

and another name in the data than in the class: ``field(metadata={KEY: "for"})``.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import Field, fields, is_dataclass
from functools import cache, partial
from math import isfinite
from reprlib import Repr
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

KEY = "key"
"""In a field's metadata: its name in the data."""

Robots = Collection[int] | None
"""The ids of the robots that a scenario has; None: they are not known."""
Rule = Callable[[Any, Robots], str | None]
"""What is wrong with a value of the right type, or None."""
_SHORT = Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 60
_Reader = Callable[[Any, str, Robots], Any]
"""Takes a value, its place and the robots; raises Malformed."""

T = TypeVar("T")


class Malformed(ValueError):
    """Data that are no such record; the text names the place, the value and the rule."""

    @classmethod
    def at(cls, place: str, value: object, rule: str) -> "Malformed":
        """One that says that what is at ``place`` breaks a rule."""
        return cls(": ".join(filter(None, (place, _SHORT.repr(value), rule))))


def not_negative(value: int, _: Robots) -> str | None:
    """Rule: at least 0."""
    return None if value >= 0 else "must be at least 0"


def known(value: int, robots: Robots) -> str | None:
    """Rule: a robot of the scenario."""
    if robots is None or value in robots:
        return None
    few = list(robots)[:10]
    more = ", …" if len(robots) > len(few) else ""
    return f"no such robot (robots: {', '.join(map(str, few))}{more})"


RobotId = Annotated[int, known]
Nanoseconds = Annotated[int, not_negative]
Count = Annotated[int, not_negative]


def plain(value: Any) -> Any:
    """A value as JSON and msgpack have it: dictionaries with text for keys, and lists."""
    if is_dataclass(value):
        return {_key(item): plain(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    return value


def read(
    record: type[T], data: object, robots: Robots = None, place: str = "", **others: object
) -> T:
    """The ``record`` (a dataclass) that ``data`` describe, as :func:`plain` gives them.

    ``place`` is where they stand; ``others`` are fields that do not stand there.

    Raises:
        Malformed: they describe none.
    """
    some: Any = record  # a type is hashable, whatever mypy says
    readers = _readers(some)
    own = {key: reader for key, reader in readers.items() if reader[0] not in others}
    if type(data) is not dict:
        raise Malformed.at(place, data, "must be a table")
    for key in data:
        if key not in own:
            raise Malformed.at(place, key, f"is none of {', '.join(own) or 'no fields'}")
    found = {}
    for key, (name, reader) in readers.items():
        if key in own and key not in data:
            raise Malformed.at(place, data, f"{key} is missing")
        value = data[key] if key in own else others[name]
        found[name] = reader(value, f"{place}.{key}" if place else key, robots)
    return record(**found)


@cache
def _readers(kind: Any) -> dict[str, tuple[str, _Reader]]:
    """By its name in the data: a field's name, and its reader."""
    hints = get_type_hints(kind, include_extras=True)
    return {_key(item): (item.name, _reader(hints[item.name])) for item in fields(kind)}


@cache
def _reader(kind: Any) -> _Reader:
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _ruled(_reader(arguments[0]), arguments[1:])
    if origin is Literal:
        return _one_of(arguments)
    if origin in (UnionType, Union):
        return _any_of([_reader(argument) for argument in arguments])
    if origin is tuple:
        if arguments[-1] is ...:
            return _robots_of(_reader(arguments[0]))
        return _entries_of([_reader(argument) for argument in arguments])
    if origin is dict:
        return _mapping_of(*map(_reader, arguments))
    if is_dataclass(kind):
        return partial(_table, kind)
    return _VALUES[kind]


def _integer(value: Any, place: str, _: Robots) -> int:
    if type(value) is not int or not -(2**63) <= value < 2**63:
        raise Malformed.at(place, value, "must be an integer of 64 bits")
    return value


def _number(value: Any, place: str, _: Robots) -> float:
    if type(value) is int and abs(value) < 2**63:
        return float(value)
    if type(value) is not float or not isfinite(value):
        raise Malformed.at(place, value, "must be a finite number")
    return value


def _text(value: Any, place: str, _: Robots) -> str:
    if type(value) is not str or not _encodable(value):
        raise Malformed.at(place, value, "must be text")
    return value


def _encodable(value: str) -> bool:
    """JSON can escape half of a character, which no file and no terminal takes."""
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True


def _nothing(value: Any, place: str, _: Robots) -> None:
    if value is not None:
        raise Malformed.at(place, value, "must be null")


def _yes_or_no(value: Any, place: str, _: Robots) -> bool:
    if type(value) is not bool:
        raise Malformed.at(place, value, "must be true or false")
    return value


_VALUES: dict[Any, _Reader] = {
    int: _integer,
    float: _number,
    str: _text,
    bool: _yes_or_no,
    NoneType: _nothing,
}


def _table(kind: Any, value: Any, place: str, robots: Robots) -> Any:
    return read(kind, value, robots, place)


def _ruled(inner: _Reader, rules: tuple[Rule, ...]) -> _Reader:
    def check(value: Any, place: str, robots: Robots) -> Any:
        found = inner(value, place, robots)
        for rule in rules:
            if (problem := rule(found, robots)) is not None:
                raise Malformed.at(place, value, problem)
        return found

    return check


def _one_of(choices: tuple[Any, ...]) -> _Reader:
    def check(value: Any, place: str, _: Robots) -> Any:
        if type(value) is not str or value not in choices:
            raise Malformed.at(place, value, f"must be one of {', '.join(choices)}")
        return value

    return check


def _any_of(inner: list[_Reader]) -> _Reader:
    def check(value: Any, place: str, robots: Robots) -> Any:
        problems = []
        for one in inner:
            try:
                return one(value, place, robots)
            except Malformed as problem:
                problems.append(problem)
        raise problems[0]

    return check


def _robots_of(one: _Reader) -> _Reader:
    """A list of robots, each once: no longer than the scenario's, where that is known."""

    def check(value: Any, place: str, robots: Robots) -> tuple[Any, ...]:
        if type(value) not in (list, tuple):
            raise Malformed.at(place, value, "must be a list")
        if robots is not None and len(value) > len(robots):
            rule = f"must have at most {len(robots)} entries, as there are robots"
            raise Malformed.at(place, f"{len(value)} entries", rule)
        found = tuple(_entry(one, value, number, place, robots) for number in range(len(value)))
        if len(set(found)) < len(found):
            raise Malformed.at(place, value, "must name no robot twice")
        return found

    return check


def _entries_of(inner: list[_Reader]) -> _Reader:
    """A list of just these."""

    def check(value: Any, place: str, robots: Robots) -> tuple[Any, ...]:
        if type(value) not in (list, tuple):
            raise Malformed.at(place, value, "must be a list")
        if len(value) != len(inner):
            raise Malformed.at(place, value, f"must have {len(inner)} entries")
        return tuple(_entry(one, value, number, place, robots) for number, one in enumerate(inner))

    return check


def _entry(one: _Reader, entries: Any, number: int, place: str, robots: Robots) -> Any:
    """An entry of a list; its place is put into words only where it breaks a rule."""
    try:
        return one(entries[number], "", robots)
    except Malformed:
        return one(entries[number], f"{place}[{number}]", robots)


def _mapping_of(of_key: _Reader, of_value: _Reader) -> _Reader:
    """By robots' ids, which are text in the data."""

    def check(value: Any, place: str, robots: Robots) -> dict[Any, Any]:
        if type(value) is not dict:
            raise Malformed.at(place, value, "must be a table")
        found = {}
        for key, item in value.items():
            number = int(key) if type(key) is str and _is_id(key) else None
            found[of_key(number, f"{place}.{key!a}", robots)] = of_value(
                item, f"{place}.{key!a}", robots
            )
        return found

    return check


def _is_id(key: str) -> bool:
    return len(key) < 20 and key.isascii() and key.isdecimal() and str(int(key)) == key


def _key(item: Field[Any]) -> str:
    return str(item.metadata.get(KEY, item.name))
