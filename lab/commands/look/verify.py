"""Repeat recorded runs; compare every bit."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from formnet.lab.commands.options import LAW, RUNS, Command

if TYPE_CHECKING:
    from formnet.lab.launch.engine import EngineName


@click.command("verify", cls=Command)
@RUNS
@click.option(
    "--distributed",
    "engine",
    flag_value="distributed",
    default="inline",
    help="Repeat as a distributed run  [default: in one process]",
)
@LAW
def command(folders: tuple[Path, ...], engine: "EngineName", law: str | None) -> None:
    """Repeat recorded runs; compare every bit.

    Each is repeated from its own scenario.toml. A law that was code in a file is in no run folder:
    --law says where it is. Exit code 0: identical; 1: different (the first
    difference is printed); 2: cannot be repeated; 3: repeating it failed; 130: interrupted.
    """
    from formnet.lab.work.verify import verify_runs

    sys.exit(verify_runs(folders, engine, law))
