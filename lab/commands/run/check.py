"""Validate SCENARIO; print what the theory predicts."""

import sys
from pathlib import Path

import click

from formnet.lab.commands.options import (
    ALLOW_OUTSIDE,
    NO_LOOKAHEAD,
    OVERRIDE,
    SCENARIO,
    Command,
)
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT


@click.command("check", cls=Command)
@SCENARIO
@OVERRIDE
@NO_LOOKAHEAD
@ALLOW_OUTSIDE
def command(
    scenario: Path, overrides: tuple[str, ...], no_lookahead: bool, allow_outside: bool
) -> None:
    """Validate SCENARIO; print what the theory predicts."""
    sys.exit(
        check_scenario(scenario, overrides, lookahead=not no_lookahead, allow_outside=allow_outside)
    )


def check_scenario(
    path: Path, overrides: tuple[str, ...], *, lookahead: bool, allow_outside: bool = False
) -> int:
    """Print the assessment of a scenario; returns the exit code of ``formnet check``."""
    from functools import partial

    from rich.console import Console
    from rich.markup import escape

    from formnet.formation.scenario.loading import ScenarioError
    from formnet.lab.forecast.checked import load_checked
    from formnet.lab.text.assessment import describe, describe_plan
    from formnet.lab.text.problems import report_problems, say_slow, warn

    troubles = Console(stderr=True)
    try:
        say = partial(say_slow, troubles)
        scenario, warnings = load_checked(
            path, overrides, say, lookahead=lookahead, allow_outside=allow_outside
        )
    except ScenarioError as error:
        report_problems(troubles, error)
        return BAD_INPUT
    console = Console(highlight=False)
    console.print(f"{escape(str(path))}: valid", soft_wrap=True)
    for line in [*describe(scenario), *describe_plan(scenario)]:
        console.print(escape(line), soft_wrap=True)
    warn(console, warnings)
    return ALL_HOLD
