"""``formnet scenarios``: the packaged scenarios."""

import click

from formnet.lab.commands.options import Command
from formnet.lab.scenarios.packaged import described


@click.command("scenarios", cls=Command)
def command() -> None:
    """List the packaged scenarios."""
    for name, description in described():
        click.echo(f"{name:24} {description}")
