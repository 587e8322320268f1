"""Where V, or V*, rises along a run, and what may have made it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from formnet.formation.paper.proof import gain_for_star
from formnet.formation.paper.theory import outside_model
from formnet.formation.records.events import Lost
from formnet.formation.scenario.expect import LYAPUNOV
from formnet.formation.scenario.model import Scenario
from formnet.lab.judge.closed_loop import Array
from formnet.lab.judge.lyapunov import Curve
from formnet.lab.runs.recording import Collected
from formnet.netem.core.transit import LOST_DOWN

_APART = 10
"""Rises fewer broadcast periods apart are one."""


class Rise(NamedTuple):
    """V gained ``gain`` more than it may between ``begin_s`` and ``end_s``, and why."""

    begin_s: float
    end_s: float
    gain: float
    relative_gain: float
    causes: list[str]


def rises(recording: Collected, found: Curve, standing: Sequence[str]) -> list[Rise]:
    """Every stretch in which V gains more than its budget, from when all were first heard on.

    ``standing``: why it may rise at any time (:func:`standing_causes`).
    """
    first = int(np.argmax(found.whole)) if found.whole.any() else len(found.v) - 1
    with np.errstate(invalid="ignore"):  # a diverging run overflows
        excess = np.diff(found.v) - found.budget[1:]
        beyond = ~(excess <= LYAPUNOV.tolerance * found.v[:-1])
    beyond &= ~(np.isnan(found.v[:-1]) | np.isnan(found.v[1:]))  # V* is not defined there
    marked = np.flatnonzero(beyond[first:]) + first
    if not len(marked):
        return []
    causes = _Causes(recording, standing)
    groups = np.split(marked, np.flatnonzero(np.diff(marked) > _APART) + 1)
    return [_rise(found, excess, group, causes) for group in groups]


def _rise(found: Curve, excess: Array, steps: NDArray[np.intp], causes: "_Causes") -> Rise:
    begin_s, end_s = float(found.t_s[steps[0]]), float(found.t_s[steps[-1] + 1])
    gain, before = float(excess[steps].sum()), float(found.v[steps[0]])
    return Rise(begin_s, end_s, gain, gain / before if before else gain, causes.of(begin_s, end_s))


class _Causes:
    """What can make V rise, and when: all that the theorems exclude."""

    def __init__(self, recording: Collected, standing: Sequence[str]) -> None:
        scenario = recording.scenario
        self._standing = standing
        self._happenings = [
            (entry.at_s, f"{entry.what} at {entry.at_s:g} s") for entry in scenario.plan
        ]
        self._happenings += [
            (event.t_ns / 1e9, f"robot {event.robot} lost at {event.t_ns / 1e9:g} s")
            for event in recording.events
            if isinstance(event, Lost)
        ]
        lost = [
            row
            for row in recording.link_rows
            if row.fate.startswith("lost") and row.fate != LOST_DOWN
        ]
        self._lost_s = np.sort(np.array([row.t_sent_ns for row in lost], dtype=np.float64)) / 1e9
        delays = [
            row.t_usable_ns - row.t_sent_ns
            for row in recording.link_rows
            if row.t_usable_ns is not None
        ]
        longest_ns = max(delays, default=0)
        self._reach_s = (
            scenario.neighbours.silence_s + longest_ns / 1e9 + scenario.clock.broadcast_period_s
        )

    def of(self, begin_s: float, end_s: float) -> list[str]:
        """What may have made V rise between two instants; "unexplained" if nothing is known."""
        since_s = begin_s - self._reach_s
        found = [what for at_s, what in self._happenings if since_s <= at_s <= end_s]
        lost = int(np.searchsorted(self._lost_s, end_s) - np.searchsorted(self._lost_s, since_s))
        if lost:
            found.append(f"loss: {lost} messages since {max(0.0, since_s):g} s")
        return [*found, *self._standing] or ["unexplained"]


def standing_causes(scenario: Scenario, *, star: bool = False) -> list[str]:
    """Why V (``star``: V*) may rise at any time; nothing where it is proved that it never does.

    What happens at an instant (faults, cuts, loss) is not among them.
    """
    law = scenario.law
    causes = []
    if star:
        if law.level == "dynamic" and not (found := gain_for_star(scenario)).enough:
            causes.append(f"{found.in_words} (law.feedback_gain)")
    elif law.cross_term == "printed":
        causes.append("the term w1 z2 z3 that the proofs drop (law.cross_term)")
    if law.delta == "printed":
        causes.append("Δ of the sign printed in Eq. 19 (law.delta)")
    settings = (scenario.link_settings(*link) for link in scenario.directed_links)
    if any(some.constant_ns is None for some in settings):
        causes.append("variable delay")
    if law.level == "dynamic":
        causes += outside_model(scenario)
    return causes
