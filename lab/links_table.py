"""What became of the messages of links, as a table for people."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table

MOST_LINKS = 20
"""How many links the table shows."""


def links_table(links: Sequence[tuple[str, Mapping[str, Any]]], where_all_are: str) -> Table:
    """A row per link: its name, and the fields of :class:`netem.statistics.LinkStatistics`."""
    title = "messages by link; delay and jitter in ms, longest silence in s"
    if len(links) > MOST_LINKS:
        title += f" (the first {MOST_LINKS} of {len(links)}; {where_all_are})"
    table = Table(title=title, title_justify="left")
    for head in ("link", "sent", "arrived", "lost", "p50", "p99", "max", "jitter", "silence"):
        table.add_column(head, justify="right", no_wrap=True)
    for name, link in links[:MOST_LINKS]:
        lost = sum(link["lost"].values())
        delay = link["delay_s"] or {}
        table.add_row(
            escape(name),
            str(link["sent"]),
            str(link["delivered"]),
            f"{lost / link['sent']:.1%}" if link["sent"] else "-",
            *(f"{delay[key] * 1e3:.4g}" if delay else "-" for key in ("p50", "p99", "max")),
            f"{round(link['jitter_s'] * 1e3, 6):.3g}",
            f"{link['longest_silence_s']:.3g}",
        )
    return table
