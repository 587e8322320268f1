"""``formnet check``: is a scenario valid, and what does the theory make of it?"""

from pathlib import Path

from rich.console import Console
from rich.markup import escape

from formnet.formation.paper.theory import assess, of_the_paper
from formnet.formation.scenario.loading import ScenarioError
from formnet.formation.scenario.model import Scenario
from formnet.lab.commands.run import load_checked, report_problems, warn
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT


def check_scenario(path: Path, overrides: tuple[str, ...]) -> int:
    """Print the assessment of a scenario; returns the exit code of ``formnet check``."""
    troubles = Console(stderr=True)
    try:
        scenario, warnings = load_checked(path, overrides, troubles)
    except ScenarioError as error:
        report_problems(troubles, error)
        return BAD_INPUT
    console = Console(highlight=False)
    console.print(f"{escape(str(path))}: valid", soft_wrap=True)
    for line in [*describe(scenario), *describe_plan(scenario)]:
        console.print(escape(line), soft_wrap=True)
    warn(console, warnings)
    return ALL_HOLD


def describe_plan(scenario: Scenario) -> list[str]:
    """What happens in a run and when, in lines for people; nothing if nothing does."""
    plan = scenario.plan
    if not plan:
        return []
    lines = ["  plan:"]
    for entry in plan:
        lines.append(f"    {entry.at_s:9.3f} s  {entry.what}")
        if entry.at_s > scenario.duration_s:
            lines[-1] += f"  (never: the run ends at {scenario.duration_s:g} s)"
    return lines


def describe(scenario: Scenario) -> list[str]:
    """The graph in lines for people and, of a law that the paper speaks of, what theory says."""
    assessment = assess(scenario)
    margin = assessment.cross_term_margin
    relation = ">" if margin > 0.25 else "not >"
    graph = [
        f"  algebraic connectivity λ₂(L)  {assessment.algebraic_connectivity:.4g}",
        f"  λ_min(L + diag μ)             {assessment.smallest_eigenvalue:.4g}",
    ]
    if not of_the_paper(scenario):
        return graph
    return [
        *graph,
        f"  β λ_min > 1/4                 {margin:.4g} {relation} 0.25",
        f"  {assessment.why}",
        "  the theory claims: "
        + (
            ", ".join(
                f"{claim} {'yes' if value else 'no'}" for claim, value in assessment.claims.items()
            )
            or "none"
        ),
    ]
