"""``motion``: the extremes of the motion over every control tick (:mod:`plant.extremes`)."""

from typing import Annotated, Any

from pydantic import Field

from formnet.formation.records.events import Extremes, event
from formnet.lab.verdict.section import Instant, Listed, RobotId, Section


class Closest(Section):
    """The smallest distance between two robots."""

    distance_m: float = Field(description="The distance.")
    robots: Annotated[Listed[RobotId], Field(min_length=2, max_length=2)] = Field(
        description="Between which two."
    )
    t_s: Instant = Field(description="When.")


class TopSpeed(Section):
    """The top speed, or the top commanded speed at the kinematic level."""

    speed_mps: float = Field(description="Its magnitude.")
    robot: RobotId = Field(description="Of which robot.")
    t_s: Instant = Field(description="When.")


class TopTurnRate(Section):
    """The top turn rate."""

    turn_rate_radps: float = Field(description="Its magnitude.")
    robot: RobotId = Field(description="Of which robot.")
    t_s: Instant = Field(description="When.")


class TopTorque(Section):
    """The top torque that a law commanded, at the dynamic level."""

    torque_nm: float = Field(description="Its magnitude.")
    robot: RobotId = Field(description="Of which robot.")
    t_s: Instant = Field(description="When.")


class Motion(Section):
    """The extremes of the motion of a whole run; of equal values the earliest."""

    closest: Closest | None = Field(description="The closest two robots; null with one robot.")
    top_speed: TopSpeed | None = Field(description="The fastest robot.")
    top_turn_rate: TopTurnRate | None = Field(description="The fastest turn.")
    top_command: TopTorque | TopSpeed | None = Field(description="The largest command of a law.")

    @property
    def told(self) -> dict[str, str]:
        """Each in words, by what it is of; without those that there are not."""
        extremes = event(Extremes.name, 0, self.model_dump())
        assert isinstance(extremes, Extremes)
        return extremes.titled


def motion(details: dict[str, Any] | None) -> Motion | None:
    """The section ``motion``, of the details of an event ``extremes``; None without any."""
    return None if details is None else Motion.model_validate(details)
