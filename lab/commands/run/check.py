"""Validate SCENARIO; print what the theory predicts."""

import sys
from pathlib import Path

import click

from formnet.lab.commands.options import NO_LOOKAHEAD, OVERRIDE, SCENARIO, Command
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT


@click.command("check", cls=Command)
@SCENARIO
@OVERRIDE
@NO_LOOKAHEAD
def command(scenario: Path, overrides: tuple[str, ...], no_lookahead: bool) -> None:
    """Validate SCENARIO; print what the theory predicts."""
    sys.exit(check_scenario(scenario, overrides, lookahead=not no_lookahead))


def check_scenario(path: Path, overrides: tuple[str, ...], *, lookahead: bool) -> int:
    """Print the assessment of a scenario; returns the exit code of ``formnet check``."""
    from functools import partial

    from formnet.formation.scenario.loading import ScenarioError
    from formnet.lab.forecast.checked import load_checked
    from formnet.lab.text.assessment import describe, describe_plan
    from formnet.lab.text.console import Console, escape
    from formnet.lab.text.problems import report_problems, say_slow, warn

    troubles = Console(stderr=True)
    try:
        say = partial(say_slow, troubles)
        scenario, warnings = load_checked(path, overrides, say, lookahead=lookahead)
    except ScenarioError as error:
        report_problems(troubles, error)
        return BAD_INPUT
    console = Console(highlight=False)
    console.print(f"{escape(str(path))}: valid", soft_wrap=True)
    for line in [*describe(scenario), *describe_plan(scenario)]:
        console.print(escape(line), soft_wrap=True)
    warn(console, warnings)
    return ALL_HOLD
