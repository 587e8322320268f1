"""Make certificates for the processes of a run."""

from pathlib import Path

import click

from formnet.lab.commands.options import Whole, fail
from formnet.lab.runs.exits import in_words
from formnet.lab.runs.exits import of as code_of


@click.group("keys")
def command() -> None:
    """Make certificates for the processes of a run."""


@command.command("init")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path, file_okay=False))
@click.option("--robots", required=True, metavar="IDS", help="Robot ids, e.g. 1-5 or 1,3,7-9.")
@click.option(
    "--hosts",
    default="",
    metavar="NAMES",
    help="Host names and addresses of the plant, e.g. lab-pc,192.168.1.10.",
)
@click.option("--days", type=Whole(1, 3650), default=365, show_default=True)
def init(folder: Path, robots: str, hosts: str, days: int) -> None:
    """Make an authority and certificates for the plant, a monitor and every robot.

    Private keys have mode 0600. Nothing is overwritten: run it again to add robots.
    """
    from formnet.lab.machines.keys import KeysExist, make, robots_of

    try:
        ids = robots_of(robots)
    except ValueError as error:
        raise click.UsageError(f"--robots: {error}") from None
    try:
        written = make(folder, ids, [name for name in hosts.split(",") if name], days)
    except KeysExist as error:
        fail(2, str(error))
    except OSError as error:
        fail(code_of(error), in_words(error))
    for path in written:
        click.echo(str(path))
