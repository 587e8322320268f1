"""Duplication: some messages arrive twice."""

from random import Random

from formnet.netem.core.checks import probability as checked


class Duplicate:
    """With ``probability`` a message gets a second copy.

    The copy takes its own way through the link (fresh draws) and is not
    duplicated again, as in tc-netem.
    """

    def __init__(self, probability: float) -> None:
        self._probability = checked("probability", probability)

    def doubles(self, random: Random) -> bool:
        """Whether the next message does."""
        return random.random() < self._probability
