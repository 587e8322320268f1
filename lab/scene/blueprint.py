"""How a scene is laid out in Rerun's viewer, and how much of the plane is in sight."""

from math import floor, log10
from typing import Any

import numpy as np
import rerun.blueprint as rrb
from numpy.typing import NDArray

from formnet.formation.scenario.model import Scenario
from formnet.lab.judge import claim_words
from formnet.lab.judge.lyapunov import is_defined

TRAIL_S = 15.0
_MOST_NAMED = 10
"""Links that a legend names."""
_MARGIN, _GROWS, _MOST_GROWN = 1.4, 1.25, 16.0

Array = NDArray[Any]
NOWHERE: Array = np.empty((0, 2))


def blueprint(scenario: Scenario, half_m: float, *, speed: float | None = None) -> rrb.Blueprint:
    """How the scene is laid out, with a field of half the width ``half_m``.

    ``speed``: play it so many times as fast as it was.
    """
    few = len(scenario.directed_links) <= _MOST_NAMED
    legend = rrb.PlotLegend(visible=few)
    each = "" if few else "; point at a line to see its link"
    corner = rrb.PlotLegend(corner=rrb.Corner2D.LeftBottom)  # errors fall; new is on the right
    centre = _centre(_known(scenario))
    trail = rrb.VisibleTimeRange(
        "sim_time",
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL_S),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    field = rrb.Spatial2DView(
        origin="field",
        name="field (m; colour of a link: age of what was heard)",
        visual_bounds=rrb.VisualBounds2D(
            x_range=[centre[0] - half_m, centre[0] + half_m],
            y_range=[-centre[1] - half_m, -centre[1] + half_m],
        ),
        overrides={"field/trails": rrb.VisibleTimeRanges(trail)},
    )
    plots = [("errors", f"{claim_words.errors(scenario)}, powers of ten", corner)]
    if is_defined(scenario):
        plots.append(("lyapunov", "V, powers of ten", corner))
    plots += [
        ("links/delay", f"delay (ms{each})", legend),
        ("links/loss", f"lost (%{each})", legend),
    ]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(field, rrb.TextLogView(origin="events", name="events"), row_shares=[3, 1]),
            rrb.Vertical(
                *(
                    rrb.TimeSeriesView(origin=origin, name=name, plot_legend=shown)
                    for origin, name, shown in plots
                )
            ),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(
            timeline="sim_time",
            state="collapsed",
            playback_speed=speed,
            play_state=None if speed is None else "playing",
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_layout=False,
        auto_views=False,
    )


def half_width(scenario: Scenario, places: Array = NOWHERE, half_m: float = 0.0) -> float:
    """Half the width (m) of what must be in sight to see all ``places`` (..., 2).

    At least ``half_m``, and what shows all starts and the pattern. It grows in steps, and not
    without end: who diverges leaves.
    """
    known = _known(scenario)
    first_m = max(0.5 * _MARGIN * float(np.ptp(known, axis=0).max()), 0.5)
    half_m = max(half_m, first_m)
    away = np.abs(places - _centre(known))
    farthest_m = float(away[np.isfinite(away)].max(initial=0.0))
    while half_m < farthest_m and half_m < _MOST_GROWN * first_m:
        half_m *= _GROWS
    return half_m


def scale_bar(scenario: Scenario, half_m: float) -> tuple[Array, float]:
    """A bar in the lower left corner of the field, (2, 2) as it is drawn, and its length (m)."""
    rough = 0.5 * half_m
    unit = 10.0 ** floor(log10(rough))
    length = max(part * unit for part in (1.0, 2.0, 5.0) if part * unit <= rough)
    centre = _centre(_known(scenario))
    left, below = centre[0] - 0.95 * half_m, -centre[1] + 0.9 * half_m
    return np.array([[left, below], [left + length, below]]), length


def _centre(known: Array) -> Array:
    return (known.min(axis=0) + known.max(axis=0)) / 2  # type: ignore[no-any-return]


def _known(scenario: Scenario) -> Array:
    """The places known before the run: starts and pattern, (n, 2)."""
    starts = np.array([(robot.start.x_m, robot.start.y_m) for robot in scenario.robots])
    return np.concatenate([starts, scenario.offsets_m])
