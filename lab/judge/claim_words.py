"""What claims and errors are called: one table for the terminal, pages, figures and comparisons.

A law that the paper speaks of is held against the paper's equations, by their numbers. Any other
law is judged by the same errors, but they are called by their names alone, and nothing is said of
V unless ``[expect]`` claims something of it: the theorems and V are of the paper's law.
"""

from collections.abc import Mapping
from typing import Any

from formnet.formation.paper.theory import of_the_paper
from formnet.formation.scenario.model import Scenario

EQUATIONS = {"formation": "Eq. 3", "heading": "Eq. 4", "centroid": "Eq. 5"}
"""What the claims of ``formation.paper.theory.CLAIMS`` are called in the paper."""
UNITS = {"formation": "m", "heading": "rad", "centroid": "m", "lyapunov": ""}
"""The unit of each claim's error; that of "V never rises" is a share of V."""
NOTHING = "neither formation, heading nor centroid"
"""What was observed of the claims where none was."""
ENDS = {
    "formation": "formation_error_m",
    "heading": "heading_error_rad",
    "centroid": "centroid_error_m",
}
"""Under which key of a verdict each error at the end is."""


def titles(*scenarios: Scenario) -> dict[str, str]:
    """What each claim is called: ``formation (Eq. 3)``, or ``formation``."""
    found = {"lyapunov": "V never rises"}
    if not all(map(of_the_paper, scenarios)):
        return {claim: claim for claim in EQUATIONS} | found
    return {claim: f"{claim} ({equation})" for claim, equation in EQUATIONS.items()} | found


def labels(*scenarios: Scenario) -> dict[str, str]:
    """What each error is called with its unit: ``formation, Eq. 3 (m)``, or ``formation (m)``."""
    numbered = all(map(of_the_paper, scenarios))
    return {
        claim: f"{claim}, {equation} ({UNITS[claim]})" if numbered else f"{claim} ({UNITS[claim]})"
        for claim, equation in EQUATIONS.items()
    }


def errors(*scenarios: Scenario) -> str:
    """What the three errors are called together."""
    return "errors of Eqs. 3–5" if all(map(of_the_paper, scenarios)) else "errors"


def told(judged: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The claims of a verdict that there is something to say of: V only if known or claimed."""
    return {
        name: claim
        for name, claim in judged["claims"].items()
        if name != "lyapunov" or claim["expected"] is not None or judged.get("lyapunov") is not None
    }


def capital(text: str) -> str:
    """``text`` as a sentence begins."""
    return text[:1].upper() + text[1:]
