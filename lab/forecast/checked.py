"""A scenario that a run can begin with: it is valid, and its law can be had."""

from pathlib import Path

from formnet.formation.scenario.loading import ScenarioError, load
from formnet.formation.scenario.model import Scenario
from formnet.lab.forecast.foresight import Say, foresee
from formnet.netem.files.problems import Problem


def load_checked(path: Path, overrides: tuple[str, ...], say: Say) -> tuple[Scenario, list[str]]:
    """Load a scenario, see that its law can be had, and what is to be feared.

    ``say`` takes where the law is, if it takes long.

    Raises:
        ScenarioError: with every problem found.
    """
    scenario = load(path, overrides)
    problem, warnings = foresee(scenario, say)
    if problem is not None:
        raise ScenarioError(str(path), [Problem("law.kind", repr(scenario.law.kind), problem)])
    return scenario, warnings
