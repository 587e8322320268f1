"""``[expect]``: the claims about a run, and their tolerances."""

from pydantic import Field

from formnet.netem.files.tables import LongSeconds, Positive, Table


class Expect(Table):
    """``[expect]``: which of Eqs. 3-5 shall hold over the last ``window_s`` of the run.

    ``false`` is a claim too: the run fails if the equation does hold.
    """

    formation: bool | None = Field(
        default=None, description="Eq. 3: the pattern, wherever it stands and however it is turned."
    )
    heading: bool | None = Field(default=None, description="Eq. 4: headings agree.")
    centroid: bool | None = Field(
        default=None, description="Eq. 5: the centroid is that of the pattern."
    )
    lyapunov: bool | None = Field(
        default=None,
        description="V (Eq. 22, 34, 40 or 43) never rises beyond its budget, over the whole run.",
    )
    formation_tolerance_m: Positive = Field(
        default=0.05, description="Of the largest error between two robots."
    )
    heading_tolerance_rad: Positive = Field(
        default=0.02, description="Of the largest gap between two headings."
    )
    centroid_tolerance_m: Positive = Field(
        default=0.2, description="Of ‖Σx − Σp‖, n times the centroid's distance."
    )
    window_s: LongSeconds | None = Field(
        default=None,
        description=(
            "Claims are judged over so much of the end; by default a tenth of the run, at least "
            "one broadcast period."
        ),
    )
