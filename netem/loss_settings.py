"""The tables that stand after ``loss =``."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from netem.link import Impairment
from netem.loss import EveryNthLoss, RandomLoss, TraceLoss
from netem.markov import FourState, GilbertElliott
from netem.tables import Correlation, FromFile, Probability, Table, read_numbers


class RandomLossSettings(Table):
    """``loss = { model = "random", probability = 0.01, correlation = 0.25 }``"""

    model: Literal["random"] = "random"
    probability: Probability = 0.0
    correlation: Correlation = 0.0

    @property
    def never(self) -> bool:
        """Whether nothing is ever lost."""
        return self.probability == 0.0

    def impairment(self) -> Impairment:
        return RandomLoss(self.probability, self.correlation)


class GilbertElliottSettings(Table):
    """``{ model = "gilbert_elliott", p = 0.01, r = 0.2, loss_in_bad = 1.0 }``"""

    model: Literal["gilbert_elliott"]
    p: Probability
    r: Probability | None = None
    loss_in_bad: Probability = 1.0
    loss_in_good: Probability = 0.0

    @property
    def never(self) -> bool:
        """Whether nothing is ever lost."""
        return self.loss_in_good == 0.0 and (self.p == 0.0 or self.loss_in_bad == 0.0)

    def impairment(self) -> Impairment:
        return GilbertElliott(self.p, self.r, self.loss_in_bad, self.loss_in_good)


class FourStateSettings(Table):
    """``{ model = "four_state", p13 = 0.01, p31 = 0.3, p32 = 0.1, p23 = 0.5, p14 = 0.001 }``"""

    model: Literal["four_state"]
    p13: Probability
    p31: Probability | None = None
    p32: Probability = 0.0
    p23: Probability = 1.0
    p14: Probability = 0.0

    @model_validator(mode="after")
    def _sums(self) -> "FourStateSettings":
        self.impairment()  # knows its own rules
        return self

    @property
    def never(self) -> bool:
        """Whether nothing is ever lost."""
        return self.p13 == 0.0 == self.p14

    def impairment(self) -> Impairment:
        return FourState(self.p13, self.p31, self.p32, self.p23, self.p14)


class TraceLossSettings(FromFile):
    """``{ model = "trace", losses = [0, 0, 1] }`` (1: lost), or ``file = "losses.csv"``; loops."""

    model: Literal["trace"]
    losses: Annotated[list[Literal[0, 1]], Field(min_length=1)]

    @classmethod
    def columns(cls, path: Path) -> dict[str, Any]:
        return {"losses": [int(x) if x in (0.0, 1.0) else x for (x,) in read_numbers(path, 1)]}

    @property
    def never(self) -> bool:
        """Whether nothing is ever lost."""
        return not any(self.losses)

    def impairment(self) -> Impairment:
        return TraceLoss([bool(lost) for lost in self.losses])


class EveryNthLossSettings(Table):
    """``{ model = "every_nth", n = 10 }``: the 10th, the 20th and so on are lost."""

    model: Literal["every_nth"]
    n: Annotated[int, Field(ge=1)]

    @property
    def never(self) -> bool:
        """Whether nothing is ever lost."""
        return False

    def impairment(self) -> Impairment:
        return EveryNthLoss(self.n)


LossSettings = Annotated[
    RandomLossSettings
    | GilbertElliottSettings
    | FourStateSettings
    | TraceLossSettings
    | EveryNthLossSettings,
    Field(discriminator="model"),
]
