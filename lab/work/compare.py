"""``formnet compare``: runs side by side."""

from collections.abc import Sequence
from pathlib import Path

from formnet.formation.scenario.loading import ScenarioError
from formnet.lab.figures.canvas import plain_style
from formnet.lab.pages.comparison import MOST_RUNS, comparison, figure, parts, write
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT, ONE_FAILS, in_words
from formnet.lab.runs.exits import of as code_of
from formnet.lab.runs.folders import filled
from formnet.lab.text.console import Console, escape
from formnet.lab.text.problems import report_problems
from formnet.lab.text.side_by_side import renderables
from formnet.lab.text.tables import output
from formnet.lab.verdict.files import Unreadable
from formnet.lab.verdict.recorded import read_whole


def compare_runs(folders: Sequence[Path], out: Path | None) -> int:
    """Print what tells the runs apart, write it down; the exit code of ``formnet compare``."""
    console = Console(stderr=True, highlight=False)
    if len(folders) > MOST_RUNS:
        console.print(f"[red]{len(folders)} runs:[/] at most {MOST_RUNS} can be compared")
        return BAD_INPUT
    found = []
    for folder in folders:
        try:
            found.append(read_whole(folder))
        except ScenarioError as error:
            report_problems(console, error)
            return BAD_INPUT
        except Unreadable as error:
            console.print(f"[red]{escape(str(folder))}:[/] {escape(str(error))}", soft_wrap=True)
            return BAD_INPUT
    compared = comparison(found)
    try:
        if out is not None:
            with filled(out, "comparison.md"), plain_style():
                write(out, compared, figure(found, compared.names))
    except OSError as error:
        console.print(f"[red]--out:[/] {escape(in_words(error))}", soft_wrap=True)
        return code_of(error)
    page = output()
    for title, rows in parts(compared):
        for item in renderables(title, compared.names, rows, page.width, _coloured):
            page.print(item)
    if out is not None:
        console.print(f"results are in {escape(str(out))}", soft_wrap=True)
    return ONE_FAILS if compared.differs else ALL_HOLD


def _coloured(cell: str) -> str:
    style = {"holds": "green", "FAILS": "red", "differs": "red", "identical": "green"}.get(
        cell.split(",")[0].split(" (")[0]
    )
    return escape(cell) if style is None else f"[{style}]{escape(cell)}[/]"
