"""``graph.png``: the communication graph, and what befell robots and links in the run."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from formnet.formation.plan.roster import Span
from formnet.formation.scenario.model import Scenario
from formnet.lab.figures import presence
from formnet.lab.figures.canvas import blank, colours, curves
from formnet.lab.figures.links import stretches
from formnet.lab.figures.plotting import Axes, Figure, Line2D
from formnet.lab.runs.recording import Collected

_SIDE_IN = 5.2
_FIELD_PT = 300.0
"""How many points the greater side of the axes has, about."""
_MARGIN = 0.25
_CUT = "#C1121F"
_DOWN = "0.72"


class Cuts(NamedTuple):
    """The directions of an edge, as pairs of ids, that were cut at the end and that were healed."""

    at_the_end: list[tuple[int, int]]
    healed: list[tuple[int, int]]


def graph(recording: Collected) -> Figure:
    """The graph, robots at their places in the pattern, with damping and weights.

    Marked are robots that were down and links that were cut, up to the end of the run.
    """
    scenario = recording.scenario
    figure = blank(_SIDE_IN, _SIDE_IN)
    axes = figure.subplots()
    axes.margins(_MARGIN)
    column = {robot: k for k, robot in enumerate(scenario.ids)}
    edges = [(column[a], column[b]) for a, b in scenario.formation.edges]
    lines = curves(scenario.offsets_m, edges)
    legend = _draw_robots(axes, recording, lines)
    legend |= _draw_edges(axes, scenario, lines, _end_ns(recording))
    axes.set_aspect("equal", adjustable="datalim")
    weights = list(scenario.formation.weights.values())
    alike = len(set(weights)) == 1
    axes.set_title(
        f"communication graph, b = {weights[0]:g}"
        if alike
        else "communication graph, b on the edges"
    )
    axes.set_xlabel("p_x (m)")
    axes.set_ylabel("p_y (m)")
    if legend:
        figure.set_size_inches(_SIDE_IN, _SIDE_IN + 0.1 + 0.19 * len(legend))
        figure.legend(
            list(legend.values()),
            list(legend),
            loc="outside lower center",
            ncols=1,
            fontsize=8,
            handlelength=3.0,
        )
    return figure


def cuts(scenario: Scenario, edge: tuple[int, int], end_ns: int) -> Cuts:
    """What was cut of an edge (a pair of ids) before ``end_ns``."""
    found = Cuts([], [])
    for link in (edge, edge[::-1]):
        states = [part.is_cut for part in stretches(scenario, *link) if part.begin_ns < end_ns]
        if any(states):
            (found.at_the_end if states[-1] else found.healed).append(link)
    return found


def _end_ns(recording: Collected) -> int:
    """When the run ended or, if nobody knows, the time of the newest sample."""
    return recording.now_ns() if recording.outcome is None else recording.outcome.t_ns


def _draw_edges(
    axes: Axes, scenario: Scenario, lines: NDArray[np.float64], end_ns: int
) -> dict[str, Line2D]:
    """The edges (n, 41, 2); what a legend says of them, by label."""
    legend: dict[str, Line2D] = {}
    weights = scenario.formation.weights
    alike = len(set(weights.values())) <= 1
    for (edge, weight), line in zip(weights.items(), lines, strict=True):
        found = cuts(scenario, edge, end_ns)
        some = found.at_the_end or found.healed
        colour = _CUT if found.at_the_end else "0.6"
        (drawn,) = axes.plot(
            line[:, 0], line[:, 1], color=colour, ls="--" if some else "-", lw=1.5, zorder=1
        )
        if some:
            what = "cut at the end" if found.at_the_end else "was cut, and healed"
            legend.setdefault(f"link {what}", drawn)
        if len(some) == 1:  # one way
            way = line if some[0] == edge else line[::-1]
            axes.annotate(
                "",
                way[28],
                way[26],
                zorder=1.5,
                arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.5, "mutation_scale": 14},
            )
            legend["arrow: cut this way only"] = Line2D([], [], color=colour, marker=">", ls="--")
        if not alike:
            axes.annotate(
                f"{weight:g}",
                line[20],
                fontsize=8,
                color="0.35",
                ha="center",
                va="center",
                bbox={"fc": "white", "ec": "none", "pad": 1},
            )
    return legend


def _draw_robots(axes: Axes, recording: Collected, lines: NDArray[np.float64]) -> dict[str, Line2D]:
    """The robots; what a legend says of them, by label."""
    scenario = recording.scenario
    offsets = scenario.offsets_m
    points_per_m = _points_per_m(offsets)
    size_pt = _size_pt(offsets, points_per_m)
    roster = recording.roster()
    last = _end_ns(recording) // scenario.clock.control_period_ns
    dampings = {vehicle.damping for vehicle in scenario.vehicles.values()} - {0.0}
    down: list[Span] = []  # that last to the end, and the others
    over: list[Span] = []
    for i, (robot, colour) in enumerate(zip(scenario.ids, colours(len(offsets)), strict=True)):
        falls = list(presence.spans(roster, robot, 0, last))
        is_down = bool(falls) and falls[-1].end > last
        damping = scenario.vehicles[robot].damping
        axes.plot(
            *offsets[i],
            "o",
            ms=size_pt,
            color=_DOWN if is_down else colour,
            mec="black" if damping > 0 else "none",
            mew=2.0,
            zorder=2,
        )
        axes.annotate(
            str(robot),
            offsets[i],
            color="black" if is_down else "white",
            ha="center",
            va="center",
            fontsize=min(10.0, 0.5 * size_pt),
            zorder=3,
        )
        if damping > 0.0 and len(dampings) > 1:
            room_pt = (1.4 if falls else 1.0) * size_pt
            _beside(axes, i, offsets, lines, f"μ = {damping:g}", size_pt, room_pt, points_per_m)
        if falls:
            if is_down:
                down.append(falls[-1])
            else:
                over.extend(falls)
            axes.plot(*offsets[i], "x", ms=1.3 * size_pt, color="black", mew=1.8, zorder=1.9)
    said = f"= {next(iter(dampings)):g}" if len(dampings) == 1 else "> 0"
    legend = {f"damped: μ {said}": _node("white", "black")} if dampings else {}
    if down:
        legend[f"grey, crossed out: {_befell(down)}, and down at the end"] = _node(_DOWN, "none")
    if over:
        legend[f"crossed out: {_befell(over)}, and up again at the end"] = Line2D(
            [], [], color="black", marker="x", ms=11, mew=1.6, ls=""
        )
    return legend


def _node(face: str, rim: str) -> Line2D:
    return Line2D([], [], color=face, marker="o", ms=11, mec=rim, mew=1.6, ls="")


def _befell(falls: list[Span]) -> str:
    """What befell robots, in words."""
    kinds = {"lost" if fall.lost else "killed" if fall.killed else "paused" for fall in falls}
    return " or ".join(sorted(kinds))


def _points_per_m(offsets: NDArray[np.float64]) -> float:
    """How large a metre is drawn, about."""
    extent_m = float(np.ptp(offsets, axis=0).max())
    return _FIELD_PT / ((1.0 + 2.0 * _MARGIN) * extent_m) if extent_m > 0.0 else 1.0


def _size_pt(offsets: NDArray[np.float64], points_per_m: float) -> float:
    """The diameter of a robot: no two touch, if they are not at one place."""
    gaps = np.linalg.norm(offsets[:, None] - offsets, axis=-1)
    nearest_m = gaps[gaps > 0.0].min(initial=np.inf)
    return float(np.clip(0.8 * nearest_m * points_per_m, 7.0, 22.0))


def _beside(
    axes: Axes,
    i: int,
    offsets: NDArray[np.float64],
    lines: NDArray[np.float64],
    text: str,
    size_pt: float,
    room_pt: float,
    points_per_m: float,
) -> None:
    """Write beside robot ``i``, which takes ``room_pt``, where there is most room.

    Of eight directions that in which the letters' box is farthest from other robots and, where
    these are far, from edges.
    """
    half_pt = np.array([2.4 * len(text), 4.0])
    angles = np.arange(8) * np.pi / 4.0
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    aside_pt = ways * (0.5 * room_pt + half_pt + np.array([3.0, 7.0]))

    def least_pt(points: NDArray[np.float64]) -> NDArray[np.float64]:
        """How near the box comes to points (n, 2), in each direction."""
        gaps = np.abs(aside_pt - (points - offsets[i])[:, None] * points_per_m) - half_pt
        found: NDArray[np.float64] = np.linalg.norm(np.maximum(gaps, 0.0), axis=-1)
        return found.min(axis=0, initial=np.inf)  # type: ignore[no-any-return]

    robots_pt = least_pt(np.delete(offsets, i, axis=0)) - 0.5 * size_pt
    best = int(np.argmax(np.minimum(robots_pt, 6.0 + least_pt(lines.reshape(-1, 2)))))
    right_pt, up_pt = aside_pt[best]
    axes.annotate(
        text,
        (offsets[i, 0], offsets[i, 1]),
        xytext=(right_pt, up_pt),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=8,
        zorder=3,
    )
