"""``realtime``: how well a run in real time kept its time."""

from collections.abc import Sequence

from pydantic import Field

from formnet.formation.records import events as kinds
from formnet.formation.records.events import Event
from formnet.lab.verdict.section import Count, Section


class Spread(Section):
    """How values spread."""

    p50: float = Field(description="The median.")
    p99: float = Field(description="The 99th percentile.")
    max: float = Field(description="The maximum.")


class PlantTiming(Section):
    """How well the plant kept its time."""

    woke_late_s: Spread | None = Field(description="How late it woke for a period.")


class RobotTiming(Section):
    """How well a robot kept its time, over all its lives."""

    periods: Count = Field(description="The control periods in which it was up.")
    missed: Count = Field(description="Those for which no command came in time.")
    sense_to_drive_s: Spread | None = Field(description="From a measurement to its command.")
    woke_late_s: Spread | None = Field(description="How late it woke for a period.")
    transit_s: Spread | None = Field(description="Broadcasts on their way, without link delays.")
    clock_offset_s: float = Field(description="Its clock ahead of the plant's, as last estimated.")
    clock_uncertainty_s: float = Field(description="The largest uncertainty of that estimate.")


class Timing(Section):
    """How well a run in real time kept its time."""

    plant: PlantTiming = Field(description="The plant.")
    robots: dict[str, RobotTiming] = Field(description="Each robot, by its id.")


def timing(events: Sequence[Event]) -> Timing | None:
    """The section ``realtime``; None for a run in virtual time."""
    details = next((event.details for event in events if isinstance(event, kinds.Timing)), None)
    return None if details is None else Timing.model_validate(details)
