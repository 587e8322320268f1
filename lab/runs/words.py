"""Facts about a run in words, for the terminal and the page of a run."""

from collections.abc import Mapping
from typing import Any

from formnet.formation.records import events


def motion_told(judged: Mapping[str, Any] | None) -> dict[str, str]:
    """The extremes of the motion in a verdict, each in words by its title.

    There are none without a verdict, or in one of an older run.

    Raises:
        Malformed: what the verdict has there are none.
    """
    found = (judged or {}).get("motion")
    event = events.event(events.Extremes.name, 0, found) if found else None
    return event.titled if isinstance(event, events.Extremes) else {}


def times(factor: float) -> str:
    """How many times as fast as real time."""
    return f"{factor:.2g} ×" if factor < 10.0 else f"{factor:.0f} ×"
