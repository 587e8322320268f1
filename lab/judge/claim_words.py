"""What the criteria and their errors are called, in the terminal, pages, figures, comparisons.

A law that the paper speaks of is held against the paper's equations, by their numbers. Any other
law is judged by the same errors, but they are called by their names alone, and nothing is said of
V unless ``[expect]`` claims something of it: the theorems and V are of the paper's law.
"""

from formnet.formation.paper.theory import of_the_paper
from formnet.formation.scenario.expect import (
    CRITERIA,
    ERRORS,
    ErrorCriterion,
    references,
)
from formnet.formation.scenario.model import Scenario


def titles(*scenarios: Scenario) -> dict[str, str]:
    """What each claim is called: ``formation (Eq. 3)``, or ``formation``."""
    numbered = all(map(of_the_paper, scenarios))
    return {
        name: f"{row.title} ({row.reference})"
        if numbered and isinstance(row, ErrorCriterion)
        else row.title
        for name, row in CRITERIA.items()
    }


def labels(*scenarios: Scenario) -> dict[str, str]:
    """What each error is called with its unit: ``formation, Eq. 3 (m)``, or ``formation (m)``."""
    numbered = all(map(of_the_paper, scenarios))
    return {
        name: f"{row.title}{f', {row.reference}' if numbered else ''} ({row.unit})"
        for name, row in ERRORS.items()
    }


def errors(*scenarios: Scenario) -> str:
    """What the three errors are called together."""
    return f"errors of {references()}" if all(map(of_the_paper, scenarios)) else "errors"


def nothing() -> str:
    """What was observed of Eqs. 3-5 where none was."""
    *titles, last = (row.title for row in ERRORS.values())
    return f"neither {', '.join(titles)} nor {last}"


def capital(text: str) -> str:
    """``text`` as a sentence begins."""
    return text[:1].upper() + text[1:]
