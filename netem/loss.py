"""Loss: which messages never arrive."""

from dataclasses import dataclass
from random import Random

from netem.link import DELIVERED, LOST_RANDOM, Transit


@dataclass(frozen=True, slots=True)
class RandomLoss:
    """Each copy is lost with ``probability``, independently of all others."""

    probability: float
    name: str = "loss"

    def __post_init__(self) -> None:
        if not 0.0 <= self.probability <= 1.0:
            raise ValueError(f"probability must be in [0, 1], got {self.probability}")

    def apply(self, copies: list[Transit], random: Random) -> list[Transit]:
        for copy in copies:
            lost = random.random() < self.probability
            if lost and copy.fate == DELIVERED:
                copy.fate = LOST_RANDOM
        return copies
