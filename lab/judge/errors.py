"""The errors of Eqs. 3-5 along a run, the stretch in which they are judged, when they settle."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from formnet.formation.paper.geometry import Errors, errors
from formnet.formation.scenario.expect import ERRORS
from formnet.formation.scenario.model import Scenario
from formnet.lab.runs.recording import Trajectories
from formnet.netem.files.tables import nanoseconds


def error_series(
    scenario: Scenario, trajectories: Trajectories, robots: Sequence[int] | None = None
) -> Errors:
    """The three errors at every recorded instant, each (n_samples,).

    They are those of ``robots`` (ids; None: of all); NaN if that is nobody.
    """
    kept = [k for k, robot in enumerate(scenario.ids) if robots is None or robot in robots]
    if not len(trajectories.t_s) or not kept:
        unknown = np.full(len(trajectories.t_s), np.nan)
        return Errors(unknown, unknown, unknown)
    with np.errstate(over="ignore", invalid="ignore"):  # a diverging run overflows
        return errors(
            trajectories.positions_m[:, kept],
            trajectories.headings_rad[:, kept],
            scenario.offsets_m[kept],
        )


def by_claim(found: Errors) -> dict[str, NDArray[np.float64]]:
    """The errors under the names of the claims they decide."""
    return dict(zip(ERRORS, found, strict=True))


def window_s(scenario: Scenario) -> float:
    """How long before the end the claims must hold (see ``scenario.Expect``)."""
    if scenario.expect is not None and scenario.expect.window_s is not None:
        return scenario.expect.window_s
    return max(0.1 * scenario.duration_s, scenario.clock.broadcast_period_s)


def in_window(scenario: Scenario, t_ns: NDArray[np.int64], end_ns: int) -> NDArray[np.bool_]:
    """Which of the instants ``t_ns`` (n,) of a run that ended at ``end_ns`` are judged."""
    return t_ns >= end_ns - nanoseconds(window_s(scenario))


def settling_time(
    t_s: NDArray[np.float64],
    series: Mapping[str, NDArray[np.float64]],
    tolerances: Mapping[str, float],
) -> float | None:
    """When every error in ``series`` entered its tolerance for good; None if one did not."""
    outside = np.zeros(len(t_s), dtype=bool)
    for claim, values in series.items():
        outside |= ~(values <= tolerances[claim])
    if not len(t_s) or outside[-1]:
        return None
    last_outside = np.flatnonzero(outside)
    return float(t_s[last_outside[-1] + 1]) if len(last_outside) else float(t_s[0])
