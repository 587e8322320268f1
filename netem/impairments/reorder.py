"""Reordering: messages that overtake the others."""

from random import Random
from typing import Annotated

from pydantic import Field

from formnet.netem.core.checks import probability as checked
from formnet.netem.core.link import Impairment
from formnet.netem.core.transit import Transit
from formnet.netem.files.tables import Probability
from formnet.netem.impairments.stage import Stages, StageTable


class Reorder:
    """Some messages skip delay and rate: with ``probability``, every ``gap``-th at most.

    As in tc-netem: of every ``gap`` messages the first ``gap`` - 1 are delayed as
    usual, and each after that is hurried with ``probability``, until one is. So
    ``gap`` = 5 and ``probability`` = 1 hurries every fifth message. Put it before
    delay and rate; without a delay it does nothing.
    """

    name = "reorder"

    def __init__(self, probability: float, gap: int = 1) -> None:
        if gap < 1:
            raise ValueError(f"gap must be >= 1, got {gap}")
        self._probability = checked("probability", probability)
        self._gap = gap
        self._delayed = 0

    def twin(self) -> "Reorder":
        return Reorder(self._probability, self._gap)

    def inherit(self, before: Impairment) -> None:
        if isinstance(before, Reorder):
            self._delayed = before._delayed

    def apply(self, copy: Transit, random: Random) -> None:
        hit = random.random() < self._probability
        if self._delayed < self._gap - 1 or not hit:
            self._delayed += 1
        else:
            self._delayed = 0
            copy.hurried = True


class ReorderSettings(StageTable):
    """``reorder = { probability = 0.25, gap = 5 }``"""

    probability: Probability = Field(
        default=0.0, description="Share of messages that skip delay and rate."
    )
    gap: Annotated[int, Field(ge=1)] = Field(
        default=1, description="Only every n-th message can be reordered."
    )

    def stages(self) -> Stages:
        return {"reorder": lambda: Reorder(self.probability, self.gap)} if self.probability else {}
