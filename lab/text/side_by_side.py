"""Runs side by side as tables that fit: in a terminal of any width, without breaking words."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

MOST_COLUMNS = 3
"""How many runs have a column each; more have a row each."""

Rows = Sequence[tuple[str, list[str]]]
"""(title, a cell per run)."""


class Turned(NamedTuple):
    """Rows turned around: a row per run, the columns in which runs differ, what is the same."""

    grid: list[list[str]]
    alike: list[tuple[str, str]]


def turned(names: Sequence[str], rows: Rows) -> Turned:
    """A row per run; the first column is ``names``."""
    alike = [(title, cells[0]) for title, cells in rows if len(set(cells)) == 1]
    different = [(title, cells) for title, cells in rows if len(set(cells)) > 1]
    columns = [["run", *names], *([title, *cells] for title, cells in different)]
    return Turned([list(row) for row in zip(*columns, strict=True)], alike)


def renderables(
    title: str, names: Sequence[str], rows: Rows, width: int, markup: Callable[[str], str]
) -> Iterator[RenderableType]:
    """What to print into ``width`` characters; ``markup`` gives a cell its colour.

    A column per run, if those are few and fit. Otherwise a row per run, in as many tables as it
    takes to have all columns in which runs differ; where not even one fits beside the names, a
    paragraph per run.
    """
    upright = [["", *names], *([place, *cells] for place, cells in rows)]
    if len(names) <= MOST_COLUMNS and (widths := fitting(upright, width)) is not None:
        yield _table(title, upright, widths, markup)
        return
    grid, alike = turned(names, rows)
    if len(grid[0]) > 1:
        parts = list(_that_fit(grid, width))
        for number, part in enumerate(parts):
            fits = fitting(part, width)
            head = title if number == 0 else ""
            if fits is not None:
                yield _table(head, part, fits, markup)
            else:
                yield from _paragraphs(head, part, markup)
    if alike:
        heads, cells = zip(*alike, strict=True)
        yield from _paragraphs("", [["", *heads], [f"{title}: the same in all", *cells]], markup)


def fitting(grid: Sequence[Sequence[str]], width: int) -> list[int] | None:
    """How wide each column is so that the table fits and no word breaks; None if it cannot.

    What there is beyond the longest words goes to the columns that want it, one by one.
    """
    columns = list(zip(*grid, strict=True))
    found = [max(map(_longest_word, column)) for column in columns]
    wanted = [max(map(cell_len, column)) for column in columns]
    spare = width - sum(found) - _between(len(columns))
    if spare < 0:
        return None
    while spare and found != wanted:
        for k, most in enumerate(wanted):
            if spare and found[k] < most:
                found[k], spare = found[k] + 1, spare - 1
    return found


def _that_fit(grid: list[list[str]], width: int) -> Iterator[list[list[str]]]:
    """The grid in parts, each with the first column and as many others as fit, at least one."""
    columns = list(zip(*grid, strict=True))
    some = [columns[0]]
    for column in columns[1:]:
        more = [list(row) for row in zip(*some, column, strict=True)]
        if len(some) > 1 and fitting(more, width) is None:
            yield [list(row) for row in zip(*some, strict=True)]
            some = [columns[0]]
        some.append(column)
    yield [list(row) for row in zip(*some, strict=True)]


def _longest_word(text: str) -> int:
    return max(map(cell_len, text.split()), default=0)


def _between(columns: int) -> int:
    """How many characters a table has beside its cells."""
    return 2 * columns + 1


def _table(
    title: str, grid: Sequence[Sequence[str]], widths: Sequence[int], markup: Callable[[str], str]
) -> Table:
    table = Table(title=title or None, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for head, width in zip(grid[0], widths, strict=True):
        table.add_column(Text(head), width=width)
    for first, *cells in grid[1:]:
        table.add_row(Text(first), *map(markup, cells))
    return table


def _paragraphs(
    title: str, grid: Sequence[Sequence[str]], markup: Callable[[str], str]
) -> Iterator[Text]:
    """A row of the grid after the other, each value behind the head of its column."""
    if title:
        yield Text(title, style="italic")
    _, *heads = grid[0]
    for name, *cells in grid[1:]:
        yield Text(name, style="bold")
        for head, cell in zip(heads, cells, strict=True):
            yield Text.assemble(f"  {head}: ", Text.from_markup(markup(cell), emoji=False))
    yield Text()
