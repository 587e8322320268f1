"""Events in words, for the terminal, the page of a run and Rerun's text log."""

from collections.abc import Mapping, Sequence
from typing import Any


def told(kind: str, details: Mapping[str, Any]) -> str:
    """The details of an event of this kind, in words."""
    if kind == "timing":  # robots by name, each with a table
        robots = details["robots"].values()
        missed, periods = (sum(own[key] for own in robots) for key in ("missed", "periods"))
        return f"{missed} of {periods} periods missed (all are in verdict.json)"
    if kind == "extremes":
        return "; ".join(f"{what} {words}" for what, words in extremes_told(details).items())
    return "; ".join(
        _told(name, value) for name, value in details.items() if value not in ("", None)
    )


def extremes_told(details: Mapping[str, Any]) -> dict[str, str]:
    """The extremes of a motion, each in words, by what it is of; without those there are not.

    Raises:
        ValueError: ``details`` are not those of :meth:`formnet.plant.extremes.Extremes.details`.
    """
    try:
        return dict(_extreme(what, some) for what, some in details.items() if some is not None)
    except (LookupError, TypeError, ValueError, AttributeError):
        raise ValueError(f"not the extremes of a motion: {details!r}") from None


_UNITS = {
    "distance_m": "m",
    "speed_mps": "m/s",
    "turn_rate_radps": "rad/s",
    "torque_nm": "N m",
}


def _extreme(what: str, details: Mapping[str, Any]) -> tuple[str, str]:
    """A title, and value, whose and when."""
    (key,) = details.keys() - {"robot", "robots", "t_s"}
    value, at = details[key], f"at {details['t_s']:.3f} s"
    size = f"{value:.0f}" if 1e3 <= value < 1e6 else f"{value:.3g}"
    title = "top torque" if key == "torque_nm" else what.replace("_", " ")
    if "robots" in details:
        one, other = details["robots"]
        whose = f"robots {one} and {other}"
    else:
        whose = f"robot {details['robot']}"
    return title, f"{size} {_UNITS[key]} ({whose}, {at})"


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
