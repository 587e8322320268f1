"""The smallest part of a schedule that still fails, found by running parts of it."""

import time
from collections.abc import Sequence

from formnet.lab.launch.engine import EngineName
from formnet.lab.launch.pool import Stopped
from formnet.lab.nemesis.schedule import Episode
from formnet.lab.nemesis.shrink import shrunk
from formnet.lab.nemesis.trial import Finding, Trial, tried

MOST_TRIALS = 150
"""How many runs shrinking may take ..."""
MOST_SHRINKING_S = 600.0
"""... and how long."""


def smallest(trial: Trial, finding: Finding, stopped: Stopped) -> list[Episode]:
    """The least of a failing schedule that fails alike, in one process if it does so there too."""
    trials = 0
    deadline = time.monotonic() + MOST_SHRINKING_S

    def fails(episodes: Sequence[Episode], engine: EngineName) -> bool:
        nonlocal trials
        trials += 1
        if trials > MOST_TRIALS or over():
            return False
        smaller = trial._replace(episodes=episodes, engine=engine, twice=True)
        return finding.kinds <= tried(smaller, over).kinds and not over()

    def over() -> bool:
        return stopped() or time.monotonic() > deadline

    also_inline = trial.engine == "inline" or fails(trial.episodes, "inline")
    engine: EngineName = "inline" if also_inline else trial.engine

    def shorter(episode: Episode) -> Episode | None:
        return episode.shorter() if episode.end_s - episode.begin_s > 0.02 else None

    return shrunk(trial.episodes, lambda some: fails(some, engine), shorter)
