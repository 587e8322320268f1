"""Corruption: bits that flip on the way."""

from random import Random

from pydantic import Field

from formnet.netem.core.checks import probability as checked
from formnet.netem.core.link import Impairment
from formnet.netem.core.transit import CORRUPTED, Transit
from formnet.netem.files.tables import Probability
from formnet.netem.impairments.stage import Stages, StageTable


class Corrupt:
    """With ``probability``, one bit of the payload is flipped, each equally likely (tc-netem).

    The copy is delivered; it is the receiver's part to reject what no longer
    parses. An empty payload has nothing to flip.
    """

    name = "corrupt"

    def __init__(self, probability: float) -> None:
        self._probability = checked("probability", probability)

    def twin(self) -> "Corrupt":
        return self

    def inherit(self, before: Impairment) -> None:
        """Nothing: no message depends on another."""

    def apply(self, copy: Transit, random: Random) -> None:
        hit, where = random.random() < self._probability, random.random()
        if not hit or copy.lost or not copy.payload:
            return
        bit = int(where * 8 * len(copy.payload))
        damaged = bytearray(copy.payload)
        damaged[bit // 8] ^= 1 << bit % 8
        copy.payload = bytes(damaged)
        copy.fate = CORRUPTED


class CorruptSettings(StageTable):
    """``corrupt = { probability = 0.001 }``"""

    probability: Probability = Field(
        default=0.0, description="Share of messages in which one bit is flipped."
    )

    def stages(self) -> Stages:
        return {"corrupt": lambda: Corrupt(self.probability)} if self.probability else {}

    @property
    def loses(self) -> bool:
        return self.probability > 0
