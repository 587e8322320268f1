"""The state of a robot, as the plant has it and as others hear of it."""

import math
from typing import NamedTuple


class State(NamedTuple):
    """Pose of the middle of the wheel axle, and velocity.

    Heading is unwrapped (it counts full turns), turn rate positive to the left.
    """

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    turn_rate_radps: float


def finite(state: State) -> bool:
    """Whether every component is finite."""
    return math.isfinite(sum(state)) or all(map(math.isfinite, state))  # a finite sum is the rule


class Stamped(NamedTuple):
    """A neighbour's state as it was at ``stamp_ns``."""

    robot: int
    stamp_ns: int
    state: State
