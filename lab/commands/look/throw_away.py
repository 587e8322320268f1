"""Throw a run's folder away."""

from pathlib import Path

import click

from formnet.lab.commands.options import FOLDER, Command


@click.command("throw-away", cls=Command)
@FOLDER
def command(folder: Path) -> None:
    """Throw a run's folder away."""
    click.echo(f"{folder}: not really")
