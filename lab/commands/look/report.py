"""Recreate report.html from a run's folder."""

import sys
from collections.abc import Sequence
from pathlib import Path

import click

from formnet.lab.commands.options import RUNS, Command
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT, in_words
from formnet.lab.runs.exits import of as code_of


@click.command("report", cls=Command)
@RUNS
def command(folders: tuple[Path, ...]) -> None:
    """Recreate report.html from a run's folder."""
    sys.exit(report_runs(folders))


def report_runs(folders: Sequence[Path]) -> int:
    """Make the pages of runs again; the exit code of ``formnet report``."""

    from formnet.formation.scenario.loading import ScenarioError
    from formnet.lab.pages.report import write_report
    from formnet.lab.text.console import Console, escape
    from formnet.lab.text.problems import report_problems
    from formnet.lab.verdict.files import Unreadable

    console = Console(stderr=True, highlight=False)
    code = ALL_HOLD
    for folder in folders:
        try:
            file = write_report(folder, draw_missing=True)
            console.print(escape(str(file)), soft_wrap=True)
            continue
        except ScenarioError as error:
            report_problems(console, error)
        except Unreadable as error:
            console.print(f"[red]{escape(str(folder))}:[/] {escape(str(error))}", soft_wrap=True)
        except OSError as error:
            console.print(f"[red]not written:[/] {escape(in_words(error))}", soft_wrap=True)
            code = max(code, code_of(error))
        code = max(code, BAD_INPUT)
    return code
