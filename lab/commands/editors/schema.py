"""``formnet schema``: the JSON Schema of scenarios."""

from pathlib import Path

import click

from formnet.lab.commands.options import Command, fail
from formnet.lab.runs import files
from formnet.lab.runs.exits import of as code_of
from formnet.lab.scenarios.schema import text


@click.command("schema", cls=Command)
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="FILE", help="[default: standard output]"
)
def command(out: Path | None) -> None:
    """Print the JSON Schema of scenarios, for editors."""
    if out is None:
        click.echo(text(), nl=False)
        return
    try:
        files.replace(out, text())
    except OSError as error:
        fail(code_of(error), f"--out {out}: {error.strerror}")
