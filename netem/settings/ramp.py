"""A ramp: one number of a link's settings that moves from one value to another."""

import typing
from dataclasses import dataclass
from functools import cache
from typing import Any

from formnet.netem.files.problems import nearest
from formnet.netem.files.tables import Part
from formnet.netem.settings.links import LinkOverrides


@dataclass(frozen=True)
class Ramp:
    """Move ``parameter`` in a straight line from ``start`` to ``end`` within ``duration_ns``.

    ``parameter`` is a number's key as in :func:`ramped`, such as ``delay.mean_s``. A
    message sent a time t after the beginning meets start + (end - start) t / duration,
    rounded where the number is whole; from ``duration_ns`` on the value is ``end``.
    """

    parameter: str
    start: float
    end: float
    duration_ns: int

    def at(self, elapsed_ns: int) -> float:
        """The number ``elapsed_ns`` after the beginning."""
        share = min(1.0, elapsed_ns / self.duration_ns)
        value = self.end if share == 1.0 else self.start + (self.end - self.start) * share
        return round(value) if ramped()[self.parameter] else value


@cache
def ramped() -> dict[str, bool]:
    """Every number that may be ramped, and whether it is a whole number."""
    numbers: dict[str, bool] = {}
    for key, info in LinkOverrides.model_fields.items():
        for part in _leaves(info.annotation):
            if isinstance(part, type) and issubclass(part, Part):
                for name, leaf in part.model_fields.items():
                    _note(numbers, f"{key}.{name}", leaf.annotation)
        _note(numbers, key, info.annotation)
    return numbers


def checked_parameter(parameter: str) -> str:
    """``parameter`` if it may be ramped.

    Raises:
        ValueError: it may not.
    """
    if parameter not in ramped():
        hint = nearest(parameter, ramped()) or "; these can be: " + ", ".join(ramped())
        raise ValueError(f"{parameter!r} is not a number in a link's settings{hint}")
    return parameter


def _note(numbers: dict[str, bool], name: str, annotation: Any) -> None:
    kinds = set(_leaves(annotation)) - {type(None)}
    if kinds and kinds <= {int, float}:
        numbers[name] = kinds == {int}


def _leaves(annotation: Any) -> list[Any]:
    """The types that a union, or an annotated one, is made of."""
    if isinstance(annotation, type):
        return [annotation]
    arguments, origin = typing.get_args(annotation), typing.get_origin(annotation)
    if origin is list:
        return [list]
    if origin is typing.Annotated:
        arguments = arguments[:1]
    return [leaf for argument in arguments for leaf in _leaves(argument)]
