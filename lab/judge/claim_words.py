"""What the criteria and their errors are called, in the terminal, pages, figures, comparisons.

A law that the paper speaks of is held against the paper's equations, by their numbers. Any other
law is judged by the same errors, but they are called by their names alone, and nothing is said of
V unless ``[expect]`` claims something of it: the theorems and V are of the paper's law.
"""

from collections.abc import Mapping
from typing import Any

from formnet.formation.paper.theory import of_the_paper
from formnet.formation.scenario.expect import (
    CRITERIA,
    ERRORS,
    LYAPUNOV,
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


def told(judged: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The claims of a verdict that there is something to say of: V only if known or claimed."""
    return {
        name: claim
        for name, claim in judged["claims"].items()
        if name != LYAPUNOV.name
        or claim["expected"] is not None
        or judged.get("lyapunov") is not None
    }


def capital(text: str) -> str:
    """``text`` as a sentence begins."""
    return text[:1].upper() + text[1:]
