"""``formnet new``: a commented scenario to start from, with gains and periods that suit it."""

import re
from collections.abc import Iterator
from math import ceil, pi, sqrt
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from formnet.exact.exponentials import log
from formnet.exact.trigonometry import cos, hypot, sin
from formnet.formation.paper.graph import laplacian
from formnet.formation.scenario.expect import ERRORS, HEADING
from formnet.formation.scenario.loading import ScenarioError, loads
from formnet.formation.scenario.model import Scenario
from formnet.lab.forecast.stiffness import MARGIN, course, longest_period_s
from formnet.lab.runs import files
from formnet.lab.schemas import scenario as schema
from formnet.netem.files.csv_file import Numbers, first_of, read_numbers
from formnet.netem.files.problems import nearest
from formnet.netem.settings.links import LinkSettings
from formnet.netem.settings.presets import PRESETS

PERIODS_S = (0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002, 0.0001)
"""Control periods to choose from, the longest that is short enough; the first suits robots."""
BETA, EXCITATION_RADPS = 2.0, 0.5
SLOWEST_PER_S = 0.25
"""λ_min(L + diag μ) is brought above this; β λ_min > 1/4 follows."""
FARTHEST_M, NEAREST_M = 1e7, 1e-3
"""Bounds on the places of a file: from the origin on either axis, and from one another."""
MASS_KG, MASS_ESTIMATE_KG = 12.0, 15.0

Pair = tuple[float, float]
Edge = tuple[int, int]


class CannotWrite(ValueError):
    """The scenario cannot be made or written; the text says why."""


class Wish(NamedTuple):
    """What was asked for. ``pattern`` is a word of :data:`PATTERNS` or a CSV file."""

    name: str
    robots: int | None
    pattern: str
    graph: str
    network: str
    spacing_m: float | None
    seed: int
    mode: str


def write(wish: Wish, out: Path | None) -> Path:
    """Write the scenario and, if there is none beside it, the schema; returns where.

    Raises:
        CannotWrite: a wish that cannot be met, or a file that exists.
        OSError: ``filename`` cannot be written. Then nothing was.
    """
    text = scenario_text(wish)
    path = out or Path(f"{wish.name}.toml")
    try:
        files.write_new(path, text)
        try:
            schema.write_beside(path.parent)
        except OSError:
            path.unlink()
            raise
    except FileExistsError:
        raise CannotWrite(f"{path} exists already; nothing is overwritten") from None
    return path


def scenario_text(wish: Wish) -> str:
    """The scenario as TOML with comments. Raises CannotWrite."""
    offsets = _offsets(wish)
    edges = graph_edges(wish.graph, len(offsets), wish.seed)
    values = _values(wish, offsets, edges)
    for period_s in PERIODS_S:
        text = _aligned(_TEMPLATE.format(control_period_s=period_s, **values))
        if period_s <= MARGIN * longest_period_s(course(_valid(text))):
            return text
    raise CannotWrite("no control period is short enough for this pattern and graph")


def _valid(text: str) -> Scenario:
    try:
        return loads(text)
    except ScenarioError as error:
        raise CannotWrite("\n".join(map(str, error.problems))) from None


# --- the pattern -------------------------------------------------------------------------


def _circle(robots: int) -> list[Pair]:
    radius = 0.5 / sin(pi / robots)
    angles = (2.0 * pi * k / robots for k in range(robots))
    return [(radius * cos(angle), radius * sin(angle)) for angle in angles]


def _line(robots: int) -> list[Pair]:
    return [(-float(k), 0.0) for k in range(robots)]


def _wedge(robots: int) -> list[Pair]:
    """The first at the tip, the others behind it in turn on its left and its right."""
    rows = (((k + 1) // 2) * sqrt(0.5) for k in range(robots))
    return [(-row, row if k % 2 else -row) for k, row in enumerate(rows)]


def _grid(robots: int) -> list[Pair]:
    columns = ceil(sqrt(robots))
    return [(-float(k // columns), -float(k % columns)) for k in range(robots)]


PATTERNS = {"circle": _circle, "line": _line, "wedge": _wedge, "grid": _grid}
"""Places at distances of 1 from the next."""


def _offsets(wish: Wish) -> list[Pair]:
    if wish.pattern in PATTERNS:
        spacing_m = 1.0 if wish.spacing_m is None else wish.spacing_m
        places = PATTERNS[wish.pattern](5 if wish.robots is None else wish.robots)
        x, y = (sum(axis) / len(places) for axis in zip(*places, strict=True))
        return [
            (round(spacing_m * (a - x), 4) + 0.0, round(spacing_m * (b - y), 4) + 0.0)  # no -0.0
            for a, b in places
        ]
    path = Path(wish.pattern)
    if not path.suffix and not path.exists():
        hint = nearest(wish.pattern, PATTERNS)
        raise CannotWrite(
            f"--pattern {wish.pattern}: neither a pattern ({', '.join(PATTERNS)}) nor a file{hint}"
        )
    if wish.spacing_m is not None:
        raise CannotWrite("--spacing: the places of a file have their own")
    try:
        found = read_numbers(path, 2)
    except ValueError as error:
        raise CannotWrite(f"--pattern: {error}") from None
    places = [(x, y) for x, y in found.rows]
    if wish.robots not in (None, len(places)):
        raise CannotWrite(f"--robots {wish.robots}: file {path} has places for {len(places)}")
    if len(places) < 2:
        raise CannotWrite(f"--pattern: file {path} has one place; a formation needs two")
    bad = [*_too_far(found), *_too_near(found)]
    if bad:
        raise CannotWrite(f"--pattern: {first_of(bad)}")
    return places


def _too_far(found: Numbers) -> Iterator[str]:
    for row, place in enumerate(found.rows):
        for column, value in enumerate(place):
            if abs(value) > FARTHEST_M:
                yield f"{found.place(row, column)} = {value}: must be within ±{FARTHEST_M:g} m"


def _too_near(found: Numbers) -> Iterator[str]:
    for row, (x, y) in enumerate(found.rows):
        for earlier, (a, b) in enumerate(found.rows[:row]):
            if hypot(x - a, y - b) < NEAREST_M:
                yield (
                    f"{found.place(row)} = {x}, {y}: robot {row + 1} must be at least "
                    f"{NEAREST_M:g} m from robot {earlier + 1} (line {found.lines[earlier]})"
                )
                break


# --- the graph ---------------------------------------------------------------------------


def graph_edges(graph: str, robots: int, seed: int) -> list[Edge]:
    """Edges of a connected graph of robots 1 to ``robots``, ascending.

    ``"random"`` is a random tree and, beside it, about one more edge for each robot.
    """
    if graph == "random":
        tree = nx.random_labeled_tree(robots, seed=seed)
        found = nx.compose(tree, nx.gnp_random_graph(robots, 2.0 / robots, seed=seed))
    else:
        makers = {"ring": nx.cycle_graph, "path": nx.path_graph, "complete": nx.complete_graph}
        found = nx.star_graph(robots - 1) if graph == "star" else makers[graph](robots)
    return sorted((min(edge) + 1, max(edge) + 1) for edge in found.edges)


def damped_robots(robots: int, edges: list[Edge], coupling: float) -> tuple[list[int], float]:
    """Who needs μ = 1 so that λ_min(L + diag μ) is above SLOWEST_PER_S, and what it then is.

    In turn the robot that lags most behind: the largest entry of the slowest eigenvector.
    """
    ids = range(1, robots + 1)
    matrix = laplacian(ids, dict.fromkeys(edges, coupling))
    damped: list[int] = []
    while True:
        slowest, vector = _slowest(matrix + np.diag([float(robot in damped) for robot in ids]))
        if slowest > SLOWEST_PER_S:
            return sorted(damped), slowest
        lag = {robot: abs(vector[robot - 1]) for robot in ids if robot not in damped}
        damped.append(max(lag, key=lambda robot: (round(lag[robot], 6), -robot)))


def _slowest(matrix: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    values, vectors = np.linalg.eigh(matrix)
    return float(values[0]), vectors[:, 0]


# --- gains, times, starts ----------------------------------------------------------------


def _values(wish: Wish, offsets: list[Pair], edges: list[Edge]) -> dict[str, Any]:
    """What the template needs, but for the control period."""
    robots = len(offsets)
    degree = max(sum(robot in edge for edge in edges) for robot in range(1, robots + 1))
    coupling = round(min(1.0, max(0.3, 4.0 / degree)), 2)
    damped, slowest = damped_robots(robots, edges, coupling)
    nearest_m = min(hypot(a[0] - b[0], a[1] - b[1]) for a in offsets for b in offsets if a != b)
    x, y = (sum(axis) / robots for axis in zip(*offsets, strict=True))
    reach_m = 1.5 * max(hypot(a - x, b - y) for a, b in offsets)
    tolerance_m = _digits(0.05 * nearest_m, 2)
    delay_s, network = _network(wish.network)
    # Errors decay as exp(−λ_min t), slower where neighbours are heard late.
    rate = min(slowest, 0.5 * BETA * EXCITATION_RADPS**2) / (1.0 + 4.0 * delay_s)
    settled_s = log(20.0 * robots * reach_m / tolerance_m) / rate
    scale_m = _digits(2.0 * reach_m, 2)
    spread = (MASS_ESTIMATE_KG - MASS_KG) * scale_m**2
    random = Random(f"formnet new, seed {wish.seed}")
    tables = [
        _robot(robot, offset, _start(random, (x, y), reach_m), damped=robot in damped)
        for robot, offset in enumerate(offsets, start=1)
    ]
    return {
        "schema": f"./{schema.FILE}",
        "name": wish.name,
        "seed": wish.seed,
        "mode": wish.mode,
        "robots": robots,
        "pattern": wish.pattern,
        "graph": wish.graph,
        "preset": wish.network,
        "duration_s": float(10 * ceil(settled_s / 9.0)),
        "coupling": coupling,
        "edges": ", ".join(f"[{a}, {b}]" for a, b in edges),
        "beta": BETA,
        "bias": EXCITATION_RADPS,
        "boundary_layer": f"{_digits(200.0 * spread, 1):.0e}",
        "scale_m": scale_m,
        "network": network,
        "mass_kg": MASS_KG,
        "mass_estimate_kg": MASS_ESTIMATE_KG,
        "tables": "\n".join(tables),
        "claims": "\n".join(
            f"{row.name} = true  # {row.reference}: {row.says}" for row in ERRORS.values()
        ),
        "tolerance_m": tolerance_m,
        "heading_tolerance_rad": HEADING.tolerance,
        "centroid_tolerance_m": _digits(4.0 * tolerance_m, 2),
    }


def _network(preset: str) -> tuple[float, str]:
    """The delay of half of the messages (s), and the table ``[network.default]``."""
    if preset not in PRESETS:
        hint = nearest(preset, PRESETS)
        raise CannotWrite(f"--network {preset}: no such preset ({', '.join(PRESETS)}){hint}")
    delay_s = LinkSettings.model_validate({"preset": preset}).delay.quantile_s(0.5)
    comment = "  # every message arrives, at once" if preset == "ideal" else ""
    return delay_s, f'preset = "{preset}"{comment}'


def _start(random: Random, centre: Pair, reach_m: float) -> tuple[float, float, float]:
    """Anywhere in a disc around the pattern, turned anyhow: x, y (m), heading (rad)."""
    distance, angle = reach_m * sqrt(random.random()), 2.0 * pi * random.random()
    heading = (2.0 * random.random() - 1.0) * pi
    return centre[0] + distance * cos(angle), centre[1] + distance * sin(angle), heading


def _robot(robot: int, offset: Pair, start: tuple[float, float, float], *, damped: bool) -> str:
    lines = [
        "[[robots]]",
        f"id = {robot}",
        f"offset_m = [{offset[0]!r}, {offset[1]!r}]",
        f"start = {{ x_m = {start[0]:.3f}, y_m = {start[1]:.3f}, heading_rad = {start[2]:.2f} }}",
        *(["damping = 1.0"] if damped else []),
    ]
    return "\n".join(lines) + "\n"


def _digits(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")


def _aligned(text: str) -> str:
    """With all comments that follow a value in one column."""
    return re.sub(r"(?m)^([^#\n].*?) +# ", lambda found: f"{found[1]:<{COMMENTS_AT}}  # ", text)


COMMENTS_AT = 36

_TEMPLATE = """\
#:schema {schema}
# {robots} robots, pattern {pattern}, graph {graph}, network {preset}; written by `formnet new`.
# `formnet check` says what the theory predicts, `formnet run` runs and judges it.
# Every key: docs/scenario.md; editors (Taplo, Even Better TOML) use the schema in the first line.
format = 2
name = "{name}"
seed = {seed}  # seed of all random numbers; same seed, same run
duration_s = {duration_s}

[clock]  # time and periods
mode = "{mode}"  # "lockstep": virtual time, exactly repeatable; or "realtime"
control_period_s = {control_period_s}  # a command is held for this long
broadcast_period_s = 0.05  # robots broadcast their states at this period

[formation]  # communication graph; edges are undirected
edges = [{edges}]
coupling = {coupling}  # b: weight of every edge

[law]  # the paper's law; `formnet laws` lists others
kind = "cooperative"
level = "dynamic"  # commands are wheel torques; "kinematic": velocities
beta = {beta}  # larger: lateral errors vanish faster; stiffer
w1 = {{ bias = {bias} }}  # rad/s; at the end all robots turn at this rate
feedback_gain = 3.0  # how fast velocities follow the desired ones
boundary_layer = {boundary_layer}  # epsilon; larger: softer robust term
gamma = 0.01  # decay rate of the boundary layer; large: stiff late in a run
length_scale_m = {scale_m}  # about the initial distance from the places

[network.default]  # every link, each direction separately (docs/netem.md)
{network}

# A link that is worse than the others:
# [[network.links]]
# from = 1
# to = 2
# loss = {{ model = "random", probability = 0.3 }}

# Planned events (docs/timeline.md, docs/faults.md):
# [[timeline]]
# at_s = 10.0
# action = "kill"
# robots = 2
# restart_after_s = 5.0

[neighbours]  # handling of received messages
on_silence = "drop"  # leave out silent neighbours; "hold": use their last states
silence_s = 0.5

[robot_defaults]  # a robot with two driven wheels; [[robots]] can override
mass_kg = {mass_kg}
inertia_kgm2 = 0.6
mass_estimate_kg = {mass_estimate_kg}  # what the controller assumes
inertia_estimate_kgm2 = 0.8
half_axle_m = 0.25
wheel_radius_m = 0.1

# offset_m: the place in the pattern. damping: pulls a robot to its own place, so that the
# centroid converges; only as many robots have it as the graph needs.
{tables}
[expect]  # what the run is judged by; optional
{claims}
formation_tolerance_m = {tolerance_m}
heading_tolerance_rad = {heading_tolerance_rad}
centroid_tolerance_m = {centroid_tolerance_m}
"""
