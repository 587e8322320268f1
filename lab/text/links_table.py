"""What became of the messages of links, as a table for people."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table

from formnet.lab.text.console import escape
from formnet.lab.text.tables import WIDE, Column, output, table

MOST_LINKS = 20
"""How many links the table shows."""
_DELAYS = {"min": 7, "mean": 1, "p50": 6, "p95": 8, "p99": 4, "max": 2}
"""Columns of the delay, and their ranks."""


def links_table(links: Sequence[tuple[str, Mapping[str, Any]]], where_all_are: str) -> Table:
    """A row per link: its name, and the fields of :class:`netem.core.statistics.LinkStatistics`."""
    title = "messages by link; delay and jitter in ms, longest silence in s"
    if len(links) > MOST_LINKS:
        title += f" (the first {MOST_LINKS} of {len(links)}; {where_all_are})"
    width = output().width
    columns = [
        Column("link"),
        Column("sent", 3),
        Column("arrived", 9),
        Column("lost", wraps=True),
        *(Column(*item) for item in _DELAYS.items()),
        Column("jitter", 10),
        Column("silence", 5),
    ]
    rows = []
    for name, link in links[:MOST_LINKS]:
        delay = link["delay_s"] or {}
        rows.append(
            [
                escape(name),
                str(link["sent"]),
                str(link["delivered"]),
                _lost(link) if width >= WIDE else _share_lost(link),
                *(_number(delay[key] * 1e3) if delay else "-" for key in _DELAYS),
                _number(link["jitter_s"] * 1e3),
                _number(link["longest_silence_s"]),
            ]
        )
    made = table(title, columns, rows, where_all_are, width)
    if in_flight := sum(link["in_flight"] for _, link in links):
        said = f"messages in flight at the end: {in_flight}"
        made.caption = f"{made.caption}\n{said}" if made.caption else said
    return made


def _lost(link: Mapping[str, Any]) -> str:
    """The share lost, by cause."""
    causes = [f"{cause} {count / link['sent']:.2%}" for cause, count in link["lost"].items()]
    return ", ".join(causes) or "-"


def _share_lost(link: Mapping[str, Any]) -> str:
    return f"{sum(link['lost'].values()) / link['sent']:.2%}" if link["lost"] else "-"


def _number(value: float) -> str:
    return f"{round(value, 6):.3g}" if value < 1000 else f"{value:.0f}"
