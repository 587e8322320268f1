"""What all sections of a verdict share: strict, closed and frozen models, and bounded numbers.

A verdict is also read back from files of unknown origin. What is computed from its numbers must
not fail, so times and counts are bounded here.
"""

from math import isfinite
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, FailFast, Field

Instant = Annotated[float, Field(ge=0.0, le=1e10)]
"""Seconds since the start of a run; as nanoseconds it fits into 64 bits."""
Count = Annotated[int, Field(ge=0, lt=2**63)]
PositiveCount = Annotated[int, Field(ge=1, lt=2**63)]
RobotId = Annotated[int, Field(ge=0, lt=2**31)]
Item = TypeVar("Item")
Listed = Annotated[list[Item], FailFast()]
"""A list of which the first wrong item alone is named: all could be wrong."""


class Section(BaseModel):
    """A part of a verdict: strict types, finite numbers, unknown keys refused, immutable."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        defer_build=True,  # the validator is built when the first verdict is made or read
    )


def finite(value: Any) -> float | None:
    """A number as a verdict has it: None where it is not finite."""
    return float(value) if isfinite(value) else None
