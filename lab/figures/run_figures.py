"""Figures of a run: draws all, and has the paths (Figs. 2, 4, 6 of the paper), errors and V."""

import pkgutil
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from formnet.formation.scenario.expect import Expect
from formnet.formation.scenario.model import Scenario
from formnet.lab import figures as rooms
from formnet.lab.figures import links as link_figures
from formnet.lab.figures.canvas import (
    COLOURS,
    HALF_IN,
    MOST_NAMED,
    blank,
    colours,
    curves,
    dashes,
    line_or_point,
    plain_style,
    save,
)
from formnet.lab.figures.graph import graph
from formnet.lab.figures.headings import headings
from formnet.lab.figures.plotting import Axes, Figure, LineCollection
from formnet.lab.judge import claim_words
from formnet.lab.judge.errors import by_claim, error_series, window_s
from formnet.lab.judge.lyapunov import Curves, equation
from formnet.lab.judge.lyapunov import curves as lyapunov_curves
from formnet.lab.judge.rises import rises, standing_causes
from formnet.lab.runs.recording import Collected, Trajectories
from formnet.plant.world import RUNAWAY

MOST_PLANNED = 30
"""How many entries of the plan the error figure spells out."""
LARGEST = 1e100
"""What is farther away or faster, matplotlib may be unable to draw: its square overflows."""


def draw(
    recording: Collected, folder: Path, stopped: Callable[[], bool] = lambda: False
) -> list[str]:
    """Write every figure as PNG and SVG into ``folder``, which is there, and ``thumbnail.png``.

    Once ``stopped`` says so, those that are left are not drawn. Returns the names of those that
    cannot be drawn, as states or places are beyond LARGEST.

    Raises:
        OSError: a figure cannot be written.
    """
    left_out = []
    for name, make in _figures(recording):
        if stopped():
            break
        try:
            _draw_one(name, make, folder)
        except (ValueError, ArithmeticError):
            if not _immense(recording):
                raise
            left_out.append(name)
    return left_out


def _draw_one(name: str, make: Callable[[], Figure | None], folder: Path) -> None:
    with plain_style(), np.errstate(all="ignore"):  # what runs away overflows
        figure = make()
        if figure is None:
            return
        if name == "thumbnail":
            save(figure, folder, name, kinds=("png",), dpi=100)
        else:
            save(figure, folder, name)


def _immense(recording: Collected) -> bool:
    """Whether a state, or a robot's place in the pattern, is beyond LARGEST."""
    states = recording.trajectories.states
    immense = (np.isfinite(states) & (np.abs(states) > LARGEST)).any()
    return bool(immense) or bool((np.abs(recording.scenario.offsets_m) > LARGEST).any())


def _figures(recording: Collected) -> Iterator[tuple[str, Callable[[], Figure | None]]]:
    """Each figure by its name; last those of modules that have ``FIGURES`` (see `lab.figures`)."""
    scenario, trajectories = recording.scenario, recording.trajectories
    if len(trajectories.t_s):
        yield "thumbnail", partial(thumbnail, scenario, trajectories)
        yield "paths", partial(paths, recording)
        yield "headings", partial(headings, recording, before_runaway(trajectories))
        yield "errors", partial(errors, recording)
        found = lyapunov_curves(recording)
        if found is not None:
            yield "lyapunov", partial(lyapunov, recording, found)
    yield "graph", partial(graph, recording)
    yield from link_figures.of(recording).items()
    for module in pkgutil.iter_modules(rooms.__path__):
        others = getattr(import_module(f"{rooms.__name__}.{module.name}"), "FIGURES", {})
        for name, make in sorted(others.items()):
            yield name, partial(make, recording)


def before_runaway(trajectories: Trajectories) -> Trajectories:
    """What is within sight: up to where a robot is faster than any is, or where all ends."""
    fastest = np.abs(trajectories.states[..., 3:]).max(axis=(1, 2))
    wild = np.flatnonzero(~(fastest < RUNAWAY))  # also where it is NaN
    return trajectories.first(max(1, wild[0]) if len(wild) else len(fastest))


def paths(recording: Collected) -> Figure:
    """The whole paths, and where the robots end beside the desired pattern.

    The pattern is its places and the edges of the communication graph between them; so are the
    final positions of the robots that are up.
    """
    scenario, whole_run = recording.scenario, recording.trajectories
    trajectories = before_runaway(whole_run)
    up = recording.up_at(int(trajectories.t_ns[-1]))
    figure = blank(11.0, 5.2)
    whole, end = figure.subplots(1, 2)
    positions, offsets = trajectories.positions_m, scenario.offsets_m
    count = len(scenario.ids)
    own = colours(count)
    for i, (robot, colour, dash) in enumerate(zip(scenario.ids, own, dashes(count), strict=True)):
        xy = positions[:, i]
        whole.plot(xy[:, 0], xy[:, 1], color=colour, ls=dash, lw=1.0, label=f"robot {robot}")
        whole.plot(*xy[0], "o", color=colour, mfc="white", ms=6)
        whole.plot(*xy[-1], "o", color=colour, ms=5)
    whole.set_title(f"paths  (○ start, ● end){_left_out(trajectories, whole_run)}")
    if count <= len(COLOURS):
        whole.legend(loc="best", fontsize=8)
    elif count <= MOST_NAMED:  # there is no room for it among the paths
        handles, labels = whole.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside left center", fontsize=8, handlelength=3.0)
    column = {robot: k for k, robot in enumerate(scenario.ids)}
    edges = [(column[a], column[b]) for a, b in scenario.formation.edges]
    broad = 6.0 if len(edges) <= 2 * count and count <= MOST_NAMED else 3.0  # few, or a tangle
    _pattern(end, offsets, edges, broad, "0.82", "desired pattern")
    end.plot(offsets[:, 0], offsets[:, 1], "o", color="0.82", ms=13, zorder=0)
    final = positions[-1]
    both_up = [(i, j) for i, j in edges if scenario.ids[i] in up and scenario.ids[j] in up]
    _pattern(end, final, both_up, 1.2, "0.15", "final positions")
    for i, (robot, colour) in enumerate(zip(scenario.ids, own, strict=True)):
        heading = trajectories.headings_rad[-1, i]
        down = "" if robot in up else " (down)"
        end.plot(*final[i], "X" if down else "o", color=colour, ms=7)
        end.annotate(f"{robot}{down}", final[i], xytext=(6, 6), textcoords="offset points")
        end.quiver(*final[i], np.cos(heading), np.sin(heading), color=colour, width=0.006, scale=14)
    end.margins(0.18)
    end.set_title(f"t = {trajectories.t_s[-1]:g} s")
    if edges:
        end.legend(loc="best", fontsize=8)
    for axes in (whole, end):
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("x (m)")
        axes.set_ylabel("y (m)")
    return figure


def _pattern(
    axes: Axes,
    points: NDArray[np.float64],
    edges: list[tuple[int, int]],
    width: float,
    colour: str,
    label: str,
) -> None:
    """The graph's edges between points (n, 2)."""
    lines = list(curves(points, edges))
    axes.add_collection(
        LineCollection(lines, linewidths=width, colors=colour, label=label, zorder=0)
    )


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
    for i, colour in enumerate(colours(len(scenario.ids))):
        xy = trajectories.positions_m[:, i]
        axes.plot(xy[:, 0], xy[:, 1], color=colour, lw=1.0)
        axes.plot(*xy[-1], "o", color=colour, ms=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_axis_off()
    return figure


def errors(recording: Collected) -> Figure:
    """The three errors on a log axis, with tolerances and the stretch that is judged.

    Those of the robots that are up at the end, as in the verdict.
    """
    scenario, trajectories = recording.scenario, recording.trajectories
    judged = recording.up_at(int(trajectories.t_ns[-1]))
    figure = blank(9.0, 4.6)
    axes = figure.subplots()
    tolerances = (scenario.expect or Expect()).tolerances
    mark = line_or_point(trajectories.t_s)
    labels = claim_words.labels(scenario)
    for (claim, series), colour in zip(
        by_claim(error_series(scenario, trajectories, judged)).items(), COLOURS, strict=False
    ):
        axes.semilogy(
            trajectories.t_s, np.maximum(series, 1e-16), mark, color=colour, label=labels[claim]
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


def lyapunov(recording: Collected, both: Curves) -> Figure:
    """V and V* on a log axis, with the stretches in which they gain more than their budgets."""
    scenario, found, star = recording.scenario, both.v, both.star
    figure = blank(*HALF_IN)
    axes = figure.subplots()
    v = np.where(found.v > 0.0, found.v, np.nan)  # nobody is up
    heard = np.argmax(found.whole) if found.whole.any() else len(found.v)
    axes.semilogy(
        found.t_s[: heard + 1],
        v[: heard + 1],
        ls=":",
        color=COLOURS[0],
        label="V before all neighbours were heard",
    )
    axes.semilogy(
        found.t_s[heard:], v[heard:], color=COLOURS[0], label=f"V, Eq. {equation(scenario)}"
    )
    if star is not None:
        axes.semilogy(
            star.t_s,
            np.where(star.v > 0.0, star.v, np.nan),
            ls="--",
            color=COLOURS[2],
            label="V* = V + ζ2ᵀN⁻¹ζ2/(2β)",
        )
    budget = np.where(np.isfinite(found.budget) & (found.budget > 0), found.budget, np.nan)
    axes.semilogy(
        found.t_s, budget, color="0.6", lw=0.9, label="what V may gain a broadcast period"
    )
    shaded = [(found, "V", COLOURS[1], False)]
    if star is not None:
        shaded.append((star, "V*", COLOURS[2], True))
    for curve, name, colour, is_star in shaded:
        causes = standing_causes(scenario, star=is_star)
        for number, rise in enumerate(rises(recording, curve, causes)):
            axes.axvspan(
                rise.begin_s,
                rise.end_s,
                color=colour,
                alpha=0.35,
                lw=1.0,
                zorder=0,
                label=f"{name} gains more" if number == 0 else None,
            )
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
        axes.annotate(
            ",".join(map(str, numbers)),
            (at_s, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 3 + 8 * row),
            textcoords="offset points",
            ha="center",
            fontsize=7,
        )
    lines = [f"{k}  {entry.at_s:g} s: {entry.what}" for k, entry in enumerate(entries, start=1)]
    if len(lines) > MOST_PLANNED:
        more = len(lines) - MOST_PLANNED
        lines = [*lines[:MOST_PLANNED], f"and {more} more (formnet check shows all)"]
    figure = axes.figure
    assert isinstance(figure, Figure)
    figure.set_size_inches(figure.get_figwidth(), figure.get_figheight() + 0.17 * len(lines))
    longest = int(14.4 * figure.get_figwidth())
    figure.supxlabel(
        "\n".join(_shortened(line, longest) for line in lines), x=0.02, ha="left", fontsize=7.5
    )


def _shortened(line: str, longest: int) -> str:
    return line if len(line) <= longest else line[: longest - 1] + "…"
