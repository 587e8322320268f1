"""Events in words, for the terminal, the page of a run and Rerun's text log."""

from collections.abc import Mapping, Sequence
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
    return named(value) if name == "robots" else f"{name} {', '.join(map(str, value))}"


def named(robots: Sequence[object]) -> str:
    """``robot 3``, or ``robots 3, 4``."""
    return f"robot{'s' * (len(robots) != 1)} {', '.join(map(str, robots))}"


def times(factor: float) -> str:
    """How many times as fast as real time."""
    return f"{factor:.2g} ×" if factor < 10.0 else f"{factor:.0f} ×"
