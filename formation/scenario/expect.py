"""``[expect]``: the claims about a run, and their tolerances."""

from pydantic import Field

from formnet.netem.files.tables import LongSeconds, Positive, Table


class Expect(Table):
    """``[expect]``: which of Eqs. 3-5 shall hold over the last ``window_s`` of the run.

    ``false`` is a claim too: the run fails if the equation does hold.
    """

    formation: bool | None = Field(
        default=None, description="Eq. 3: the pattern, in any position and orientation."
    )
    heading: bool | None = Field(default=None, description="Eq. 4: equal headings.")
    centroid: bool | None = Field(
        default=None, description="Eq. 5: the centroid is that of the pattern."
    )
    lyapunov: bool | None = Field(
        default=None,
        description="V (Eq. 22, 34, 40 or 43) never rises beyond its budget, over the whole run.",
    )
    formation_tolerance_m: Positive = Field(
        default=0.05, description="Tolerance of the largest error between two robots."
    )
    heading_tolerance_rad: Positive = Field(
        default=0.02, description="Tolerance of the largest difference of two headings."
    )
    centroid_tolerance_m: Positive = Field(
        default=0.2, description="Tolerance of ‖Σx − Σp‖, n times the centroid's distance."
    )
    window_s: LongSeconds | None = Field(
        default=None,
        description=(
            "Claims are judged over this last part of the run; by default a tenth of it, at least "
            "one broadcast period."
        ),
    )
