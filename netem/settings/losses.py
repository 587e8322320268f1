"""The tables that stand after ``loss =``."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from formnet.netem.core.link import Impairment
from formnet.netem.files.from_file import FromFile
from formnet.netem.files.tables import Correlation, Probability, Table
from formnet.netem.impairments.loss import EveryNthLoss, RandomLoss, TraceLoss
from formnet.netem.impairments.markov import FourState, GilbertElliott


class RandomLossSettings(Table):
    """``loss = { model = "random", probability = 0.01, correlation = 0.25 }``"""

    model: Literal["random"] = Field(
        default="random", description="Independent losses, or correlated ones."
    )
    probability: Probability = Field(default=0.0, description="Share of messages that are lost.")
    correlation: Correlation = Field(
        default=0.0,
        description="Lag-1 correlation of successive losses; does not change their share.",
    )

    @property
    def never(self) -> bool:
        """Whether nothing is ever lost."""
        return self.probability == 0.0

    def impairment(self) -> Impairment:
        return RandomLoss(self.probability, self.correlation)


class GilbertElliottSettings(Table):
    """``{ model = "gilbert_elliott", p = 0.01, r = 0.2, loss_in_bad = 1.0 }``"""

    model: Literal["gilbert_elliott"] = Field(
        description="A good and a bad state: tc-netem's `gemodel p r 1-h 1-k`."
    )
    p: Probability = Field(description="Probability of changing from good to bad, per message.")
    r: Probability | None = Field(
        default=None, description="Probability of changing from bad to good; by default 1 − p."
    )
    loss_in_bad: Probability = Field(default=1.0, description="Loss probability in the bad state.")
    loss_in_good: Probability = Field(
        default=0.0, description="Loss probability in the good state."
    )

    @property
    def never(self) -> bool:
        """Whether nothing is ever lost."""
        return self.loss_in_good == 0.0 and (self.p == 0.0 or self.loss_in_bad == 0.0)

    def impairment(self) -> Impairment:
        return GilbertElliott(self.p, self.r, self.loss_in_bad, self.loss_in_good)


class FourStateSettings(Table):
    """``{ model = "four_state", p13 = 0.01, p31 = 0.3, p32 = 0.1, p23 = 0.5, p14 = 0.001 }``"""

    model: Literal["four_state"] = Field(
        description="tc-netem's `state`: 1 good, 2 good in a burst, 3 lost in a burst, 4 lost."
    )
    p13: Probability = Field(description="Probability that a burst begins.")
    p31: Probability | None = Field(
        default=None, description="Probability that a burst ends; by default 1 − p13."
    )
    p32: Probability = Field(
        default=0.0, description="Probability that a message arrives within a burst."
    )
    p23: Probability = Field(
        default=1.0, description="Probability of returning to loss within a burst."
    )
    p14: Probability = Field(default=0.0, description="Probability of a single loss.")

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

    COLUMNS: ClassVar = ("losses",)
    model: Literal["trace"] = Field(description="From a list, in a loop.")
    losses: Annotated[list[Literal[0, 1]], Field(min_length=1)] = Field(
        description="1: lost, 0: not, message by message."
    )

    @classmethod
    def numbers(cls, rows: list[list[float]]) -> dict[str, list[Any]]:
        return {"losses": [int(x) if x in (0.0, 1.0) else x for (x,) in rows]}

    @property
    def never(self) -> bool:
        """Whether nothing is ever lost."""
        return not any(self.losses)

    def impairment(self) -> Impairment:
        return TraceLoss([bool(lost) for lost in self.losses])


class EveryNthLossSettings(Table):
    """``{ model = "every_nth", n = 10 }``: the 10th, the 20th and so on are lost."""

    model: Literal["every_nth"] = Field(description="Every n-th message.")
    n: Annotated[int, Field(ge=1)] = Field(description="One of n messages is lost.")

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
