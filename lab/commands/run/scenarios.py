"""``formnet scenarios``: the scenarios that come along."""

import click

from formnet.lab.commands.options import Command
from formnet.lab.scenarios.packaged import described


@click.command("scenarios", cls=Command)
def command() -> None:
    """List the scenarios that come along."""
    for name, description in described():
        click.echo(f"{name:24} {description}")
