"""Kinds of values that options of ``formnet`` take."""

from typing import Any

import click


class Whole(click.IntRange):
    """A whole number within bounds; errors call it that."""

    name = "whole number"


class Number(click.FloatRange):
    """A number within bounds; errors call it that."""

    name = "number"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number: float = super().convert(value, param, ctx)
        if number != number:  # no bound keeps nan out
            self.fail(f"{value!r} is not a valid {self.name}.", param, ctx)
        return number
