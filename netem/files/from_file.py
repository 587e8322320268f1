"""Tables whose lists of numbers may come from a CSV file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Self

from pydantic import (
    GetJsonSchemaHandler,
    ModelWrapValidatorHandler,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, ErrorDetails, InitErrorDetails, PydanticCustomError

from formnet.netem.files.csv_file import MOST_ROWS, FileError, Numbers, first_of, read_numbers
from formnet.netem.files.problems import rule_of, shown
from formnet.netem.files.tables import Table


class RowError(ValueError):
    """A number of a list that breaks a rule, which says what it must be.

    ``key`` names the list and ``row`` counts from 0. The text says where the number stands in
    TOML; of a CSV file, :class:`FromFile` says line and column instead.
    """

    def __init__(self, key: str, row: int, value: float, rule: str) -> None:
        self.key, self.row, self.value, self.rule = key, row, value, rule
        super().__init__(f"{key}[{row}] = {shown(value)}: {rule}")


class Reading:
    """The files that one validation has read, by path and columns, and the rows that tables took.

    As ``reading`` in the context of a validation it lets each file be read once, and bounds what
    all tables take together.
    """

    def __init__(self) -> None:
        self.files: dict[tuple[Path, int], Numbers | FileError] = {}
        self.rows = 0


class FromFile(Table):
    """A table that may name a CSV ``file`` instead of giving the numbers.

    Where it is looked for is ``folder`` in the context of the validation; it must lie below that,
    links resolved, unless the context says ``allow_outside``. The rules for the
    numbers are the same for both, and written once: as types, and in :meth:`check`.
    """

    COLUMNS: ClassVar[tuple[str, ...]] = ()
    """The keys whose lists the columns of a file are, in its order."""

    def check(self) -> None:
        """See to what must fit together.

        Raises:
            RowError: a number of a list does not go with the others.
            ValueError: something else does not.
        """

    @classmethod
    def numbers(cls, rows: list[list[float]]) -> dict[str, list[Any]]:
        """The lists by their keys, from the rows of a file."""
        return {key: [row[k] for row in rows] for k, key in enumerate(cls.COLUMNS)}

    @model_validator(mode="after")
    def _checked(self) -> Self:
        self.check()
        return self

    @model_validator(mode="wrap")  # around _checked, so that it sees every error
    @classmethod
    def _read(
        cls, data: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo
    ) -> Self:
        if isinstance(data, cls):  # checked when it was made
            return data
        if not isinstance(data, Mapping) or "file" not in data:
            return handler(data)
        try:
            found = _numbers(data, cls.COLUMNS, info.context or {})
        except FileError as error:
            raise _of_file(str(error)) from None
        rest = {key: value for key, value in data.items() if key != "file"}
        try:
            return handler(rest | cls.numbers(found.rows))
        except ValidationError as error:
            told = cls._told(error.errors(), data, found)
            raise ValidationError.from_exception_data(cls.__name__, told) from None

    @classmethod
    def _told(cls, errors: list[ErrorDetails], data: Any, found: Numbers) -> list[InitErrorDetails]:
        """``errors`` as those of a table with a file: of its numbers, one with line and column."""
        rest: list[InitErrorDetails] = []
        of_cells: list[tuple[int, int, str]] = []
        for item in errors:
            cell = _cell(item)
            if cell is None:
                whole = isinstance(item["input"], Mapping)
                rest.append(
                    {
                        "type": item["type"],
                        "loc": item["loc"],
                        "ctx": item.get("ctx", {}),
                        "input": data if whole else item["input"],
                    }
                )
            else:
                column = cls.COLUMNS.index(cell.key)
                place = found.place(cell.row, column)
                of_cells.append((cell.row, column, f"{place}: {cell.rule}"))
        if of_cells:
            error = _of_file(first_of([text for _, _, text in sorted(of_cells)]))
            rest.append({"type": error, "loc": (), "input": data})
        return rest

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
                "A CSV file (UTF-8) instead of the lists, one column each, from the scenario's "
                "folder; a first row of words alone is a header."
            ),
        }
        return schema


def _numbers(
    data: Mapping[str, Any], lists: tuple[str, ...], context: Mapping[str, Any]
) -> Numbers:
    """The numbers of the file that a table names; raises FileError."""
    path = _path(data, lists, context)
    reading: Reading = context.get("reading", Reading())
    known = (path.resolve(), len(lists))
    if known not in reading.files:
        try:
            reading.files[known] = read_numbers(path, len(lists))
        except FileError as error:
            reading.files[known] = error
    found = reading.files[known]
    if isinstance(found, FileError):
        raise found
    reading.rows += len(found.rows)
    if reading.rows > MOST_ROWS:
        raise FileError(
            f"file {path} has {len(found.rows)} rows: all tables that name files must take at most "
            f"{MOST_ROWS} rows together"
        )
    return found


def _path(data: Mapping[str, Any], lists: tuple[str, ...], context: Mapping[str, Any]) -> Path:
    """The file that a table names; raises FileError if it may not."""
    folder, file = context.get("folder"), data["file"]
    if folder is None:
        raise FileError("may only be named in a file; give the numbers")
    if not isinstance(file, str):
        raise FileError("must be a string")
    beside = [key for key in lists if key in data]
    if beside:
        raise FileError(f"{beside[0]} is given, too: only one of them can be")
    path = Path(folder, file)
    try:
        real, below = path.resolve(), Path(folder).resolve()
    except (OSError, ValueError, RuntimeError) as error:  # a null character, links in a circle
        raise FileError(f"file {str(path)!r} cannot be read: {error}") from None
    if not context.get("allow_outside") and not real.is_relative_to(below):
        more = (
            "; --allow-outside (in Python allow_outside=True) reads it all the same"
            if "allow_outside" in context  # a bridge has no such option
            else ""
        )
        raise FileError(f"must lie below the folder of what names it, links resolved{more}")
    return path


def _of_file(text: str) -> PydanticCustomError:
    """What :mod:`netem.files.problems` says of the key ``file``."""
    return PydanticCustomError("file", "{text}", {"key": "file", "text": text})


def _cell(item: ErrorDetails) -> RowError | None:
    """The number of a list that an error of pydantic is about, if it is about one."""
    cause = item.get("ctx", {}).get("error")
    if isinstance(cause, RowError):
        return cause
    match item["loc"]:
        case (str() as key, int() as row):
            return RowError(key, row, item["input"], rule_of(item))
    return None
