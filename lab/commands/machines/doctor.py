"""Check this machine and hosts; say how to fix problems."""

import sys
from pathlib import Path

import click

from formnet.lab.commands.options import KEYS, Command


@click.command("doctor", cls=Command)
@click.option(
    "--hosts", type=click.Path(path_type=Path), metavar="HOSTS.toml", help="Also check these hosts."
)
@KEYS
def command(hosts: Path | None, keys: Path | None) -> None:
    """Check this machine and hosts; say how to fix problems.

    Exit code 0: no problem found; 2: bad usage; 3: problems found.
    """
    from formnet.lab.work.doctor import examine

    sys.exit(examine(hosts, keys))
