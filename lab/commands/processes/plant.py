"""Run the plant process of a run of SCENARIO.

Zenoh is imported once it is known how many threads it may have.
"""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from formnet.formation.wire import threads
from formnet.lab.commands.complete import toml_files
from formnet.lab.commands.options import (
    KEYS,
    LEASE,
    LEASH,
    LONGEST_LEASE_S,
    OVERRIDE,
    PLAINTEXT,
    RUN_ID,
    Command,
    Number,
    fail,
    scenario_file,
)
from formnet.lab.runs.exits import in_words

if TYPE_CHECKING:
    from formnet.formation.briefing.plan import Plan


def _scenario_or_input(
    context: click.Context, parameter: click.Parameter, argument: str
) -> Path | None:
    return None if argument == "-" else scenario_file(context, parameter, argument)


@click.command("plant", cls=Command)
@click.argument(
    "scenario", callback=_scenario_or_input, metavar="SCENARIO|-", shell_complete=toml_files
)
@click.option("--listen", metavar="ENDPOINT", help="Endpoint for robots, e.g. tcp/127.0.0.1:7447.")
@click.option("--connect", metavar="ENDPOINT", help="Use this Zenoh router instead of listening.")
@click.option(
    "--record", metavar="FILE", help="Write the record stream to FILE; - for standard output."
)
@click.option(
    "--start-patience",
    "start_patience_s",
    type=Number(1.0, 1e9),
    metavar="SECONDS",
    help="End the run after this long without progress before the first tick  [default: wait]",
)
@RUN_ID
@LEASH
@OVERRIDE
@KEYS
@PLAINTEXT
@LEASE
def command(
    scenario: Path | None,
    listen: str | None,
    connect: str | None,
    record: str | None,
    start_patience_s: float | None,
    run_name: str,
    leash: bool,
    overrides: tuple[str, ...],
    keys: Path | None,
    plaintext: bool,
    lease_s: float,
) -> None:
    """Run the plant process of a run of SCENARIO.

    With -, the resolved plan is read from standard input, up to its end or a NUL byte.
    """
    if (listen is None) == (connect is None):
        raise click.UsageError("needs exactly one of --listen and --connect")
    if scenario is None and overrides:
        raise click.UsageError("--set requires SCENARIO: a plan from standard input is final")
    if lease_s < LONGEST_LEASE_S or keys is not None:  # a client that hangs may keep some busy
        threads.many()
    from formnet.formation.briefing.plan import BadBrief, Plan
    from formnet.formation.machines.custody import KeysError
    from formnet.formation.wire.bus import BusError
    from formnet.formation.wire.process import read_plan
    from formnet.plant.process import main as plant_main

    try:
        plan = Plan.unpack(read_plan()) if scenario is None else _resolved(scenario, overrides)
    except BadBrief as error:
        fail(2, f"standard input: {error}")
    try:
        sys.exit(
            plant_main(
                plan,
                run=run_name,
                listen=listen,
                connect=connect,
                record=record,
                stop_at_end_of_input=leash,
                start_patience_s=start_patience_s,
                keys=keys,
                plaintext=plaintext,
                lease_s=lease_s,
            )
        )
    except (BusError, KeysError) as error:
        fail(3, str(error))
    except OSError as error:
        fail(3, in_words(error))


def _resolved(scenario: Path, overrides: tuple[str, ...]) -> "Plan":
    from formnet.formation.briefing.resolving import resolve
    from formnet.formation.scenario.loading import ScenarioError, load

    try:
        return resolve(load(scenario, overrides))
    except ScenarioError as error:
        fail(2, str(error))
