"""Numbers from CSV files; what is wrong with one is told with its line and column."""

import csv
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from formnet.netem.files import regular

MOST_BYTES = 32 * 2**20
"""Of a file."""
MOST_ROWS = 1_000_000


class Numbers(NamedTuple):
    """The rows of a CSV file of numbers, and the line of the file on which each begins."""

    path: Path
    rows: list[list[float]]
    lines: list[int]

    def place(self, row: int, column: int | None = None) -> str:
        """Where a row (from 0) stands, or one of its cells (from 0), in words."""
        return _place(self.path, self.lines[row], column)


class FileError(ValueError):
    """A CSV file that cannot be used; the text names the file, and line and column if it can."""


def read_numbers(path: Path, columns: int) -> Numbers:
    """The rows of a CSV file (RFC 4180) of ``columns`` finite numbers each.

    UTF-8, with or without a byte order mark. Numbers are ASCII with a decimal point. Rows without
    a character but white space are left out. The first row left is a header if every cell of it is
    a word: no number, and its first letter or digit, if it has one, is a letter (so that ``#
    time_s`` is a word, and ``0.5ms``, ``-`` and an empty cell are none).

    Raises:
        FileError: the file cannot be read, holds no numbers, or a row is something else. The first
            problem in full, with file, line and column; how many there are beside it. What stands
            there is not told: the author of a scenario may have named any file.
    """
    numbers, problems = Numbers(path, [], []), list[str]()
    first = True
    for line, row in _rows(path):
        if len(numbers.rows) + len(problems) == MOST_ROWS:
            raise FileError(f"{_place(path, line)}: a file must have at most {MOST_ROWS} rows")
        header, first = first and all(map(_is_word, row)), False
        if header:
            continue
        values, problem = _checked(path, line, row, columns)
        if problem is None:
            numbers.rows.append(values)
            numbers.lines.append(line)
        else:
            problems.append(problem)
    if problems:
        raise FileError(first_of(problems))
    if not numbers.rows:
        raise FileError(f"file {path} holds no numbers")
    return numbers


def first_of(problems: Sequence[str]) -> str:
    """The first of some problems with one file, and how many there are beside it."""
    further = len(problems) - 1
    if not further:
        return problems[0]
    return f"{problems[0]} (and {further} more problem{'s' * (further > 1)} in this file)"


def _place(path: Path, line: int, column: int | None = None) -> str:
    return f"file {path}, line {line}" + ("" if column is None else f", column {column + 1}")


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Every row that is not blank, with the line on which it begins."""
    text = _text(path)
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    while True:
        line = reader.line_num + 1
        try:
            row = next(reader, None)
        except csv.Error as error:
            hint = "; is a quote not closed?" if "end of data" in str(error) else ""
            raise FileError(f"{_place(path, line)}: is not CSV: {error}{hint}") from None
        if row is None:
            return
        if row and not (len(row) == 1 and row[0].isspace()):
            yield line, row


def _text(path: Path) -> str:
    try:
        content = regular.read(path, MOST_BYTES, follow=True)
    except OSError as error:
        name = repr(str(path)) if "\0" in str(path) else path
        raise FileError(f"file {name} cannot be read: {error.strerror}") from None
    try:
        text = content.decode("utf-8").removeprefix("\ufeff")
        at, what = text.encode().find(b"\0"), "a null character"
    except UnicodeDecodeError as error:
        text, at, what = "", error.start, f"a byte that is not UTF-8 (0x{content[error.start]:02x})"
    if at >= 0:
        line = content.count(b"\n", 0, at) + 1
        raise FileError(f"{_place(path, line)}: has {what}: must be UTF-8 text (is it UTF-16?)")
    return text


def _checked(
    path: Path, line: int, row: Sequence[str], columns: int
) -> tuple[list[float], str | None]:
    """The numbers of a row, or what is wrong with it."""
    values = []
    for column, cell in enumerate(row):
        value = _number(cell)
        if value is None:
            return [], f"{_place(path, line, column)}: must be a number{_hint(cell)}"
        if not math.isfinite(value):
            return [], f"{_place(path, line, column)}: must be finite"
        values.append(value)
    if len(values) != columns:
        return [], f"{_place(path, line)}: must have {_columns(columns)}, has {len(values)}"
    return values, None


def _columns(count: int) -> str:
    return f"{count} column{'s' * (count > 1)}"


def _hint(cell: str) -> str:
    """What may have gone wrong where a cell is no number."""
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if mark in cell:
            return f"; columns are parted by commas, not by {name}"
    return ""


def _number(cell: str) -> float | None:
    """The number that a cell holds, as Python's ``float`` has it, but ASCII without underscores."""
    if not cell.isascii() or "_" in cell:
        return None
    try:
        return float(cell)
    except ValueError:
        return None


def _is_word(cell: str) -> bool:
    """Whether a cell may stand in a header."""
    first = next((character for character in cell if character.isalnum()), "")
    return first.isalpha() and _number(cell) is None
