"""Redraw a run's figures from its folder."""

import sys
from pathlib import Path

import click

from formnet.lab.commands.options import FOLDER, Command, out_option
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT, in_words
from formnet.lab.runs.exits import of as code_of


@click.command("plot", cls=Command)
@FOLDER
@out_option("New folder  [default: figures/ of the run]", metavar="DIR")
def command(folder: Path, out: Path | None) -> None:
    """Redraw a run's figures from its folder."""
    sys.exit(plot_run(folder, out))


def plot_run(folder: Path, out: Path | None) -> int:
    """Draw into a new folder, or into the run's ``figures/``; the exit code of ``formnet plot``."""
    from contextlib import nullcontext

    from formnet.formation.scenario.loading import ScenarioError
    from formnet.lab.figures import run_figures as figures
    from formnet.lab.runs import files
    from formnet.lab.runs.folders import filled
    from formnet.lab.text.console import Console, escape
    from formnet.lab.text.problems import report_problems
    from formnet.lab.verdict.files import Unreadable
    from formnet.lab.verdict.recorded import read_run

    console = Console(stderr=True, highlight=False)
    try:
        run = read_run(folder)
        if not run.samples and not run.link_rows:
            raise Unreadable("; ".join(["nothing to draw", *run.problems]))
        place = out or files.subfolder(folder, "figures", made=True)
        with nullcontext() if out is None else filled(out, "graph.png"):
            left_out = figures.draw(run, place)
    except ScenarioError as error:
        report_problems(console, error)
        return BAD_INPUT
    except Unreadable as error:
        console.print(f"[red]{escape(str(folder))}:[/] {escape(str(error))}", soft_wrap=True)
        return BAD_INPUT
    except OSError as error:
        console.print(f"[red]not drawn:[/] {escape(in_words(error))}", soft_wrap=True)
        return code_of(error)
    if left_out:
        beyond = f"{', '.join(left_out)} (states or places beyond {figures.LARGEST:g})"
        console.print(f"[yellow]without:[/] {beyond}", soft_wrap=True)
    for problem in run.problems:
        console.print(f"[yellow]without:[/] {escape(problem)}", soft_wrap=True)
    console.print(f"results are in {escape(str(place))}", soft_wrap=True)
    return ALL_HOLD
