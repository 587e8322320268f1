"""What all tables of settings share: strict types, units, numbers from CSV files."""

import csv
import math
import tomllib
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ValidationInfo,
    create_model,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

STRICT = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

Seconds = Annotated[float, Field(ge=0.0, le=3600.0)]
PositiveSeconds = Annotated[float, Field(ge=1e-9, le=3600.0)]
Positive = Annotated[float, Field(gt=0.0)]
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


class FromFile(Table):
    """A table that may name a CSV ``file`` instead of giving the numbers.

    Where it is looked for is ``folder`` in the context of the validation.
    """

    @model_validator(mode="before")
    @classmethod
    def _read(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, Mapping) or "file" not in data:
            return data
        folder = (info.context or {}).get("folder")
        if folder is None:
            raise ValueError(f"file {data['file']}: may only be named in a file; give the numbers")
        rest = {key: value for key, value in data.items() if key != "file"}
        return rest | cls.columns(Path(folder, str(data["file"])))

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        schema = handler.resolve_ref_schema(handler(core))
        required = schema.get("required", [])
        kind = [name for name in required if "const" in schema["properties"][name]]
        schema["anyOf"] = [{"required": required}, {"required": [*kind, "file"]}]
        schema["required"] = kind
        schema["properties"]["file"] = {
            "type": "string",
            "description": (
                "A CSV file instead of the lists, one column each, from the scenario's folder; "
                "a first row of words is a header."
            ),
        }
        return schema

    @classmethod
    def columns(cls, path: Path) -> dict[str, Any]:
        """The file's columns by the names they have in the table."""
        raise TypeError(cls)


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises:
        ValueError: it cannot be read, or is no TOML; the text says which.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"not TOML: not UTF-8 text (byte {error.start})") from None
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"not TOML: {error}") from None


def read_numbers(path: Path, columns: int) -> list[list[float]]:
    """The rows of a CSV file of ``columns`` finite numbers; a first row of words is a header.

    Raises:
        ValueError: it cannot be read, is empty, or a row is something else; names file and line.
    """
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            lines = list(enumerate(csv.reader(stream), start=1))
    except OSError as error:
        raise ValueError(f"file {path} cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"file {path} is no CSV: {error}") from None
    rows = []
    for number, row in lines:
        if not row:
            continue
        try:
            values = [float(field) for field in row]
        except ValueError:
            if number == 1:
                continue
            values = []
        if len(values) != columns or not all(map(math.isfinite, values)):
            raise ValueError(
                f"file {path}, line {number}: {','.join(row)!r} is not {columns} finite number(s)"
            )
        rows.append(values)
    if not rows:
        raise ValueError(f"file {path} holds no numbers")
    return rows
