"""List the control laws available for law.kind."""

import click

from formnet.lab.commands.options import Command


@click.command("laws", cls=Command)
def command() -> None:
    """List the control laws available for law.kind."""
    from formnet.agent.law import installed
    from formnet.lab.forecast.foresight import unusable

    for name, entry in installed().items():
        source = f"  ({entry.dist.name} {entry.dist.version})" if entry.dist else ""
        click.echo(f"{name:20} {entry.value}{source}")
        problem = unusable(name)
        if problem is not None:
            click.echo(f"{'':20} {problem}")
