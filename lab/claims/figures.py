"""Figures of the claims: every error against its tolerance, and Remark 9's comparison."""

from collections.abc import Sequence

import numpy as np

from formnet.formation.paper.geometry import errors
from formnet.formation.records.events import Kill
from formnet.formation.scenario.expect import ERRORS
from formnet.lab.claims.results import BROKEN, Row
from formnet.lab.figures.canvas import COLOURS, blank, colours, dashes
from formnet.lab.figures.plotting import Axes, Figure, Line2D
from formnet.lab.judge.claim_words import labels
from formnet.lab.runs.recording import Collected
from formnet.lab.verdict.model import FAILS, NOT_JUDGED, OBSERVED

_LEAST, _MOST = 1e-8, 1e5
_VERDICT_COLOURS = {
    FAILS: "#D55E00",
    BROKEN: "#D55E00",
    NOT_JUDGED: "#D55E00",
    OBSERVED: "0.45",
}


def summary(rows: Sequence[Row]) -> Figure:
    """Every run of every claim: its errors over their tolerances, and how they should be.

    A full mark should lie left of 1, an open one right of it; where nothing is claimed it is
    a cross.
    """
    figure = blank(11.0, 1.6 + 0.36 * len(rows))
    axes = figure.subplots()
    for place, row in enumerate(rows):
        for shift, (claim, colour) in enumerate(zip(ERRORS, COLOURS, strict=False)):
            for result in row.results:
                wanted = result.case.asked.get(claim)
                if result.case.expected is not None and wanted is None:
                    continue
                error = result.error(claim)
                ratio = _MOST if error is None else error / result.tolerance(claim)
                axes.plot(
                    np.clip(ratio, _LEAST, _MOST),
                    place + 0.22 * (shift - 1),
                    marker="x" if wanted is None else "o",
                    ms=5,
                    ls="",
                    mew=1.2,
                    color=colour,
                    mfc=colour if wanted else "white",
                    clip_on=False,
                    zorder=3,
                )
    for place in range(0, len(rows), 2):
        axes.axhspan(place - 0.5, place + 0.5, color="0.96", lw=0, zorder=0)
    axes.axvline(1.0, color="0.2", lw=1.2, zorder=1)
    axes.set_xscale("log")
    axes.set_xlim(_LEAST, _MOST)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_yticks(range(len(rows)), [_name(row) for row in rows], fontsize=8)
    right = axes.secondary_yaxis("right")
    right.set_yticks(range(len(rows)), [row.verdict for row in rows], fontsize=8)
    for label, row in zip(right.get_yticklabels(), rows, strict=True):
        label.set_color(_VERDICT_COLOURS.get(row.verdict, "#009E73"))
    axes.set_xlabel(
        "largest error in the last tenth of a run, over its tolerance "
        "(right edge: not finite, or beyond)"
    )
    figure.legend(handles=_legend(), loc="outside upper center", ncols=6, fontsize=8, frameon=False)
    return figure


def _name(row: Row) -> str:
    runs = f" × {len(row.results)}" if len(row.results) > 1 else ""
    return f"{row.claim.key}{runs}"


def _legend() -> list[Line2D]:
    equations = [
        Line2D([], [], marker="o", ls="", color=colour, label=error.reference)
        for error, colour in zip(ERRORS.values(), COLOURS, strict=False)
    ]
    marks = [("o", "0.3", "should hold"), ("o", "white", "should not"), ("x", "0.3", "not claimed")]
    return equations + [
        Line2D([], [], marker=marker, ls="", color="0.3", mfc=face, label=label)
        for marker, face, label in marks
    ]


def compared(cooperative: Collected, following: Collected) -> Figure:
    """Remark 9: the formation error and the motion under both laws, before and after a kill."""
    figure = blank(11.0, 7.4)
    upper, lower = figure.subplots(2, 2)
    for axes, motion, run, title in zip(
        upper,
        lower,
        (cooperative, following),
        ("cooperative law (Theorem 4)", "leader-follower control (Desai et al. 2001)"),
        strict=True,
    ):
        kill = next(event for event in run.events if isinstance(event, Kill))
        _errors_of_the_rest(axes, run, kill)
        axes.set_title(title)
        _motion(motion, run, kill)
    low = min(axes.get_ylim()[0] for axes in upper)
    high = max(axes.get_ylim()[1] for axes in upper)
    for axes in upper:
        axes.set_ylim(low, high)
    return figure


def _errors_of_the_rest(axes: Axes, run: Collected, kill: Kill) -> None:
    kept = [k for k, r in enumerate(run.scenario.ids) if r not in kill.robots]
    trajectories = run.trajectories
    found = errors(
        trajectories.positions_m[:, kept],
        trajectories.headings_rad[:, kept],
        run.scenario.offsets_m[kept],
    )
    named = labels(run.scenario)
    for series, colour, claim in (
        (found.formation_m, COLOURS[0], "formation"),
        (found.heading_rad, COLOURS[1], "heading"),
    ):
        axes.semilogy(trajectories.t_s, np.maximum(series, 1e-12), color=colour, label=named[claim])
    killed = ", ".join(map(str, kill.robots))
    axes.axvline(kill.t_ns / 1e9, color="0.3", ls="--", lw=1.0, label=f"robot {killed} killed")
    axes.set_xlabel("t (s)")
    axes.set_ylabel("error of the other robots")
    axes.legend(loc="lower left", fontsize=8)


def _motion(axes: Axes, run: Collected, kill: Kill) -> None:
    """Where the robots are at the kill and at the end, and their ways between."""
    t_ns, positions = run.trajectories.t_ns, run.trajectories.positions_m
    since = int(np.searchsorted(t_ns, kill.t_ns))
    count = len(run.scenario.ids)
    for k, (robot, colour, dash) in enumerate(
        zip(run.scenario.ids, colours(count), dashes(count), strict=True)
    ):
        axes.plot(*positions[since:, k].T, color=colour, ls=dash, lw=1.2)
        axes.plot(*positions[since, k], "o", color=colour, mfc="white", ms=6)
        dead = robot in kill.robots
        axes.plot(*positions[-1, k], "X" if dead else "o", color=colour, ms=9 if dead else 6)
        axes.annotate(
            f"{robot}", positions[-1, k], xytext=(6, 5), textcoords="offset points", fontsize=9
        )
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.15)
    axes.set_title(f"from the kill (○) to t = {t_ns[-1] / 1e9:g} s (●, × dead)", fontsize=10)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
