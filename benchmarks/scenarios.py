"""The scenarios that are timed: the paper's with delay, cut short, and rings of any size."""

import math
from pathlib import Path

from formnet.formation.scenario.loading import load, loads
from formnet.formation.scenario.model import Scenario

SECTION5 = Path(__file__).parent.parent / "configs" / "paper" / "section5-delay.toml"

_PERIOD_S = 0.001
_SPACING_M = 2.5
_RING = """\
name = "ring-{robots}"
seed = 1
duration_s = {duration_s}

[clock]
mode = "lockstep"
control_period_s = 0.001
broadcast_period_s = 0.01

[formation]
edges = {edges}
coupling = 0.5

[law]
kind = "cooperative"
level = "dynamic"
beta = 10.0
w1 = {{ bias = 0.5, amplitude = 0.0, frequency_radps = 0.0 }}
feedback_gain = 10.0
feedback_shape = "inertia"
gamma = 0.1
boundary_layer = 1e8
length_scale_m = 100.0

[network.default]
delay = {{ distribution = "constant", mean_s = 0.1 }}

[robot_defaults]
mass_estimate_kg = 2.0
inertia_estimate_kgm2 = 2.0
"""
_ROBOT = """
[[robots]]
id = {robot}
offset_m = [{x_m:.6f}, {y_m:.6f}]
start = {{ x_m = {start_x_m:.6f}, y_m = {start_y_m:.6f}, heading_rad = {heading_rad:.6f} }}
"""


def section5(ticks: int) -> Scenario:
    """Five robots as in Section 5 with delays, ``ticks`` control periods of 1 ms long."""
    return load(SECTION5, [f"duration_s={_duration_s(ticks)}"])


def ring_toml(robots: int, ticks: int) -> str:
    """``robots`` robots on a circle, each talking to two, starting close to their places.

    Law and delays are those of Section 5, with a coupling low enough for the
    short run timed here to stay finite at every size.
    """
    edges = [[robot, robot % robots + 1] for robot in range(1, robots + 1)]
    text = _RING.format(robots=robots, duration_s=_duration_s(ticks), edges=edges)
    return text + "".join(_robot_toml(robot, robots) for robot in range(1, robots + 1))


def ring(robots: int, ticks: int) -> Scenario:
    """:func:`ring_toml`, loaded."""
    return loads(ring_toml(robots, ticks), f"ring-{robots}")


def _robot_toml(robot: int, robots: int) -> str:
    angle_rad = 2 * math.pi * robot / robots
    radius_m = _SPACING_M * robots / (2 * math.pi)
    x_m, y_m = radius_m * math.cos(angle_rad), radius_m * math.sin(angle_rad)
    return _ROBOT.format(
        robot=robot,
        x_m=x_m,
        y_m=y_m,
        start_x_m=x_m + 0.1 * math.sin(3 * robot),
        start_y_m=y_m + 0.1 * math.cos(5 * robot),
        heading_rad=0.1 * math.sin(7 * robot),
    )


def _duration_s(ticks: int) -> float:
    return round(ticks * _PERIOD_S, 6)
