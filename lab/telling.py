"""Events in words, for the page of a run and for Rerun's text log."""

from collections.abc import Mapping
from typing import Any


def told(kind: str, details: Mapping[str, Any]) -> str:
    """The details of an event of this kind, in words."""
    if kind == "timing":  # robots by name, each with a table
        robots = details["robots"].values()
        missed, periods = (sum(own[key] for own in robots) for key in ("missed", "periods"))
        return f"{missed} of {periods} periods missed (verdict.json has all)"
    return "; ".join(
        _told(name, value) for name, value in details.items() if value not in ("", None)
    )


def _told(name: str, value: object) -> str:
    if name in ("what", "reason"):
        return str(value)
    if not isinstance(value, list):
        return f"{name} {value}"
    if name == "robots" and len(value) == 1:
        name = "robot"
    return f"{name} {', '.join(map(str, value))}"
