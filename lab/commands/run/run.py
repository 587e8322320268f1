"""Run SCENARIO and judge it."""

import sys
from pathlib import Path

import click

from formnet.lab.commands.options import (
    ALLOW_CODE,
    ALLOW_OUTSIDE,
    HOSTS,
    KEYS,
    LAW,
    NO_LOOKAHEAD,
    OVERRIDE,
    PLAINTEXT,
    SCENARIO,
    VIEW,
    WEB,
    Command,
    hosts_file,
    out_option,
    viewer,
)


@click.command("run", cls=Command)
@SCENARIO
@out_option("Run folder  [default: runs/<name>-<time>]")
@OVERRIDE
@click.option(
    "--inline", is_flag=True, help="Run in one process, without Zenoh; same trajectories."
)
@HOSTS
@click.option(
    "--connect",
    "router",
    metavar="ENDPOINT",
    help="Connect through this Zenoh router, e.g. tcp/127.0.0.1:7447  [default: the plant]",
)
@KEYS
@PLAINTEXT
@VIEW
@WEB
@click.option(
    "--no-figures",
    is_flag=True,
    help="Draw no figures; formnet report or plot can draw them later.",
)
@click.option("--no-scene", is_flag=True, help="Do not write run.rrd, which formnet replay shows.")
@NO_LOOKAHEAD
@LAW
@ALLOW_CODE
@ALLOW_OUTSIDE
def command(
    scenario: Path,
    out: Path | None,
    overrides: tuple[str, ...],
    inline: bool,
    hosts: str | None,
    router: str | None,
    keys: Path | None,
    plaintext: bool,
    view: bool,
    web: bool,
    no_figures: bool,
    no_scene: bool,
    no_lookahead: bool,
    law: str | None,
    allow_code: bool,
    allow_outside: bool,
) -> None:
    """Run SCENARIO and judge it.

    SCENARIO is a file, a name from `formnet scenarios`, or a run folder.

    Exit code 0: every claim in [expect] holds; 1: a claim does not hold or cannot be judged, or
    there is none and the run diverged or lost a robot; 2: bad scenario or usage; 3: the run broke,
    or not all results could be written; 130: interrupted.
    """
    if inline and (hosts or router or keys or plaintext):
        raise click.UsageError(
            "--inline uses one process: it excludes --hosts, --connect, --keys and --plaintext"
        )
    if inline and (view or web):
        raise click.UsageError("--inline cannot be watched live; use formnet replay RUN afterwards")
    from formnet.lab.code.laws import Given
    from formnet.lab.machines.place import Where
    from formnet.lab.work.run import run_scenario

    file, own = hosts_file(hosts)
    where = Where(file, keys, plaintext, router, own)
    shown = viewer(view=view, web=web)
    sys.exit(
        run_scenario(
            scenario,
            overrides,
            out,
            inline=inline,
            where=where,
            view=shown,
            drawn=not no_figures,
            scene=not no_scene,
            lookahead=not no_lookahead,
            given=Given(law, allow_code, allow_outside),
        )
    )
