"""Compare runs side by side."""

import sys
from pathlib import Path

import click

from formnet.lab.commands.options import RUNS, Command, out_option


@click.command("compare", cls=Command)
@RUNS
@out_option("Write comparison.md, .csv and a figure to a new folder.", metavar="DIR")
def command(folders: tuple[Path, ...], out: Path | None) -> None:
    """Compare runs side by side.

    Shows verdicts, errors, whether the runs are identical to the bit, and how the scenarios differ.

    Exit code 0; 1 if two runs of one scenario in virtual time differ in a bit; 2: bad usage.
    """
    if len(folders) < 2:
        raise click.UsageError("compare needs at least two runs")
    from formnet.lab.work.compare import compare_runs

    sys.exit(compare_runs(folders, out))
