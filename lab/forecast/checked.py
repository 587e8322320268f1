"""A scenario that a run can begin with: it is valid, and its law can be had."""

from pathlib import Path

from formnet.formation.scenario.loading import ScenarioError, load
from formnet.formation.scenario.model import Scenario
from formnet.lab.forecast.foresight import Say, foresee, taken_on_trust
from formnet.netem.files.problems import Problem


def load_checked(
    path: Path,
    overrides: tuple[str, ...],
    say: Say,
    *,
    lookahead: bool = True,
    allow_outside: bool = False,
) -> tuple[Scenario, list[str]]:
    """Load a scenario, see that its law can be had, and what is to be feared.

    ``say`` takes where the law is, if it takes long. Without ``lookahead`` the law is not tried.
    ``allow_outside``: as for :func:`formation.scenario.loading.load`.

    Raises:
        ScenarioError: with every problem found.
    """
    scenario = load(path, overrides, allow_outside=allow_outside)
    problem, warnings = (foresee if lookahead else taken_on_trust)(scenario, say)
    if problem is not None:
        raise ScenarioError(str(path), [Problem("law.kind", repr(scenario.law.kind), problem)])
    return scenario, warnings
