"""Allow the code in a folder to be executed."""

import sys
from pathlib import Path

import click

from formnet.lab.commands.options import Command, fail
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT, in_words


@click.command("allow", cls=Command)
@click.argument(
    "folder", required=False, type=click.Path(path_type=Path, exists=True, file_okay=False)
)
@click.option("--forget", is_flag=True, help="Allow nothing there any more.")
@click.option("--list", "listing", is_flag=True, help="List what is allowed.")
def command(folder: Path | None, *, forget: bool, listing: bool) -> None:
    """Allow the code in a folder to be executed.

    The files of Python in FOLDER and below, as they are now.

    A scenario names code as law.kind = "laws.py:MyLaw". Once allowed, it is executed by run,
    check and nemesis; changed by one byte, it is not any more. Read it first: it runs with your
    rights.
    """
    if listing == (folder is not None):
        raise click.UsageError("needs a FOLDER, or --list")
    from formnet.lab.code import allowed

    try:
        if listing:
            for path, digest in allowed.listed().items():
                click.echo(f"{digest}  {path}")
        elif folder is not None and forget:
            click.echo(f"forgotten: {_files(allowed.forget(folder))} in {folder}")
        elif folder is not None:
            found = allowed.allow(folder)
            for file, digest in found.items():
                click.echo(f"{digest}  {file}")
            click.echo(f"allowed: {_files(len(found))} in {folder}")
    except allowed.BadList as error:
        fail(BAD_INPUT, str(error))
    except OSError as error:
        fail(BAD_INPUT, in_words(error))
    sys.exit(ALL_HOLD)


def _files(count: int) -> str:
    return f"{count} file{'s' * (count != 1)}"
