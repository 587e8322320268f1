"""Make, renew and revoke certificates for the processes of a run."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from formnet.lab.commands.options import Whole, fail
from formnet.lab.runs.exits import BAD_INPUT, in_words
from formnet.lab.runs.exits import of as code_of

DAYS = 30
FOLDER = click.argument("folder", metavar="DIR", type=click.Path(path_type=Path, file_okay=False))
LIFE = click.option(
    "--days",
    type=Whole(1, 3650),
    default=DAYS,
    show_default=True,
    help="Life of the certificates; no longer than the authority's, which is ten years.",
)


@click.group("keys")
def command() -> None:
    """Make, renew and revoke certificates for the processes of a run."""


def _hosts(_: click.Context, __: click.Parameter, text: str) -> list[str]:
    """Host names and addresses, as a callback of click. Raises click.BadParameter."""
    from formnet.lab.machines.keys import hosts_of

    try:
        return hosts_of(text)
    except ValueError as error:
        raise click.BadParameter(str(error)) from None


@command.command("init")
@FOLDER
@click.option("--robots", required=True, metavar="IDS", help="Robot ids, e.g. 1-5 or 1,3,7-9.")
@click.option(
    "--hosts",
    default="",
    callback=_hosts,
    metavar="NAMES",
    help="Host names and addresses of the plant, e.g. lab-pc,192.168.1.10.",
)
@LIFE
def init(folder: Path, robots: str, hosts: list[str], days: int) -> None:
    """Make an authority and certificates for the plant, a monitor and every robot.

    Private keys have mode 0600. Nothing is overwritten: run it again to add robots.
    """
    from formnet.lab.machines.keys import make, robots_of

    try:
        ids = robots_of(robots)
    except ValueError as error:
        raise click.UsageError(f"--robots: {error}") from None
    with _failing():
        for path in make(folder, ids, hosts, days):
            click.echo(str(path))


@command.command("renew")
@FOLDER
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option(
    "--hosts",
    default="",
    callback=_hosts,
    metavar="NAMES",
    help="Host names and addresses of the plant  [default: as before]",
)
@LIFE
def renew(folder: Path, names: tuple[str, ...], hosts: list[str], days: int) -> None:
    """Replace the certificates and keys of NAME (robot-3, monitor, plant; all without any).

    Those before count no more, from the next start of a plant on. DIR must have ca-key.pem.
    """
    from formnet.lab.machines.keys import renew as renewed

    with _failing():
        for common, paths in renewed(folder, names, hosts, days).items():
            click.echo(f"{common}: {', '.join(map(str, paths))}")
    click.echo("copy each robot's files to its host, and generations.json to the plant's machine")


@command.command("revoke")
@FOLDER
@click.argument("names", nargs=-1, required=True, metavar="NAME...")
def revoke(folder: Path, names: tuple[str, ...]) -> None:
    """Make the certificates of NAME (robot-3, monitor) count no more, e.g. because one is lost.

    A plant that starts from then on allows them nothing. `formnet keys renew` makes new ones.
    """
    from formnet.lab.machines.keys import revoke as revoked

    with _failing():
        for common in revoked(folder, names):
            click.echo(f"{common}: revoked")
    click.echo(f"copy {folder / 'generations.json'} to the plant's machine, if that is another")


@contextmanager
def _failing() -> Iterator[None]:
    """End the command where a folder of keys cannot be used."""
    from formnet.lab.machines.keys import KeysExist, Unusable

    try:
        yield
    except (KeysExist, Unusable) as error:
        fail(BAD_INPUT, str(error))
    except OSError as error:
        fail(code_of(error), in_words(error))
