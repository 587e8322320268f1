"""What all tables of settings share: strict types and units."""

import typing
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, create_model
from pydantic.fields import FieldInfo

STRICT = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

Seconds = Annotated[float, Field(ge=0.0, le=3600.0)]
PositiveSeconds = Annotated[float, Field(ge=1e-9, le=3600.0)]
"""From a nanosecond to an hour: times in the loop and on links."""
LongSeconds = Annotated[float, Field(ge=1e-9, le=1e9)]
"""From a nanosecond to 30 years, of which the nanoseconds fit into 64 bits: lengths of runs."""
Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Shape = Annotated[float, Field(ge=0.1)]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Correlation = Annotated[float, Field(ge=0.0, lt=1.0)]
Count = Annotated[int, Field(ge=0, le=10**12)]


def nanoseconds(seconds: float) -> int:
    """Seconds as the nearest whole number of nanoseconds."""
    return round(seconds * 1e9)


class Table(BaseModel):
    """A table: strict types, unknown keys refused, immutable."""

    model_config = STRICT


class Part(Table):
    """Some keys of a table; what is not named is None, and stays as it is where it is applied."""


def members(union: Any) -> tuple[type[Table], ...]:
    """The tables of an annotated union."""
    return typing.get_args(typing.get_args(union)[0])


def optional(info: FieldInfo) -> tuple[Any, Any]:
    """A field as :func:`pydantic.create_model` takes it: like ``info``, but None by default."""
    again: Any = Field(None, description=info.description, json_schema_extra=info.json_schema_extra)
    return info.rebuild_annotation() | None, again


def part_of(*tables: type[Table], leave_out: str = "") -> type[Part]:
    """A :class:`Part` that may name any key of ``tables``, but for ``leave_out``."""
    keys: dict[str, Any] = {}
    for table in tables:
        for name, info in table.model_fields.items():
            if name != leave_out:
                keys.setdefault(name, optional(info))
    words = tables[0].__doc__ if len(tables) == 1 else None
    return create_model(f"PartOf{tables[0].__name__}", __base__=Part, __doc__=words, **keys)
