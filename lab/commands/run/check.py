"""Validate SCENARIO; print what the theory predicts."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from formnet.lab.commands.options import (
    ALLOW_CODE,
    ALLOW_OUTSIDE,
    HOSTS,
    LAW,
    NO_LOOKAHEAD,
    OVERRIDE,
    SCENARIO,
    Command,
    hosts_file,
)
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT

if TYPE_CHECKING:
    from formnet.lab.code.laws import Given


@click.command("check", cls=Command)
@SCENARIO
@OVERRIDE
@HOSTS
@NO_LOOKAHEAD
@LAW
@ALLOW_CODE
@ALLOW_OUTSIDE
def command(
    scenario: Path,
    overrides: tuple[str, ...],
    hosts: str | None,
    no_lookahead: bool,
    law: str | None,
    allow_code: bool,
    allow_outside: bool,
) -> None:
    """Validate SCENARIO; print what the theory predicts.

    A law that is code in a file is named, and executed only if that is allowed. Of hosts, it
    prints where a run would log in and what it would start; it does neither.
    """
    from formnet.lab.code.laws import Given

    given = Given(law, allow_code, allow_outside)
    sys.exit(check_scenario(scenario, overrides, given, hosts, lookahead=not no_lookahead))


def check_scenario(
    path: Path, overrides: tuple[str, ...], given: "Given", hosts: str | None, *, lookahead: bool
) -> int:
    """Print the assessment of a scenario; returns the exit code of ``formnet check``."""
    from functools import partial

    from formnet.formation.scenario.loading import ScenarioError
    from formnet.lab.forecast.checked import load_checked
    from formnet.lab.machines.place import BadPlace, Where
    from formnet.lab.text.assessment import describe, describe_plan
    from formnet.lab.text.console import Console, escape
    from formnet.lab.text.hosts import describe_use
    from formnet.lab.text.problems import report_problems, say_slow, warn

    troubles = Console(stderr=True)
    try:
        say = partial(say_slow, troubles)
        found = load_checked(path, overrides, say, given=given, lookahead=lookahead)
    except ScenarioError as error:
        report_problems(troubles, error)
        return BAD_INPUT
    scenario = found.scenario
    file, own = hosts_file(hosts)
    try:
        used = Where(file, own=own).named(scenario)
    except BadPlace as error:
        troubles.print(f"[red]{escape(str(error))}[/]", soft_wrap=True)
        return BAD_INPUT
    console = Console(highlight=False)
    console.print(f"{escape(str(path))}: valid", soft_wrap=True)
    plan = [*describe_plan(scenario), *describe_use(scenario.hosts, used)]
    for line in [*describe(scenario), *plan]:
        console.print(escape(line), soft_wrap=True)
    if found.refused is not None:
        console.print(f"[yellow]not executed:[/] {escape(found.refused)}", soft_wrap=True)
    warn(console, found.warnings)
    return ALL_HOLD
