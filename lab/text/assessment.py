"""What theory and plan say of a scenario, in lines for people."""

from formnet.formation.paper.theory import assess, of_the_paper
from formnet.formation.scenario.model import Scenario


def describe(scenario: Scenario) -> list[str]:
    """The graph in lines for people and, of a law that the paper speaks of, what theory says."""
    assessment = assess(scenario)
    graph = [
        f"  algebraic connectivity λ₂(L)  {assessment.algebraic_connectivity:.4g}",
        f"  λ_min(L + diag μ)             {assessment.smallest_eigenvalue:.4g}",
    ]
    if not of_the_paper(scenario):
        return graph
    margin = assessment.margin
    return [
        *graph,
        *([f"  {margin.in_words}"] if margin is not None and margin.value > 0.0 else []),
        f"  {assessment.why}",
        "  the theory claims: "
        + (
            ", ".join(
                f"{claim} {'yes' if value else 'no'}" for claim, value in assessment.claims.items()
            )
            or "nothing"
        ),
    ]


def describe_plan(scenario: Scenario) -> list[str]:
    """What happens in a run and when, in lines for people; nothing if nothing does."""
    plan = scenario.plan
    if not plan:
        return []
    lines = ["  planned events:"]
    for entry in plan:
        lines.append(f"    {entry.at_s:9.3f} s  {entry.what}")
        if entry.at_s > scenario.duration_s:
            lines[-1] += f"  (never: the run ends at {scenario.duration_s:g} s)"
    return lines
