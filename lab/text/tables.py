"""Tables for people, in terminals of any width."""

from collections.abc import Sequence
from typing import NamedTuple

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from formnet.lab.text.console import Console

WIDE = 110
"""Characters that the widest tables need; what is no terminal has as many."""
_BESIDE = 2
"""Characters between two columns."""


class Column(NamedTuple):
    """A column and how much it matters: where there is no room, the highest ``rank`` goes first."""

    head: str
    rank: int = 0
    left: bool = False
    wraps: bool = False


def output() -> Console:
    """Standard output; where it is no terminal, wide enough for tables."""
    console = Console()
    return console if console.is_terminal else Console(width=max(console.width, WIDE))


def table(
    title: str,
    columns: Sequence[Column],
    rows: Sequence[Sequence[str]],
    where_all_is: str,
    width: int,
) -> Table:
    """``rows`` of cells (markup) with as many of the ``columns`` as ``width`` characters take.

    No word is cut: a column that finds no room is left out, and the caption says so. Of rank 0
    none is left out.
    """
    needed = [
        max([len(column.head), *(_least(row[k], wraps=column.wraps) for row in rows)])
        for k, column in enumerate(columns)
    ]
    shown = list(range(len(columns)))
    while sum(needed[k] + _BESIDE for k in shown) > width:
        last = max(shown, key=lambda k: (columns[k].rank, k))
        if columns[last].rank == 0:
            break
        shown.remove(last)
    made = Table(
        title=title,
        title_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        caption_justify="left",
    )
    for k in shown:
        column = columns[k]
        made.add_column(
            column.head,
            justify="left" if column.left else "right",
            no_wrap=not column.wraps,
            overflow="fold",
        )
    for row in rows:
        made.add_row(*(row[k] for k in shown))
    if len(shown) < len(columns):
        missing = ", ".join(columns[k].head for k in range(len(columns)) if k not in shown)
        made.caption = f"columns left out: {missing} ({where_all_is})"
    return made


def _least(cell: str, *, wraps: bool) -> int:
    """How many characters a cell needs at least."""
    words = Text.from_markup(cell, emoji=False).plain
    return max(map(len, words.split() if wraps else [words]), default=0)
