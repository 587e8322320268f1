"""What is wrong with a file's settings: each problem with its place, its value and the rule.

Turns a pydantic error into words for people, for whatever model the file is.
"""

import difflib
import re
import types
import typing
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError

from formnet.netem.files.printable import printable

Place = tuple[str | int, ...]


MOST_SHOWN = 20
"""So many problems of one file are put into words; the others are counted."""


class Problem(NamedTuple):
    """One thing wrong: where, what stands there (None: nothing to show), which rule it breaks.

    ``place`` is empty if it is the file as a whole.
    """

    place: str
    value: str | None
    rule: str

    def __str__(self) -> str:
        value = "" if self.value is None else f" = {self.value}"
        place = f"{printable(self.place)}{value}: " if self.place else ""
        return printable(f"{place}{self.rule}", lines=True)


def problems(
    model: type[BaseModel], data: Any, error: ValidationError, most: int = MOST_SHOWN
) -> list[Problem]:
    """What ``error`` says about ``data``, which should have been a ``model``.

    The first ``most`` in words; if there are more, their number comes last.
    """
    found = error.errors(include_url=False)[:most]
    told = [_problem(model, data, item["loc"], item["type"], item) for item in found]
    return told + _further(error.error_count() - most)


def first_of(found: Sequence[Problem], most: int = MOST_SHOWN) -> list[Problem]:
    """The first ``most`` of some problems; if there are more, their number comes last."""
    return [*found[:most], *_further(len(found) - most)]


def _further(count: int) -> list[Problem]:
    if count <= 0:
        return []
    return [Problem("", None, f"and {count:,} more problem{'s' * (count > 1)}")]


_RULES = {
    "string_type": "must be a string",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "float_type": "must be a number",
    "bool_type": "must be true or false",
    "list_type": "must be a list",
    "tuple_type": "must be a list",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "finite_number": "must be finite",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "literal_error": "must be {expected}",
    "union_tag_invalid": "must be one of {expected_tags}",
    "union_tag_not_found": "needs {discriminator} to say which kind it is",
    "too_short": "needs {min_length} or more",
    "too_long": "must have {most} {max_length} items",
    "string_too_long": "must have at most {max_length} characters",
    "string_pattern_mismatch": "must start with a letter or digit; then letters, digits, . _ -",
    "value_error": "{error}",
}


def rule_of(item: Any) -> str:
    """The rule that one of a pydantic error's errors says is broken, in words."""
    template = _RULES.get(item["type"])
    said: str = (
        item["msg"]
        if template is None
        else template.format(most=_most(item), **item.get("ctx", {}))
    )
    return said


def _most(item: Any) -> str:
    """Pairs have an exact length; lists a greatest."""
    return "at most" if item.get("ctx", {}).get("field_type") == "List" else "exactly"


def _problem(model: type[BaseModel], data: Any, loc: Place, kind: str, item: Any) -> Problem:
    value, context = item["input"], item.get("ctx", {})
    if kind == "missing":
        return Problem(dotted((*_place(data, loc[:-1]), loc[-1])), None, "is required")
    to_blame = context.get("key", context.get("discriminator", "")).strip("'")
    if isinstance(value, dict) and to_blame in value:  # said of a table, for one of its keys
        loc, value = (*loc, to_blame), value[to_blame]
    place = dotted(_place(data, loc))
    if kind == "extra_forbidden":
        return Problem(place, shown(value), _unknown_key(model, loc))
    rule = rule_of(item)
    if kind == "float_type":
        rule += _unit(place)
    expected = next((context[key] for key in ("expected", "expected_tags") if key in context), "")
    return Problem(place, shown(value), rule + nearest(str(value), re.findall("'(.*?)'", expected)))


_UNITS = {
    "_s": "seconds",
    "_m": "metres",
    "_rad": "radians",
    "_radps": "radians a second",
    "_mps": "metres a second",
    "_kg": "kilograms",
    "_kgm2": "kg m²",
    "_nm": "N m",
    "_n": "newtons",
}


def _unit(place: str) -> str:
    """Of what a number is, where the key says it in its last part."""
    _, mark, ending = place.rpartition("_")
    unit = _UNITS.get(mark + ending)
    return f", of {unit}" if unit else ""


def _place(data: Any, loc: Place) -> Place:
    """``loc`` as far as the file has it: without pydantic's names of union members."""
    place: list[str | int] = []
    for part in loc:
        inside = part in data if isinstance(data, dict) else isinstance(data, list | tuple)
        if inside and (isinstance(data, dict) or (isinstance(part, int) and part < len(data))):
            data = data[part]
            place.append(part)
    return tuple(place)


def _unknown_key(model: type[BaseModel], loc: Place) -> str:
    known = sorted(_keys_at(model, loc[:-1]))
    if loc[-1] in ("from", "to") and "links" in known:  # as [[network.links]] has them
        return "unknown key; here it is links = [[from, to], ...]"
    return f"unknown key{nearest(str(loc[-1]), known) or '; valid keys here: ' + ', '.join(known)}"


def nearest(name: str, known: typing.Iterable[str]) -> str:
    """``; did you mean 'x'?``, or nothing if nothing is near."""
    near = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def _keys_at(model: type[BaseModel], loc: Place) -> set[str]:
    """The keys that the table at ``loc`` may have."""
    keys: set[str] = set()
    for found in _models_at(model, loc):
        keys |= {info.alias or name for name, info in found.model_fields.items()}
    return keys


def _models_at(model: type[BaseModel], loc: Place) -> list[type[BaseModel]]:
    models: list[type[BaseModel]] = [model]
    for part in loc:
        if isinstance(part, int):
            continue
        deeper = [
            found
            for model in models
            for name, info in model.model_fields.items()
            if part in (name, info.alias)
            for found in _models_in(info.annotation)
        ]
        # A part that is no field is a union's tag: narrow to the models that have it.
        models = deeper or [m for m in models if part in _tags_of(m)] or models
    return models


def _tags_of(model: type[BaseModel]) -> set[Any]:
    return {
        value
        for info in model.model_fields.values()
        if typing.get_origin(info.annotation) is typing.Literal
        for value in typing.get_args(info.annotation)
    }


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    elif typing.get_origin(annotation) in (list, typing.Annotated, typing.Union, types.UnionType):
        for argument in typing.get_args(annotation):
            yield from _models_in(argument)


def dotted(place: Place) -> str:
    """``("robots", 0, "id")`` as ``robots[0].id``."""
    text = ""
    for part in place:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def shown(value: Any) -> str:
    """A value as people write it, not too long."""
    text = repr(value) if not isinstance(value, bool) else str(value).lower()
    return text if len(text) <= 60 else text[:57] + "..."
