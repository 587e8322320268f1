"""A playout (jitter) buffer at the receiver."""

from random import Random

from formnet.netem.core.link import Impairment
from formnet.netem.core.transit import LOST_LATE, Transit


class Playout:
    """Hold each message until ``playout_ns`` after it was sent; later ones count as lost.

    Turns random delay into a constant one, which is what Theorems 5 and 6 assume.
    Put it last.
    """

    name = "playout"

    def __init__(self, playout_ns: int) -> None:
        if playout_ns < 0:
            raise ValueError(f"playout_ns must be >= 0, got {playout_ns}")
        self._playout_ns = playout_ns

    def twin(self) -> "Playout":
        return self

    def inherit(self, before: Impairment) -> None:
        """Nothing: no message depends on another."""

    def apply(self, copy: Transit, random: Random) -> None:
        if copy.lost:
            return
        copy.left_ns = copy.due_ns
        if copy.due_ns > copy.sent_ns + self._playout_ns:
            copy.fate = LOST_LATE
        else:
            copy.due_ns = copy.sent_ns + self._playout_ns
