"""How the runs of the claims ended, against how they should."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf

from formnet.formation.scenario.expect import ERRORS, LYAPUNOV
from formnet.lab.claims.claim import Case, Claim
from formnet.lab.verdict.model import FAILS, HOLDS, NOT_JUDGED, OBSERVED, Verdict

BROKEN = "BROKEN"
"""The verdict on a claim of which a run did not end well."""


@dataclass(frozen=True)
class Result:
    """One run, judged; ``seconds`` is what it took on the wall."""

    case: Case
    verdict: Verdict
    seconds: float

    @property
    def ended(self) -> bool:
        """Whether the run came to its end, diverging included, and nobody was lost unplanned."""
        return self.verdict.outcome.planned and not self.verdict.robots.lost

    @property
    def diverged(self) -> bool:
        """Whether the state left the finite numbers."""
        return self.verdict.outcome.kind == "diverged"

    def observed(self, claim: str) -> bool | None:
        """Whether a criterion was met; None: not judged."""
        return self.verdict.claims[claim].observed

    def error(self, claim: str) -> float | None:
        """The largest error of an equation in the stretch that is judged; None if not finite."""
        return None if self.diverged else self.verdict.claims[claim].largest_in_window

    def tolerance(self, claim: str) -> float:
        """What the error of an equation must stay within."""
        return self.verdict.claims[claim].tolerance

    @property
    def as_expected(self) -> bool:
        """Whether the run ended as it should; where nothing is claimed, whether it ended."""
        case = self.case
        if not self.ended or (case.expected is not None and self.diverged != case.diverges):
            return False
        return all(self.observed(claim) == value for claim, value in case.asked.items())

    @property
    def undecided(self) -> bool:
        """Whether nothing keeps the run from being as expected but that V was not judged."""
        case = self.case
        if not self.ended or self.diverged != case.diverges:
            return False
        missed = [name for name, value in case.asked.items() if self.observed(name) != value]
        return missed == [LYAPUNOV.name] and self.observed(LYAPUNOV.name) is None


@dataclass(frozen=True)
class Row:
    """One claim and the runs of it, in the catalogue's order."""

    claim: Claim
    results: Sequence[Result]

    @property
    def verdict(self) -> str:
        """HOLDS, FAILS or NOT_JUDGED; OBSERVED where nothing is claimed; BROKEN if a run broke."""
        if not all(result.ended for result in self.results):
            return BROKEN
        if not self.claim.claimed:
            return OBSERVED
        if all(result.as_expected for result in self.results):
            return HOLDS
        open_ = all(result.as_expected or result.undecided for result in self.results)
        return NOT_JUDGED if open_ else FAILS

    @property
    def happened(self) -> str:
        """What happened, in words."""
        runs = len(self.results)
        if self.claim.claimed:
            undecided = [result.case.name for result in self.results if result.undecided]
            wrong = [
                result.case.name
                for result in self.results
                if not (result.as_expected or result.undecided)
            ]
            if wrong:
                return f"not as predicted in {len(wrong)} of {runs} runs: {', '.join(wrong)}"
            if undecided:
                return f"V not judged in {len(undecided)} of {runs} runs: {', '.join(undecided)}"
            return "as predicted" if runs == 1 else f"as predicted in all {runs} runs"
        ends_s = [r.verdict.outcome.t_s for r in self.results if r.diverged]
        if ends_s:
            return f"not claimed; observed: diverges at {', '.join(f'{t:.0f} s' for t in ends_s)}"
        found = []
        for claim, error in ERRORS.items():
            count = sum(result.observed(claim) is True for result in self.results)
            word = f"in {count} of {runs}" if count else "does not"
            word = "holds" if count == runs else word
            found.append(f"{error.reference} {word}")
        return "not claimed; observed: " + ", ".join(found)

    def telling(self, claim: str) -> tuple[bool | None, float | None]:
        """The error that says most of an equation, and whether it should be small.

        The largest of the runs that should keep it; without any, the smallest of those that
        should not; where nothing is claimed (None), the largest. An error that is not finite
        is infinite; None if no run has anything to say.
        """
        for wanted, choose in ((True, max), (False, min), (None, max)):
            chosen = [r for r in self.results if r.case.asked.get(claim) is wanted]
            if chosen and (wanted is not None or not self.claim.claimed):
                errors = [r.error(claim) for r in chosen]
                return wanted, choose(inf if error is None else error for error in errors)
        return None, None


def complete(claims: Sequence[Claim], done: Mapping[tuple[str, str], Result]) -> Iterator[Row]:
    """The rows of which every run is in ``done``, by the keys of claim and case."""
    for claim in claims:
        results = [done.get((claim.key, case.name)) for case in claim.cases]
        known = [result for result in results if result is not None]
        if len(known) == len(results):
            yield Row(claim, known)
