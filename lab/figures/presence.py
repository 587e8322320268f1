"""When robots take part, over the ticks of a run."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from formnet.formation.plan.roster import Roster, Span
from formnet.formation.scenario.model import Scenario


def spans(roster: Roster, robot: int, first: int, last: int) -> Iterator[Span]:
    """The spans in which a robot is down, of those that touch the ticks ``first`` to ``last``."""
    tick = first
    while tick <= last:
        span = roster.span(robot, tick)
        if span is None:
            tick = roster.next_down(robot, tick)
        else:
            yield span
            tick = span.end


def up(scenario: Scenario, roster: Roster, t_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Who is up at each of the instants ``t_ns`` (n,), which ascend: (n, robots)."""
    ticks = t_ns // scenario.clock.control_period_ns
    found = np.ones((len(ticks), len(scenario.ids)), dtype=bool)
    for column, robot in enumerate(scenario.ids):
        for span in spans(roster, robot, int(ticks[0]), int(ticks[-1])):
            found[(ticks >= span.begin) & (ticks < span.end), column] = False
    return found
