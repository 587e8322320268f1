"""What became of the messages of links, as a table for people."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

MOST_LINKS = 20
"""How many links the table shows."""
_WIDE = 110
"""Characters that all columns need."""


def output() -> Console:
    """Standard output; where it is no terminal, wide enough for tables."""
    console = Console()
    return console if console.is_terminal else Console(width=max(console.width, _WIDE))


def links_table(links: Sequence[tuple[str, Mapping[str, Any]]], where_all_are: str) -> Table:
    """A row per link: its name, and the fields of :class:`netem.statistics.LinkStatistics`."""
    title = "messages by link; delay and jitter in ms, longest silence in s"
    if len(links) > MOST_LINKS:
        title += f" (the first {MOST_LINKS} of {len(links)}; {where_all_are})"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    wide = output().width >= _WIDE
    delays = ("min", "mean", "p50", "p95", "p99", "max") if wide else ("mean", "p99", "max")
    for head in ("link", "sent", "arrived", "lost", *delays, "jitter", "silence"):
        table.add_column(head, justify="right", no_wrap=head != "lost")
    for name, link in links[:MOST_LINKS]:
        delay = link["delay_s"] or {}
        table.add_row(
            escape(name),
            str(link["sent"]),
            str(link["delivered"]),
            _lost(link) if wide else _share_lost(link),
            *(_number(delay[key] * 1e3) if delay else "-" for key in delays),
            _number(link["jitter_s"] * 1e3),
            _number(link["longest_silence_s"]),
        )
    if in_flight := sum(link["in_flight"] for _, link in links):
        table.caption = f"messages still on their way at the end: {in_flight}"
        table.caption_justify = "left"
    return table


def _lost(link: Mapping[str, Any]) -> str:
    """The share lost, by cause."""
    causes = [f"{cause} {count / link['sent']:.2%}" for cause, count in link["lost"].items()]
    return ", ".join(causes) or "-"


def _share_lost(link: Mapping[str, Any]) -> str:
    return f"{sum(link['lost'].values()) / link['sent']:.2%}" if link["lost"] else "-"


def _number(value: float) -> str:
    return f"{round(value, 6):.3g}" if value < 1000 else f"{value:.0f}"
