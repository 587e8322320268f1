"""What is proved of a scenario that falls under a theorem (docs/corrections.md).

The proofs of the paper drop w1 z2 z3 from V̇. Compensated, it is gone, and every theorem is
proved. As printed, a theorem needs a condition of its own, which is applied here.
"""

from typing import NamedTuple

from formnet.formation.paper.graph import delayed_form, laplacian, smallest_eigenvalue
from formnet.formation.paper.status import PROVED, WITH_COMPENSATION, Status
from formnet.formation.scenario.model import Scenario

_NEEDED = 0.25


class Margin(NamedTuple):
    """What outweighs the cross term in V̇ where it exceeds 1/4; ``name`` is its formula."""

    name: str
    value: float

    @property
    def enough(self) -> bool:
        return self.value > _NEEDED

    @property
    def in_words(self) -> str:
        return f"{self.name} = {self.value:.3g} is {'' if self.enough else 'not '}above 1/4"


class Proof(NamedTuple):
    """``status``, what it rests on, and the margin of V of the paper."""

    status: Status
    because: str
    margin: Margin


def margin_of(scenario: Scenario, theorem: int) -> Margin:
    """The margin of V in one theorem: that of Eq. 41 in Theorems 5 and 6, with their delays."""
    damping = [scenario.vehicles[robot].damping for robot in scenario.ids]
    weights = scenario.formation.weights
    if theorem in (5, 6):
        delays_ns = dict(scenario.of_links(lambda settings: settings.constant_ns or 0))
        matrix = delayed_form(scenario.ids, weights, delays_ns)
        name = "β λ_min(½(D − A D⁻¹ A) + diag μ)"
        if len({(source, delay) for (source, _), delay in delays_ns.items()}) > len(damping):
            name = "β λ_min of Eq. 41 with these delays"
    else:
        matrix = laplacian(scenario.ids, weights)
        name = "β λ_min(L + diag μ)"
    return Margin(name, scenario.law.beta * smallest_eigenvalue(matrix, damping))


def proof_of(scenario: Scenario, theorem: int) -> Proof:
    """What is proved of a scenario that satisfies all that ``theorem`` assumes."""
    margin, law = margin_of(scenario, theorem), scenario.law
    if law.cross_term == "compensated":
        return Proof(PROVED, "w1 z2 z3 is compensated", margin)
    if theorem == 1 and law.w1.constant:
        return Proof(PROVED, "w1 is constant (by V* with L⁺)", margin)
    if theorem == 2 and law.w1.constant:
        return Proof(PROVED, "w1 is constant (by V*, for every β)", margin)
    if margin.enough:
        return Proof(PROVED, margin.in_words, margin)
    reasons = [margin.in_words]
    if theorem in (1, 3):
        reasons = ["without damping nothing outweighs w1 z2 z3"]
    if theorem == 4 and law.w1.constant:
        found = gain_for_star(scenario)
        if found.enough:
            return Proof(PROVED, f"w1 is constant and {found.in_words} (by V*)", margin)
        reasons.append(found.in_words)
    elif theorem in (1, 2):
        reasons.append("w1 varies")
    return Proof(WITH_COMPENSATION, ", and ".join(reasons), margin)


class Gain(NamedTuple):
    """Whether a gain is large enough, and against what."""

    enough: bool
    in_words: str


def gain_for_star(scenario: Scenario) -> Gain:
    """Whether K is large enough for V* in Theorem 4: λ_min(K) > 1 / (4 β λ (λ + β w1²)).

    K shaped by the inertia has no bound that holds for every z3: 1 / (K⁻¹)_22 is
    k m̄ Ī / (m̄ z3² + Ī).
    """
    law = scenario.law
    if law.feedback_shape == "inertia":
        return Gain(False, "K shaped by the inertia has no lower bound for V*")
    rate = margin_of(scenario, 4).value / law.beta
    if rate == 0.0:
        return Gain(False, "λ_min(L + diag μ) = 0 is not positive")
    needed = 1.0 / (4.0 * law.beta * rate * (rate + law.beta * law.w1.bias**2))
    enough = law.feedback_gain > needed
    word = "above" if enough else "not above"
    return Gain(
        enough,
        f"K = {law.feedback_gain:g} is {word} 1/(4 β λ (λ + β w1²)) = {needed:.3g}",
    )
