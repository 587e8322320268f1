"""``formnet list``: what lies in a folder of runs."""

import json
from pathlib import Path

from rich.table import Table

from formnet.lab.pages.listing import RUNNING, Entry, in_words, look_into
from formnet.lab.pages.report import write_index
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT
from formnet.lab.text.console import Console, escape
from formnet.lab.text.tables import Column, output, table
from formnet.lab.verdict.model import HOLDS, OBSERVED

_STYLES = {HOLDS: "green", RUNNING: "cyan", OBSERVED: "dim", "interrupted": "yellow"}

MOST_OTHERS = 10
"""How many folders that are none of formnet's are named."""


def list_runs(folder: Path, *, as_json: bool) -> int:
    """Print what lies in ``folder`` and make its index page; the exit code of the command."""
    console = Console(stderr=True, highlight=False)
    if not folder.is_dir():
        console.print(
            f"[red]{escape(str(folder))}:[/] is not a folder; formnet run makes runs/ where "
            "it is called",
            soft_wrap=True,
        )
        return BAD_INPUT
    if (folder / "events.jsonl").exists():
        console.print(
            f"[red]{escape(str(folder))}:[/] is one run; give the folder that it is in",
            soft_wrap=True,
        )
        return BAD_INPUT
    entries, others = look_into(folder)
    if as_json:
        print(json.dumps([entry.as_json() for entry in entries], indent=2))
    elif entries:
        output().print(_table(entries))
    if others:
        more = f" and {len(others) - MOST_OTHERS} more" if len(others) > MOST_OTHERS else ""
        named = escape(", ".join(others[:MOST_OTHERS]))
        console.print(f"other folders: {named}{more}", soft_wrap=True)
    if not entries:
        console.print(f"no runs in {escape(str(folder))}", soft_wrap=True)
        return ALL_HOLD
    if folder.resolve().name != "runs":
        return ALL_HOLD  # its page would be a surprise
    problem = write_index(folder, entries)
    console.print(
        f"as a page: {escape(str(folder / 'index.html'))}"
        if problem is None
        else f"[yellow]no index page:[/] {escape(problem)}",
        soft_wrap=True,
    )
    return ALL_HOLD


def _table(entries: list[Entry]) -> Table:
    columns = [
        Column("folder", left=True, wraps=output().is_terminal),
        Column("standing", left=True),
        Column("claims", 1, left=True, wraps=True),
        Column("settled", 3),
        Column("simulated", 4),
        Column("begun", 2, left=True),
    ]
    rows = []
    for entry in entries:
        style = _STYLES.get(entry.standing, "red")
        said = "; ".join(filter(None, (in_words(entry.claims), entry.note)))
        rows.append(
            [
                escape(entry.title),
                f"[{style}]{escape(entry.standing)}[/]",
                escape(said),
                entry.settled,
                _seconds(entry.simulated_s),
                entry.when[:16].replace("T", " "),
            ]
        )
    return table("", columns, rows, "all are in --json", output().width)


def _seconds(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f} s"
