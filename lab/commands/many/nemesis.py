"""Test SCENARIO with random failures."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from formnet.lab.commands.options import (
    ALLOW_CODE,
    ALLOW_OUTSIDE,
    INLINE_RUNS,
    JOBS,
    LAW,
    OVERRIDE,
    SCENARIO,
    Command,
    Number,
    Whole,
    need_inline,
    out_option,
)

if TYPE_CHECKING:
    from formnet.lab.launch.engine import EngineName


@click.command("nemesis", cls=Command)
@SCENARIO
@OVERRIDE
@click.option("--runs", type=Whole(1), default=20, show_default=True, help="Number of runs.")
@click.option(
    "--seed",
    type=Whole(0),
    default=1,
    show_default=True,
    help="Seed of the first run; increases by one per run.",
)
@INLINE_RUNS
@out_option("Results folder  [default: runs/nemesis-<time>]")
@click.option(
    "--limit",
    "limit_s",
    type=Number(1.0, 1e9),
    default=600.0,
    show_default=True,
    metavar="SECONDS",
    help="Time limit of a run (wall time); a longer one counts as hung.",
)
@JOBS
@LAW
@ALLOW_CODE
@ALLOW_OUTSIDE
def command(
    scenario: Path,
    overrides: tuple[str, ...],
    runs: int,
    seed: int,
    engine: "EngineName",
    out: Path | None,
    limit_s: float,
    jobs: int | None,
    law: str | None,
    allow_code: bool,
    allow_outside: bool,
) -> None:
    """Test SCENARIO with random failures.

    In the first quarter of each run, robots are killed, restarted and paused, and links are cut,
    partitioned, delayed and lossy. Every run must end, have a consistent record, give the same
    bits when repeated, and recover to what [expect] claims. Failing schedules are shrunk.

    Exit code 0: every run passed; 1: one failed, and its seed is printed; 2: bad usage;
    3: nemesis itself failed; 130: interrupted.
    """
    need_inline(jobs, engine)
    from formnet.lab.code.laws import Given
    from formnet.lab.work.nemesis import run_nemesis

    given = Given(law, allow_code, allow_outside)
    sys.exit(run_nemesis(scenario, overrides, runs, seed, out, limit_s, jobs, engine, given))
