"""A link's settings as they stand in a file, and the link they describe."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from netem.delay import ConstantDelay, UniformDelay
from netem.link import Impairment, Link
from netem.loss import RandomLoss

_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

Seconds = Annotated[float, Field(ge=0.0, le=3600.0)]


def nanoseconds(seconds: float) -> int:
    """Seconds as the nearest whole number of nanoseconds."""
    return round(seconds * 1e9)


class ConstantDelaySettings(BaseModel):
    """``delay = { distribution = "constant", mean_s = 0.1 }``"""

    model_config = _STRICT
    distribution: Literal["constant"] = "constant"
    mean_s: Seconds = 0.0

    @property
    def constant_ns(self) -> int | None:
        """The delay if every message has the same one."""
        return nanoseconds(self.mean_s)

    def impairment(self) -> Impairment:
        return ConstantDelay(nanoseconds(self.mean_s))


class UniformDelaySettings(BaseModel):
    """``delay = { distribution = "uniform", low_s = 0.05, high_s = 0.3 }``"""

    model_config = _STRICT
    distribution: Literal["uniform"]
    low_s: Seconds
    high_s: Seconds

    @model_validator(mode="after")
    def _ordered(self) -> "UniformDelaySettings":
        if self.low_s > self.high_s:
            raise ValueError(f"low_s = {self.low_s} must not exceed high_s = {self.high_s}")
        return self

    @property
    def constant_ns(self) -> int | None:
        """The delay if every message has the same one."""
        low, high = nanoseconds(self.low_s), nanoseconds(self.high_s)
        return low if low == high else None

    def impairment(self) -> Impairment:
        return UniformDelay(nanoseconds(self.low_s), nanoseconds(self.high_s))


class RandomLossSettings(BaseModel):
    """``loss = { model = "random", probability = 0.01 }``"""

    model_config = _STRICT
    model: Literal["random"] = "random"
    probability: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0

    def impairment(self) -> Impairment:
        return RandomLoss(self.probability)


DelaySettings = Annotated[
    ConstantDelaySettings | UniformDelaySettings, Field(discriminator="distribution")
]
LossSettings = RandomLossSettings


class LinkOverrides(BaseModel):
    """What a rule names of a link's settings; what it does not name stays."""

    model_config = _STRICT
    delay: DelaySettings | None = None
    loss: LossSettings | None = None


class LinkSettings(BaseModel):
    """All settings of one direction of a link; the default is an ideal link."""

    model_config = _STRICT
    delay: DelaySettings = ConstantDelaySettings()
    loss: LossSettings = RandomLossSettings()

    def changed(self, overrides: LinkOverrides) -> "LinkSettings":
        """These settings with exactly what ``overrides`` names replaced."""
        return LinkSettings(delay=overrides.delay or self.delay, loss=overrides.loss or self.loss)

    def link(self, *, seed: int, source: object, destination: object) -> Link:
        """The link: loss is drawn first, then delay (the order of tc-netem's pipeline)."""
        return Link(
            [self.loss.impairment(), self.delay.impairment()],
            seed=seed,
            source=source,
            destination=destination,
        )
