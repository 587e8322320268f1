"""Print the JSON Schema of scenarios or verdicts."""

from pathlib import Path

import click

from formnet.lab.commands.options import Command, fail, out_option
from formnet.lab.runs.exits import of as code_of


@click.command("schema", cls=Command)
@click.option(
    "--of",
    "kind",
    type=click.Choice(["scenario", "verdict"]),
    default="scenario",
    show_default=True,
    help="Of scenario files, or of the verdict.json that a run leaves.",
)
@out_option("[default: standard output]", metavar="FILE")
def command(kind: str, out: Path | None) -> None:
    """Print the JSON Schema of scenarios or verdicts.

    Editors check and complete scenarios with it; programs that read verdicts validate them.
    """
    from formnet.lab.runs import files

    text = _text(kind)
    if out is None:
        click.echo(text, nl=False)
        return
    try:
        files.write_to(out, text)
    except OSError as error:
        fail(code_of(error), f"--out {out}: {error.strerror}")


def _text(kind: str) -> str:
    if kind == "verdict":
        from formnet.lab.schemas import verdict

        return verdict.text()
    from formnet.lab.schemas import scenario

    return scenario.text()
