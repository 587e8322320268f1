"""List the runs in DIR (runs/), newest first."""

import sys
from pathlib import Path

import click

from formnet.lab.commands.options import Command


@click.command("list", cls=Command)
@click.argument("folder", metavar="[DIR]", default=Path("runs"), type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def command(folder: Path, as_json: bool) -> None:
    """List the runs in DIR (runs/), newest first."""
    from formnet.lab.work.list import list_runs

    sys.exit(list_runs(folder, as_json=as_json))
