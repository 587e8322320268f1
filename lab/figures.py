"""Figures of a run: paths (Figs. 2, 4, 6 of the paper), headings (Figs. 5, 7), errors, graph."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from formation.scenario import Expect, Scenario
from lab import link_figures
from lab.canvas import COLOURS, around, blank, bowed, bows
from lab.lyapunov import Curve, equation, rises
from lab.lyapunov import curve as lyapunov_curve
from lab.recording import Collected, Trajectories
from lab.verdict import by_claim, error_series, tolerances_of, window_s
from plant.world import RUNAWAY

MOST_PLANNED = 30
"""How many entries of the plan the error figure spells out."""
HALF_IN = (6.4, 4.6)
"""The size (inches) of what stands beside another in the report."""
MOST_NAMED = 20
"""How many robots a legend names."""
_LABELS = {
    "formation": "formation, Eq. 3 (m)", "heading": "heading, Eq. 4 (rad)",
    "centroid": "centroid, Eq. 5 (m)",
}  # fmt: skip


def draw(recording: Collected, folder: Path) -> None:
    """Write every figure as PNG and SVG into ``folder``, and ``thumbnail.png``."""
    folder.mkdir(parents=True, exist_ok=True)
    scenario, trajectories = recording.scenario, recording.trajectories
    figures = {"graph": graph(scenario)} | link_figures.of(recording)
    if len(trajectories.t_s):
        figures |= {
            "paths": paths(recording),
            "headings": headings(scenario, trajectories),
            "errors": errors(recording),
        }
        found = lyapunov_curve(recording)
        if found is not None:
            figures["lyapunov"] = lyapunov(recording, found)
        thumbnail(scenario, trajectories).savefig(folder / "thumbnail.png", dpi=100)
    for name, figure in figures.items():
        for kind in ("png", "svg"):
            figure.savefig(folder / f"{name}.{kind}", dpi=130)
            figure.set_layout_engine("none")  # it is laid out now, which takes as long as drawing


def before_runaway(trajectories: Trajectories) -> Trajectories:
    """What is within sight: up to where a robot is faster than any is, or where all ends."""
    fastest = np.abs(trajectories.states[..., 3:]).max(axis=(1, 2))
    wild = np.flatnonzero(~(fastest < RUNAWAY))  # also where it is NaN
    return trajectories.first(max(1, wild[0]) if len(wild) else len(fastest))


def paths(recording: Collected) -> Figure:
    """The whole paths, and where the robots end beside the desired pattern."""
    scenario, whole_run = recording.scenario, recording.trajectories
    trajectories = before_runaway(whole_run)
    up = recording.up_at(int(trajectories.t_ns[-1]))
    figure = blank(11.0, 5.2)
    whole, end = figure.subplots(1, 2)
    positions, offsets = trajectories.positions_m, scenario.offsets_m
    for i, robot in enumerate(scenario.ids):
        colour = COLOURS[i % len(COLOURS)]
        xy = positions[:, i]
        whole.plot(xy[:, 0], xy[:, 1], color=colour, lw=1.0, label=f"robot {robot}")
        whole.plot(*xy[0], "o", color=colour, mfc="white", ms=6)
        whole.plot(*xy[-1], "o", color=colour, ms=5)
    whole.set_title(f"paths  (○ start, ● end){_left_out(trajectories, whole_run)}")
    if len(scenario.ids) <= MOST_NAMED:
        whole.legend(loc="best", fontsize=8)
    order = around(offsets)
    _polygon(end, offsets[order], 6.0, "0.82", "desired pattern")
    final = positions[-1]
    here = [i for i in order if scenario.ids[i] in up]
    _polygon(end, final[here], 1.2, "0.15", "final positions")
    for i, robot in enumerate(scenario.ids):
        heading = trajectories.headings_rad[-1, i]
        colour = COLOURS[i % len(COLOURS)]
        down = "" if robot in up else " (down)"
        end.plot(*final[i], "X" if down else "o", color=colour, ms=7)
        end.annotate(f"{robot}{down}", final[i], xytext=(6, 6), textcoords="offset points")
        end.quiver(*final[i], np.cos(heading), np.sin(heading), color=colour,
                   width=0.006, scale=14)  # fmt: skip
    end.margins(0.18)
    end.set_title(f"t = {trajectories.t_s[-1]:g} s")
    end.legend(loc="best", fontsize=8)
    for axes in (whole, end):
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("x (m)")
        axes.set_ylabel("y (m)")
    return figure


def _left_out(shown: Trajectories, whole_run: Trajectories) -> str:
    """Words for a title where a robot runs away."""
    if len(shown.t_s) == len(whole_run.t_s):
        return ""
    return f"\nto t = {shown.t_s[-1]:g} s, before a robot runs away"


def thumbnail(scenario: Scenario, whole_run: Trajectories) -> Figure:
    """The paths, and the robots at the end, small and without words."""
    trajectories = before_runaway(whole_run)
    figure = blank(2.2, 2.0)
    axes = figure.subplots()
    for i in range(len(scenario.ids)):
        xy, colour = trajectories.positions_m[:, i], COLOURS[i % len(COLOURS)]
        axes.plot(xy[:, 0], xy[:, 1], color=colour, lw=1.0)
        axes.plot(*xy[-1], "o", color=colour, ms=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_axis_off()
    return figure


def headings(scenario: Scenario, whole_run: Trajectories) -> Figure:
    """Headings over time, and their gap to the first robot's, where agreement shows."""
    trajectories = before_runaway(whole_run)
    mark = _mark_of(trajectories.t_s)
    figure = blank(*HALF_IN)
    upper, lower = figure.subplots(2, 1, sharex=True)
    reference = trajectories.headings_rad[:, 0]
    for i, robot in enumerate(scenario.ids):
        colour = COLOURS[i % len(COLOURS)]
        heading = trajectories.headings_rad[:, i]
        upper.plot(trajectories.t_s, heading, mark, color=colour, lw=1.2, label=f"robot {robot}")
        lower.plot(trajectories.t_s, heading - reference, mark, color=colour, lw=1.2)
    if left_out := _left_out(trajectories, whole_run):
        upper.set_title(left_out.strip(), fontsize=9)
    upper.set_ylabel("heading θ (rad)")
    lower.set_ylabel(f"θ − θ of robot {scenario.ids[0]} (rad)")
    lower.set_xlabel("t (s)")
    if len(scenario.ids) <= MOST_NAMED:
        upper.legend(loc="best", fontsize=8, ncols=2)
    return figure


def errors(recording: Collected) -> Figure:
    """The errors of Eqs. 3-5 on a log axis, with tolerances and the stretch that is judged.

    Those of the robots that are up at the end, as in the verdict.
    """
    scenario, trajectories = recording.scenario, recording.trajectories
    judged = recording.up_at(int(trajectories.t_ns[-1]))
    figure = blank(9.0, 4.6)
    axes = figure.subplots()
    tolerances = tolerances_of(scenario.expect or Expect())
    mark = _mark_of(trajectories.t_s)
    for (claim, series), colour in zip(
        by_claim(error_series(scenario, trajectories, judged)).items(), COLOURS, strict=False
    ):
        axes.semilogy(
            trajectories.t_s, np.maximum(series, 1e-16), mark, color=colour, label=_LABELS[claim]
        )
        axes.axhline(tolerances[claim], color=colour, ls=":", lw=1.0)
    end = trajectories.t_s[-1]
    axes.axvspan(max(0.0, end - window_s(scenario)), end, color="0.9", zorder=0, label="judged")
    _mark_plan(axes, scenario, end)
    axes.set_xlabel("t (s)")
    axes.set_ylabel("error  (dotted: tolerance)")
    axes.set_xlim(0.0, end or 1.0)
    axes.legend(loc="upper right", fontsize=8)
    return figure


def lyapunov(recording: Collected, found: Curve) -> Figure:
    """V on a log axis, with the stretches in which it gains more than its budget."""
    scenario = recording.scenario
    figure = blank(*HALF_IN)
    axes = figure.subplots()
    v = np.where(found.v > 0.0, found.v, np.nan)  # nobody is up
    heard = np.argmax(found.whole) if found.whole.any() else len(found.v)
    axes.semilogy(found.t_s[: heard + 1], v[: heard + 1], ls=":", color=COLOURS[0],
                  label="V before all neighbours were heard")  # fmt: skip
    axes.semilogy(found.t_s[heard:], v[heard:], color=COLOURS[0],
                  label=f"V, Eq. {equation(scenario)}")  # fmt: skip
    budget = np.where(np.isfinite(found.budget) & (found.budget > 0), found.budget, np.nan)
    axes.semilogy(found.t_s, budget, color="0.6", lw=0.9,
                  label="what it may gain a broadcast period")  # fmt: skip
    for number, rise in enumerate(rises(recording, found)):
        axes.axvspan(rise.begin_s, rise.end_s, color=COLOURS[1], alpha=0.35, lw=1.0, zorder=0,
                     label="V gains more" if number == 0 else None)  # fmt: skip
    _mark_plan(axes, scenario, found.t_s[-1])
    axes.set_xlabel("t (s)")
    axes.set_ylabel("V")
    axes.set_xlim(0.0, found.t_s[-1])
    axes.legend(loc="best", fontsize=8)
    return figure


def _mark_plan(axes: Axes, scenario: Scenario, end_s: float) -> None:
    """Number what happens on the time axis, and say below what it is."""
    entries = [entry for entry in scenario.plan if entry.at_s <= end_s]
    if not entries:
        return
    marks: dict[float, list[int]] = {}
    for number, entry in enumerate(entries, start=1):
        marks.setdefault(entry.at_s, []).append(number)
    before_s, row = -end_s, 0
    for at_s, numbers in sorted(marks.items()):
        row = (row + 1) % 3 if at_s - before_s < 0.03 * end_s else 0  # side by side: one above
        before_s = at_s
        axes.axvline(at_s, color="0.45", lw=0.8, ls="--", zorder=0)
        axes.annotate(",".join(map(str, numbers)), (at_s, 1.0), xycoords=("data", "axes fraction"),
                      xytext=(0, 3 + 8 * row), textcoords="offset points", ha="center",
                      fontsize=7)  # fmt: skip
    lines = [f"{k}  {entry.at_s:g} s: {entry.what}" for k, entry in enumerate(entries, start=1)]
    if len(lines) > MOST_PLANNED:
        more = len(lines) - MOST_PLANNED
        lines = [*lines[:MOST_PLANNED], f"and {more} more (formnet check shows all)"]
    figure = axes.figure
    assert isinstance(figure, Figure)
    figure.set_size_inches(figure.get_figwidth(), figure.get_figheight() + 0.17 * len(lines))
    longest = int(14.4 * figure.get_figwidth())
    figure.supxlabel("\n".join(_shortened(line, longest) for line in lines),
                     x=0.02, ha="left", fontsize=7.5)  # fmt: skip


def _shortened(line: str, longest: int) -> str:
    return line if len(line) <= longest else line[: longest - 1] + "…"


def graph(scenario: Scenario) -> Figure:
    """The communication graph, robots at their places in the pattern; damped robots marked."""
    figure = blank(5.2, 5.2)
    axes = figure.subplots()
    weights = scenario.formation.weights
    column = {robot: k for k, robot in enumerate(scenario.ids)}
    edges = [(column[a], column[b]) for a, b in weights]
    alike = len(set(weights.values())) <= 1
    for edge, bow, weight in zip(
        edges, bows(scenario.offsets_m, edges), weights.values(), strict=True
    ):
        line = bowed(scenario.offsets_m[list(edge)], bow, np.linspace(0.0, 1.0, 41))
        axes.plot(line[:, 0], line[:, 1], color="0.6", lw=1.5, zorder=1)
        if not alike:
            axes.annotate(f"{weight:g}", line[20], fontsize=8, color="0.35",
                          ha="center", va="center",
                          bbox={"fc": "white", "ec": "none", "pad": 1})  # fmt: skip
    for i, (robot, offset) in enumerate(zip(scenario.ids, scenario.offsets_m, strict=True)):
        damping = scenario.vehicles[robot].damping
        axes.plot(*offset, "o", ms=22, color=COLOURS[i % len(COLOURS)],
                  mec="black" if damping > 0 else "none", mew=2.0, zorder=2)  # fmt: skip
        axes.annotate(str(robot), offset, color="white", ha="center", va="center", zorder=3)
        if damping > 0:
            axes.annotate(f"μ = {damping:g}", offset, xytext=(0, -24), textcoords="offset points",
                          ha="center", fontsize=8,
                          bbox={"fc": "white", "ec": "none", "pad": 0.5})  # fmt: skip
    axes.margins(0.2)
    axes.set_aspect("equal", adjustable="datalim")
    said = f"b = {next(iter(weights.values())):g}" if alike and weights else "b on the edges"
    axes.set_title(f"communication graph, {said}")
    axes.set_xlabel("p_x (m)")
    axes.set_ylabel("p_y (m)")
    return figure


def _mark_of(t_s: NDArray[np.float64]) -> str:
    """A line, or a point where there is but one instant."""
    return "-" if len(t_s) > 1 else "o"


def _polygon(
    axes: Axes, points: NDArray[np.float64], width: float, colour: str, label: str
) -> None:
    axes.plot(points[:, 0], points[:, 1], color=colour, lw=width, label=label, zorder=0)
