"""Run and judge every claim of the paper."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from formnet.lab.commands.options import INLINE_RUNS, JOBS, Command, need_inline, out_option

if TYPE_CHECKING:
    from formnet.lab.launch.engine import EngineName


@click.command("claims", cls=Command)
@INLINE_RUNS
@click.option(
    "--only",
    multiple=True,
    metavar="PATTERN",
    help="Run only claims whose key matches, e.g. theorem-* (--list shows the keys). Repeatable.",
)
@click.option("--list", "listed", is_flag=True, help="List the claims and exit.")
@out_option("Results folder  [default: runs/claims-<time>]")
@click.option(
    "--into",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    metavar="FILE",
    help="Insert the table into FILE, between the comments that mark its place.",
)
@JOBS
def command(
    engine: "EngineName",
    only: tuple[str, ...],
    listed: bool,
    out: Path | None,
    into: Path | None,
    jobs: int | None,
) -> None:
    """Run and judge every claim of the paper.

    Exit code 0: every claim ends as predicted; 1: one does not; 2: bad usage; 3: a run broke;
    130: interrupted (complete results are written).
    """
    need_inline(jobs, engine)
    from formnet.lab.work.claims import list_claims, run_claims

    sys.exit(list_claims() if listed else run_claims(only, out, into, jobs, engine))
