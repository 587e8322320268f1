"""``[plant]`` and ``[run]``: what happens to a robot, and to the run, when a robot fails."""

from typing import Annotated, Literal

from pydantic import Field

from formnet.netem.files.tables import PositiveSeconds, Table


class Plant(Table):
    """``[plant]``: what the body of a robot does whose process is gone, stopped or too slow."""

    body_on_failure: Literal["brake", "coast", "freeze"] = Field(
        default="brake",
        description=(
            "brake: velocities decay; coast: no torque on the wheels (kinematic: the velocities "
            "stay); freeze: the body stops at once."
        ),
    )
    brake_time_s: PositiveSeconds = Field(default=0.1, description='Time constant of "brake".')
    drive_timeout_s: PositiveSeconds = Field(
        default=0.25, description="In real time, a robot brakes if its newest drive is older."
    )


class Run(Table):
    """``[run]``: what happens when something goes wrong that nobody planned."""

    on_unscheduled_loss: Literal["continue", "abort"] = Field(
        default="continue",
        description="After an unplanned loss of a robot, continue without it or end the run.",
    )
    patience_s: Annotated[float, Field(ge=0.5, le=3600.0)] = Field(
        default=10.0, description="A robot that does not answer within this wall time is lost."
    )
