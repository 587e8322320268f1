"""List the packaged scenarios."""

import click

from formnet.lab.commands.options import Command


@click.command("scenarios", cls=Command)
def command() -> None:
    """List the packaged scenarios."""
    from formnet.lab.scenarios.packaged import described

    for name, description in described():
        click.echo(f"{name:24} {description}")
