"""A scenario that has every numeric key of the format, and what may stand there that should not."""

import copy
import tomllib
from collections.abc import Iterator
from typing import Any

import tomli_w
from complete_links import COMPLETE

Place = tuple[str | int, ...]

TEXT = """
format = 2
name = "every-number"
seed = 3
duration_s = 30.0
clock = { control_period_s = 0.01, broadcast_period_s = 0.02, sync_bound_s = 0.01 }
formation = { edges = [[1, 2], [2, 3]], coupling = { "1-2" = 2.0, "2-3" = 0.5 } }
neighbours = { silence_s = 0.5 }
plant = { brake_time_s = 0.1, drive_timeout_s = 0.2 }
run = { patience_s = 5.0 }

[law]
beta = 2.0
w1 = { bias = 0.5, amplitude = 0.1, frequency_radps = 2.0 }
feedback_gain = 3.0
gamma = 0.1
boundary_layer = 1.0
length_scale_m = 2.0

[network.default]
playout_s = 0.5

[robot_defaults]
mass_kg = 12.0
inertia_kgm2 = 1.0
com_offset_m = 0.1
mass_estimate_kg = 11.0
inertia_estimate_kgm2 = 1.1
com_offset_estimate_m = 0.11
robust_bound = 1.0
half_axle_m = 0.25
wheel_radius_m = 0.1
wheel_torque_limit_nm = 5.0
linear_friction_nspm = 0.1
angular_friction_nmsprad = 0.1
disturbance_force_n = 0.1
disturbance_torque_nm = 0.1
damping = 0.5

[[network.links]]
from = 1
to = [2, 3]
delay = { distribution = "constant", mean_s = 0.1 }
loss = { model = "random", probability = 0.1, correlation = 0.5 }
duplicate = { probability = 0.1 }
corrupt = { probability = 0.1 }
reorder = { probability = 0.1, gap = 5 }
rate = { bits_per_s = 100000, overhead_bytes = 8, cell_bytes = 48, cell_overhead_bytes = 5 }
queue = { messages = 10, bytes = 1000 }
slots = { min_s = 0.001, max_s = 0.002, messages = 1, bytes = 1500 }

[[timeline]]
at_s = 1.0
action = "network"
links = [[1, 2]]
delay = { mean_s = 0.2 }
[[timeline]]
at_s = 2.0
action = "ramp"
links = [[1, 2]]
parameter = "delay.mean_s"
from_value = 0.1
to_value = 1.0
duration_s = 3.0
[[timeline]]
at_s = 3.0
action = "cut"
heal_after_s = 1.5
[[timeline]]
at_s = 5.0
action = "partition"
groups = [[1], [2, 3]]
heal_after_s = 1.0
[[timeline]]
at_s = 5.0
action = "partition"
shape = "isolate"
robot = 1
[[timeline]]
at_s = 5.5
action = "heal"
links = [[1, [2, 3]]]
[[timeline]]
at_s = 6.0
action = "kill"
robots = { random = 1 }
restart_after_s = 1.0
[[timeline]]
at_s = 9.0
action = "pause"
robots = [1, 2]
resume_after_s = 1.0

[[robots]]
id = 1
offset_m = [0.0, 1.5]
start = { x_m = 0.0, y_m = 1.0, heading_rad = -2.0 }
damping = 1.0
[[robots]]
id = 2
offset_m = [1.0, 0.0]
start = { x_m = 0.0, y_m = 1.0 }
[[robots]]
id = 3
offset_m = [2.0, 0.0]
start = { x_m = 0.0, y_m = 1.0 }

[expect]
formation = true
formation_tolerance_m = 0.1
heading_tolerance_rad = 0.1
centroid_tolerance_m = 0.1
window_s = 1.0
"""
ODD = (
    1e300,
    -1e300,
    1e-300,
    5e-324,
    2**63,
    -(2**63),
    float("nan"),
    float("inf"),
    -float("inf"),
    0,
    -0.0,
    10**400,
)
"""TOML knows nan and inf; what is whole may be of any length."""


def bases() -> Iterator[dict[str, Any]]:
    """Scenarios that together have every numeric key, in tables of every kind."""
    yield tomllib.loads(TEXT)
    yield tomllib.loads(TEXT) | {"formation": {"edges": [[1, 2], [2, 3]], "coupling": 2.0}}
    for key in ("delay", "loss"):
        for table in COMPLETE[key]:
            base = tomllib.loads(TEXT)
            base["timeline"] = []
            base["network"] = {"default": {key: table}}
            yield base


def numbers(node: Any, place: Place = ()) -> Iterator[Place]:
    """Where in a file a number stands."""
    if isinstance(node, dict | list):
        for key, value in node.items() if isinstance(node, dict) else enumerate(node):
            yield from numbers(value, (*place, key))
    elif isinstance(node, int | float) and not isinstance(node, bool):
        yield place


def odd_texts() -> Iterator[tuple[Place, object, str]]:
    """Every number of every base in turn replaced by every odd one: where, which, the text."""
    seen: set[tuple[Place, str]] = set()
    for base in bases():
        for place in numbers(base):
            changed = copy.deepcopy(base)
            table = changed
            for part in place[:-1]:
                table = table[part]
            kind = str(
                {key: value for key, value in table.items() if isinstance(value, str)}
                if isinstance(table, dict)
                else ""
            )
            if (place, kind) in seen:
                continue
            seen.add((place, kind))
            for odd in ODD:
                table[place[-1]] = "ODD"
                # Not tomli_w's business: it writes whole numbers of some length alone.
                text = tomli_w.dumps(changed).replace('"ODD"', _written(odd))
                yield place, odd, text


def _written(number: object) -> str:
    if isinstance(number, int) and number >= 10**400:
        return "1" + 400 * "0"
    return repr(number)
