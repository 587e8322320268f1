"""How finely a run is shown: a scene of a long run or of many robots must stay small."""

from collections.abc import Callable
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from formnet.formation.scenario.model import Scenario
from formnet.lab.scene.lines import BENDS
from formnet.netem.files.tables import nanoseconds

Array = NDArray[Any]
Times = Callable[[Array], list[rr.TimeColumn]]
"""Instants of a run (nanoseconds), as the timelines of the scene have them."""

MOST_FRAMES = 3000
"""Instants of a run that are shown, at most; evenly apart, and the last one."""
MOST_CELLS = 600_000
"""... and at most so many divided by robots and directed links together."""
MOST_WINDOWS = 600
"""Stretches of a run over which a link's delay and loss are averaged, at most."""


def stride(scenario: Scenario, bows: Array) -> int:
    """Of how many instants one is shown, where links bend by ``bows``, (links,)."""
    lines = len(scenario.directed_links) + (BENDS - 1) * int(np.count_nonzero(bows))
    cells = len(scenario.ids) + lines + lines // 2  # links, and the edges of the pattern
    frames = max(100, min(MOST_FRAMES, MOST_CELLS // cells))
    instants = nanoseconds(scenario.duration_s) // scenario.clock.broadcast_period_ns + 1
    return -(-instants // frames)


def window_ns(scenario: Scenario) -> int:
    """How long the stretches are over which a link's delay and loss are averaged."""
    links = len(scenario.directed_links)
    windows = max(10, min(MOST_WINDOWS, MOST_CELLS // (4 * links or 1)))
    shortest = 10 * scenario.clock.broadcast_period_ns
    return max(shortest, nanoseconds(scenario.duration_s) // windows)
