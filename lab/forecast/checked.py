"""A scenario that a run can begin with: it is valid, and its law can be had."""

from pathlib import Path
from typing import NamedTuple

from formnet.agent.law_file import LawFile
from formnet.formation.paper.theory import assess
from formnet.formation.scenario.loading import ScenarioError, load
from formnet.formation.scenario.model import Scenario
from formnet.lab.code.allowed import BadList
from formnet.lab.code.laws import NOTHING, Given, NoLaw, NotAllowed, kind_of, law_of
from formnet.lab.forecast.foresight import Say, foresee, taken_on_trust
from formnet.netem.files.problems import Problem, shown


class Checked(NamedTuple):
    """A scenario, the file whose law it has (None: an installed one), and what is feared of it.

    ``refused`` says why that file is not executed, if it is not.
    """

    scenario: Scenario
    law: LawFile | None
    warnings: list[str]
    refused: str | None = None


def load_ready(
    path: Path,
    overrides: tuple[str, ...],
    say: Say,
    *,
    given: Given = NOTHING,
    lookahead: bool = True,
) -> Checked:
    """:func:`load_checked`, of what can be run: code that may not be executed is a problem.

    Raises:
        ScenarioError: with every problem found.
    """
    found = load_checked(path, overrides, say, given=given, lookahead=lookahead)
    if found.refused is not None:
        raise _about_law(path, found.scenario, found.refused)
    return found


def load_checked(
    path: Path,
    overrides: tuple[str, ...],
    say: Say,
    *,
    given: Given = NOTHING,
    lookahead: bool = True,
) -> Checked:
    """Load a scenario, see that its law can be had, and what is to be feared.

    ``say`` takes where the law is, if it takes long. ``given`` is what the user says of other
    files. Without ``lookahead`` the law is not tried.

    Raises:
        ScenarioError: with every problem found.
    """
    try:
        kind = kind_of(given)
    except NoLaw as error:
        raise ScenarioError(str(path), [Problem("", None, str(error))]) from None
    if kind is not None:
        overrides = (*overrides, f'law.kind="{kind}"')
    scenario = load(path, overrides, allow_outside=given.allow_outside)
    try:
        law = law_of(scenario.law, path.parent, given)
    except NotAllowed as error:
        return Checked(scenario, None, assess(scenario).warnings, str(error))
    except (NoLaw, BadList) as error:
        raise _about_law(path, scenario, str(error)) from None
    problem, warnings = (foresee if lookahead else taken_on_trust)(scenario, say, law)
    if problem is not None:
        raise _about_law(path, scenario, problem)
    return Checked(scenario, law, warnings)


def _about_law(path: Path, scenario: Scenario, rule: str) -> ScenarioError:
    return ScenarioError(str(path), [Problem("law.kind", shown(scenario.law.kind), rule)])
