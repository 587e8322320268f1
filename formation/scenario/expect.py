"""``[expect]``: the table of claims that can be made about a run, and the model of the section.

Everything that is said of a claim derives from its row: the keys of ``[expect]``, the keys of a
verdict, titles and units in tables, figures, pages and the scenario reference.
"""

from dataclasses import dataclass
from typing import Any

from pydantic import Field

from formnet.netem.files.tables import LongSeconds, Positive, Table


@dataclass(frozen=True)
class Criterion:
    """Something that ``[expect]`` can claim of a run.

    Attributes:
        name: The key of the claim in ``[expect]``, and among the claims of a verdict.
        title: What it is called beside a law that the paper does not speak of.
        unit: That of the error by which it is judged; empty if that is a ratio.
        tolerance: What the error may be at most, unless ``[expect]`` says otherwise; in ``unit``.
        says: What is claimed, for the scenario reference.
    """

    name: str
    title: str
    unit: str
    tolerance: float
    says: str


@dataclass(frozen=True)
class ErrorCriterion(Criterion):
    """One of Eqs. 3-5: an error that must be small over the end of a run.

    Attributes:
        equation: The number of its equation in the paper.
        measures: What the error is, for the scenario reference.
    """

    equation: int
    measures: str

    @property
    def reference(self) -> str:
        """``Eq. 3``."""
        return f"Eq. {self.equation}"

    @property
    def tolerance_key(self) -> str:
        """The key of its tolerance in ``[expect]``."""
        return f"{self.name}_tolerance_{self.unit}"

    @property
    def error_key(self) -> str:
        """The key of its error at the end of a run in a verdict."""
        return f"{self.name}_error_{self.unit}"


FORMATION = ErrorCriterion(
    name="formation",
    title="formation",
    unit="m",
    tolerance=0.05,
    says="the pattern, in any position and orientation",
    equation=3,
    measures="the largest error between two robots",
)
HEADING = ErrorCriterion(
    name="heading",
    title="heading",
    unit="rad",
    tolerance=0.02,
    says="equal headings",
    equation=4,
    measures="the largest difference of two headings",
)
CENTROID = ErrorCriterion(
    name="centroid",
    title="centroid",
    unit="m",
    tolerance=0.2,
    says="the centroid is that of the pattern",
    equation=5,
    measures="‖Σx − Σp‖, n times the centroid's distance",
)
LYAPUNOV = Criterion(
    name="lyapunov",
    title="V never rises",
    unit="",
    tolerance=1e-9,
    says="V (Eq. 22, 34, 40 or 43) never rises beyond its budget, over the whole run",
)
"""A gain of V below this share of V is rounding, not a rise."""

ERRORS = {row.name: row for row in (FORMATION, HEADING, CENTROID)}
"""Eqs. 3, 4 and 5 by name, in the order of :class:`formation.paper.geometry.Errors`."""
CRITERIA: dict[str, Criterion] = {**ERRORS, LYAPUNOV.name: LYAPUNOV}
"""All of them by name."""


def references() -> str:
    """All equations together: ``Eqs. 3–5``."""
    numbers = [row.equation for row in ERRORS.values()]
    return f"Eqs. {min(numbers)}–{max(numbers)}"


def _claim(row: Criterion) -> Any:
    where = f"{row.reference}: " if isinstance(row, ErrorCriterion) else ""
    return Field(default=None, description=f"{where}{row.says}.")


def _tolerance(row: ErrorCriterion) -> Any:
    return Field(default=row.tolerance, description=f"Tolerance of {row.measures}.")


class Expect(Table):
    """``[expect]``: which of Eqs. 3-5 shall hold over the last ``window_s`` of the run.

    ``false`` is a claim too: the run fails if the equation does hold.
    """

    formation: bool | None = _claim(FORMATION)
    heading: bool | None = _claim(HEADING)
    centroid: bool | None = _claim(CENTROID)
    lyapunov: bool | None = _claim(LYAPUNOV)
    formation_tolerance_m: Positive = _tolerance(FORMATION)
    heading_tolerance_rad: Positive = _tolerance(HEADING)
    centroid_tolerance_m: Positive = _tolerance(CENTROID)
    window_s: LongSeconds | None = Field(
        default=None,
        description=(
            "Claims are judged over this last part of the run; by default a tenth of it, at least "
            "one broadcast period."
        ),
    )

    @property
    def claims(self) -> dict[str, bool | None]:
        """What is claimed of each criterion; None where nothing is."""
        return {name: getattr(self, name) for name in CRITERIA}

    @property
    def tolerances(self) -> dict[str, float]:
        """The tolerance of each of Eqs. 3-5, in the unit of its error."""
        return {name: getattr(self, row.tolerance_key) for name, row in ERRORS.items()}
