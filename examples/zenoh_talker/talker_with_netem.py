"""The teller of talker.py with a bad link inside: netem as a library, no bridge.

    python talker.py hear tcp/127.0.0.1:7447
    python talker_with_netem.py tcp/127.0.0.1:7447

netem decides when each copy is due and whether it is lost; the wall clock calls back then.
"""

import itertools
import sys
import time

from talker import session, tell

from formnet.netem import LinkSettings
from formnet.netem.core.wallclock import WallClock

SETTINGS = {
    "delay": {"distribution": "uniform", "low_s": 0.05, "high_s": 0.15},
    "loss": {"probability": 0.2},
}


class Impaired:
    """A publisher whose messages take a link."""

    def __init__(self, clock: WallClock) -> None:
        self.clock, self.numbers = clock, itertools.count()
        self.link = LinkSettings.model_validate(SETTINGS).link(
            seed=1, source="rover", destination="base"
        )

    def put(self, payload: str) -> None:
        """Send ``payload`` on its way."""
        self.clock.send(self.link, next(self.numbers), payload.encode())


with session(sys.argv[1], listen=False) as opened:
    publisher = opened.declare_publisher("rover/1/pose")
    while not publisher.matching_status.matching:
        time.sleep(0.01)
    with WallClock(lambda link, copy: publisher.put(copy.payload)) as clock:
        tell(Impaired(clock), count=200, period_s=0.01)
