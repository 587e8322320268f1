"""``claims``: what was expected of a run, what was observed, and whether it holds."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

from pydantic import AfterValidator, Field

from formnet.formation.scenario.expect import CRITERIA, ERRORS, LYAPUNOV, Expect
from formnet.lab.verdict.ending import Ending
from formnet.lab.verdict.section import Section, finite
from formnet.lab.verdict.stability import Stability

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Judgement(Section):
    """One claim, judged.

    An equation is observed if its error stays within its tolerance at every recorded instant of
    the judged stretch at the end; V, if it never rises beyond its budget in the whole run. In a
    run that diverged nothing is observed; one that ended early in another way is not judged. Nor
    is a V that does not rise, where its budget exceeds what it began with (estimates are wrong,
    and ε is large): a rise would not show.
    """

    expected: bool | None = Field(description="What `[expect]` claims; null if nothing.")
    observed: bool | None = Field(description="What was observed; null if it was not judged.")
    holds: bool | None = Field(
        description="Whether both are the same; null if nothing is claimed or judged."
    )
    tolerance: float = Field(
        description="What the error may be at most, in its unit (m, rad, m; of V a ratio)."
    )
    largest_in_window: float | None = Field(
        description="The largest error in the judged stretch; of V, the largest relative gain "
        "beyond its budget in the whole run."
    )


def _of_every_criterion(claims: dict[str, Judgement]) -> dict[str, Judgement]:
    if claims.keys() != CRITERIA.keys():
        raise ValueError(f"must have {', '.join(CRITERIA)}, and nothing else")
    return claims


Claims = Annotated[
    dict[str, Judgement],
    AfterValidator(_of_every_criterion),
    Field(
        json_schema_extra={
            "propertyNames": {"enum": list(CRITERIA)},
            "required": list(CRITERIA),
        }
    ),
]
"""A judgement for each row of the table of claims, by its name."""


def claims(
    expect: Expect,
    end: Ending,
    series: "Mapping[str, NDArray[np.float64]]",
    rising: Stability | None,
    *,
    anybody: bool,
) -> dict[str, Judgement]:
    """The section ``claims``.

    ``series`` has the errors of Eqs. 3-5 in the judged stretch, (n,) each, of the robots that are
    up at the end; ``anybody``: whether there are such. ``rising`` is the section ``lyapunov``.
    """
    ended = anybody and end.planned
    found = {}
    for name in ERRORS:
        tolerance, errors = expect.tolerances[name], series[name]
        within = end.kind == "completed" and bool((errors <= tolerance).all())
        found[name] = _judgement(
            expect.claims[name],
            within if ended else None,
            tolerance,
            finite(errors.max()) if len(errors) else None,
        )
    found[LYAPUNOV.name] = _of_v(
        rising if ended else None, expect.claims[LYAPUNOV.name], diverged=end.kind == "diverged"
    )
    return found


def _of_v(rising: Stability | None, expected: bool | None, *, diverged: bool) -> Judgement:
    """The judgement on "V never rises"."""
    if rising is None or rising.from_s is None:
        return _judgement(expected, False if diverged else None, LYAPUNOV.tolerance, None)
    observed: bool | None = not diverged and not rising.rises
    if observed and not rising.discriminates:
        observed = None
    unmeasured = diverged and not rising.rises
    return _judgement(
        expected, observed, LYAPUNOV.tolerance, None if unmeasured else rising.largest_gain
    )


def _judgement(
    expected: bool | None, observed: bool | None, tolerance: float, largest: float | None
) -> Judgement:
    return Judgement(
        expected=expected,
        observed=observed,
        holds=None if expected is None or observed is None else observed == expected,
        tolerance=tolerance,
        largest_in_window=largest,
    )
