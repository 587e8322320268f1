"""What the claims of :mod:`lab.claims.catalogue` are built from: scenarios, graphs, overrides."""

from collections.abc import Iterable, Iterator, Sequence

from formnet.formation.scenario.expect import ERRORS
from formnet.lab.claims.claim import Case, Claim

SECTION5, DELAYED = "paper/section5.toml", "paper/section5-delay.toml"
FOLLOWING = "faults/leader-follower.toml"
EXACT = (
    "law.cross_term=compensated",
    "robot_defaults.mass_estimate_kg=1.0",
    "robot_defaults.inertia_estimate_kgm2=1.0",
)
"""What makes V of the proofs fall at every instant: all terms cancelled, nothing uncertain."""
RING = ((1, 2), (2, 3), (3, 4), (4, 5), (5, 1))
STAR = ((1, 2), (1, 3), (1, 4), (1, 5))
PATH = ((1, 2), (2, 3), (3, 4), (4, 5))
Edges = Iterable[tuple[int, int]]


def claim_of(key: str, says: str, where: str, cases: Sequence[Case]) -> Claim:
    """A claim whose runs all end alike, so that ``should`` follows from the first."""
    asked = cases[0].asked
    hold = [ERRORS[claim].equation for claim, value in asked.items() if value]
    fail = [ERRORS[claim].equation for claim, value in asked.items() if not value]
    words = [f"{_and(hold)} hold" + ("s" if len(hold) == 1 else "")] if hold else []
    if fail:
        words.append(f"{_and(fail)} " + ("does not" if len(fail) == 1 else "do not"))
    should = ", ".join(words) or "not claimed"
    return Claim(key, says, where, should, tuple(cases))


def _and(equations: Sequence[int]) -> str:
    return ("Eq. " if len(equations) == 1 else "Eqs. ") + ", ".join(map(str, equations))


def with_edges(edges: Edges) -> str:
    """The override that sets the graph."""
    return f"formation.edges={[list(edge) for edge in edges]}"


def with_kill(robot: int, at_s: float, restart_after_s: float | None = None) -> str:
    """The override that makes a kill the whole timeline."""
    after = "" if restart_after_s is None else f", restart_after_s={restart_after_s}"
    return f'timeline=[{{action="kill", at_s={at_s}, robots={robot}{after}}}]'


def with_damping(*robots: int) -> Iterator[str]:
    """The overrides that give robots μ = 4."""
    yield from (f"robots.{robot}.damping=4.0" for robot in robots)
