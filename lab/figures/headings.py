"""``headings.png``: where the robots look, and how far they agree (Figs. 5, 7 of the paper)."""

import numpy as np
from numpy.typing import NDArray

from formnet.formation.scenario.expect import Expect
from formnet.lab.figures import presence
from formnet.lab.figures.canvas import HALF_IN, MOST_NAMED, blank, colours, dashes, line_or_point
from formnet.lab.figures.plotting import Axes, Figure
from formnet.lab.runs.recording import Collected, Trajectories

_NO_MEAN = 1e-9
"""How short the mean of unit vectors is where headings have no mean direction."""

Series = NDArray[np.float64]


def headings(recording: Collected, trajectories: Trajectories) -> Figure:
    """Headings in (-π, π] over time, and the gap on the circle to the mean of those who are up.

    ``trajectories``: the part of the run that is drawn. A robot that is down is dotted above and
    not drawn below; a cross marks where it went down. Below, the axis is linear within the
    tolerance (dotted) and logarithmic beyond it.
    """
    scenario = recording.scenario
    t_s, count = trajectories.t_s, len(scenario.ids)
    up = presence.up(scenario, recording.roster(), trajectories.t_ns)
    found, mark = trajectories.headings_rad, line_or_point(t_s)
    gaps = gaps_to_mean(found, up)
    figure = blank(*HALF_IN)
    upper, lower = figure.subplots(2, 1, sharex=True)
    for i, (robot, colour, dash) in enumerate(
        zip(scenario.ids, colours(count), dashes(count), strict=True)
    ):
        look = {"color": colour, "ls": dash, "lw": 1.2, "marker": "o" if mark == "o" else None}
        own = np.where(up[:, i], found[:, i], np.nan)
        upper.plot(*on_circle(t_s, own), **look, label=f"robot {robot}")
        lower.plot(*on_circle(t_s, gaps[:, i]), **look)
        _down(upper, t_s, found[:, i], up[:, i], colour)
    tolerance = (scenario.expect or Expect()).heading_tolerance_rad
    _circle(upper, lower, tolerance)
    if len(t_s) < len(recording.trajectories.t_s):
        upper.set_title(f"to t = {t_s[-1]:g} s, before a robot runs away", fontsize=9)
    upper.set_ylabel("heading θ (rad)")
    lower.set_ylabel("gap to the mean (rad)")
    fell = "" if up.all() else "× and dotted above: down; "
    lower.set_xlabel(f"t (s)    ({fell}dotted below: tolerance)")
    if count <= MOST_NAMED:  # there is no room for it among the lines
        figure.legend(loc="outside right upper", fontsize=8, handlelength=3.0)
    return figure


def gaps_to_mean(found: Series, up: NDArray[np.bool_]) -> Series:
    """Headings (n, robots) less their circular mean over who is ``up`` (n, robots), in (-π, π].

    NaN where a robot is down, and where those who are up have no mean direction.
    """
    with np.errstate(invalid="ignore"):  # a heading that is not finite
        directions = np.where(up, np.exp(1j * found), 0.0)
    mean = directions.sum(axis=1, keepdims=True) / np.maximum(up.sum(axis=1, keepdims=True), 1)
    known = up & (np.abs(mean) > _NO_MEAN)
    return np.where(known, wrapped(found - np.angle(mean)), np.nan)


def wrapped(angle_rad: Series) -> Series:
    """Angles in (-π, π]."""
    with np.errstate(invalid="ignore"):  # not finite
        return np.pi - np.mod(np.pi - angle_rad, 2.0 * np.pi)


def on_circle(t_s: Series, angle_rad: Series) -> tuple[Series, Series]:
    """A line (n,) wrapped into (-π, π], with a gap (NaN) wherever it leaves at one side."""
    angle = wrapped(angle_rad)
    with np.errstate(invalid="ignore"):
        breaks = np.flatnonzero(np.abs(np.diff(angle)) > np.pi) + 1
    return np.insert(t_s, breaks, t_s[breaks]), np.insert(angle, breaks, np.nan)


def _down(axes: Axes, t_s: Series, found: Series, up: NDArray[np.bool_], colour: str) -> None:
    """A robot while it is down, and where it goes down."""
    if up.all():
        return
    axes.plot(*on_circle(t_s, np.where(up, np.nan, found)), color=colour, ls=":", lw=1.0, alpha=0.6)
    falls = np.flatnonzero(~up & np.concatenate([[True], up[:-1]]))
    axes.plot(t_s[falls], wrapped(found[falls]), "x", color=colour, ms=6, mew=1.6, zorder=3)


def _circle(upper: Axes, lower: Axes, tolerance: float) -> None:
    """The axes of both panels: the whole circle."""
    quarters = np.arange(-2, 3)
    upper.set_ylim(-1.06 * np.pi, 1.06 * np.pi)
    upper.set_yticks(quarters * np.pi / 2.0, ["−π", "−π/2", "0", "π/2", "π"])
    lower.set_yscale("symlog", linthresh=tolerance)
    lower.set_ylim(-1.5 * np.pi, 1.5 * np.pi)
    ticks = [tolerance, *(value for value in (0.1, 1.0) if value > 2.0 * tolerance)]
    both = [*(-value for value in reversed(ticks)), 0.0, *ticks]
    lower.set_yticks(both, [f"{value:g}".replace("-", "−") for value in both])
    lower.minorticks_off()
    for edge in (-tolerance, tolerance):
        lower.axhline(edge, color="0.45", ls=":", lw=1.0, zorder=0)
