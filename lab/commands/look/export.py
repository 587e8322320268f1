"""Write a run as MCAP or CSV."""

import sys
from pathlib import Path

import click

from formnet.lab.commands.options import FOLDER, Command, out_option


@click.command("export", cls=Command)
@FOLDER
@click.option("--format", "kind", type=click.Choice(["mcap", "csv"]), required=True)
@out_option(
    "New file (mcap) or folder (csv)  [default: run.mcap or csv/ in the run's folder]",
    metavar="FILE|DIR",
)
def command(folder: Path, kind: str, out: Path | None) -> None:
    """Write a run as MCAP or CSV.

    MCAP is for Foxglove (needs the extra "export"), CSV for spreadsheets.

    Existing files are never overwritten.
    """
    from formnet.lab.work.export import export_run

    sys.exit(export_run(folder, kind, out))
