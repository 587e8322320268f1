"""The tables that stand after ``delay =``."""

from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Protocol, TypeVar

from pydantic import ConfigDict, Field, model_validator

from formnet.netem.core.link import Impairment
from formnet.netem.delays import distributions
from formnet.netem.delays.delay import ConstantDelay, RandomDelay, TraceDelay, UniformDelay
from formnet.netem.files.from_file import FromFile, RowError
from formnet.netem.files.tables import (
    Correlation,
    LongSeconds,
    PositiveSeconds,
    Seconds,
    Shape,
    Table,
    nanoseconds,
)


def _names_its_kind(schema: dict[str, Any]) -> None:
    """In a file ``distribution`` is required, although in Python it has a default."""
    schema["required"] = ["distribution"]


class _Correlated(Protocol):
    correlation: float

    def impairment(self) -> Impairment: ...


_Delay = TypeVar("_Delay", bound=_Correlated)


def _correlated(settings: _Delay) -> _Delay:
    """``settings``, of which the impairment knows whether their correlation can be had."""
    if settings.correlation:
        settings.impairment()
    return settings


class ConstantDelaySettings(Table):
    """``delay = { distribution = "constant", mean_s = 0.1 }``"""

    model_config = ConfigDict(json_schema_extra=_names_its_kind)
    distribution: Literal["constant"] = Field(
        default="constant", description="The same for all messages."
    )
    mean_s: Seconds = Field(default=0.0, description="Mean.")

    @property
    def range_ns(self) -> tuple[int, int | None]:
        """The shortest and the longest delay; None if there is no longest."""
        return nanoseconds(self.mean_s), nanoseconds(self.mean_s)

    def quantile_s(self, u: float) -> float:
        """The delay (seconds) that a share ``u`` of messages do not exceed."""
        return self.mean_s

    def impairment(self) -> Impairment:
        return ConstantDelay(nanoseconds(self.mean_s))


class UniformDelaySettings(Table):
    """``delay = { distribution = "uniform", low_s = 0.05, high_s = 0.3 }``"""

    distribution: Literal["uniform"] = Field(description="Between the two bounds, inclusive.")
    low_s: Seconds = Field(description="Shortest delay.")
    high_s: Seconds = Field(description="Longest delay.")
    correlation: Correlation = Field(
        default=0.0,
        description="Lag-1 correlation of successive delays; does not change their distribution.",
    )

    @model_validator(mode="after")
    def _ordered(self) -> "UniformDelaySettings":
        if self.low_s > self.high_s:
            raise ValueError(f"low_s = {self.low_s} must not exceed high_s = {self.high_s}")
        return _correlated(self)

    @property
    def range_ns(self) -> tuple[int, int | None]:
        """The shortest and the longest delay."""
        return nanoseconds(self.low_s), nanoseconds(self.high_s)

    def quantile_s(self, u: float) -> float:
        """The delay (seconds) that a share ``u`` of messages do not exceed."""
        return self.low_s + u * (self.high_s - self.low_s)

    def impairment(self) -> Impairment:
        return UniformDelay(nanoseconds(self.low_s), nanoseconds(self.high_s), self.correlation)


class _RandomDelaySettings(Table):
    """What all unbounded distributions share: ``offset_s`` is added to every draw."""

    offset_s: Seconds = Field(default=0.0, description="Added to every draw.")
    correlation: Correlation = Field(
        default=0.0,
        description="Lag-1 correlation of successive delays; does not change their distribution.",
    )

    @property
    def range_ns(self) -> tuple[int, int | None]:
        """The shortest delay; there is no longest."""
        return nanoseconds(self.offset_s), None

    @model_validator(mode="after")
    def _can_be_correlated(self) -> "_RandomDelaySettings":
        return _correlated(self)

    def law(self) -> distributions.Distribution:
        """The distribution of what comes on top of the offset."""
        raise TypeError(type(self))

    def quantile_s(self, u: float) -> float:
        """The delay (seconds) that a share ``u`` of messages do not exceed."""
        return self.offset_s + self.law().quantile(u)

    def impairment(self) -> Impairment:
        return RandomDelay(self.law(), self.offset_s, self.correlation)


class NormalDelaySettings(_RandomDelaySettings):
    """``{ distribution = "normal", mean_s = 0.05, stddev_s = 0.01 }``, truncated at zero."""

    distribution: Literal["normal"] = Field(
        description="Normal, truncated at zero; its parameters are those before truncation."
    )
    mean_s: PositiveSeconds = Field(description="Mean.")
    stddev_s: PositiveSeconds = Field(description="Standard deviation.")

    def law(self) -> distributions.Distribution:
        return distributions.Normal(self.mean_s, self.stddev_s)


class LogNormalDelaySettings(_RandomDelaySettings):
    """``{ distribution = "lognormal", mean_s = 0.05, stddev_s = 0.01 }`` of the delay itself."""

    distribution: Literal["lognormal"] = Field(
        description="Lognormal: mean and standard deviation of the delay itself."
    )
    mean_s: PositiveSeconds = Field(description="Mean.")
    stddev_s: PositiveSeconds = Field(description="Standard deviation.")

    def law(self) -> distributions.Distribution:
        return distributions.LogNormal(self.mean_s, self.stddev_s)


class GammaDelaySettings(_RandomDelaySettings):
    """``{ distribution = "gamma", mean_s = 0.05, stddev_s = 0.01 }``"""

    distribution: Literal["gamma"] = Field(
        description="Gamma: mean and standard deviation of the delay itself."
    )
    mean_s: PositiveSeconds = Field(description="Mean.")
    stddev_s: PositiveSeconds = Field(description="Standard deviation.")

    @model_validator(mode="after")
    def _computable(self) -> "GammaDelaySettings":
        self.law()  # knows its own rule
        return self

    def law(self) -> distributions.Distribution:
        return distributions.Gamma(self.mean_s, self.stddev_s)


class WeibullDelaySettings(_RandomDelaySettings):
    """``{ distribution = "weibull", scale_s = 0.05, shape = 1.5 }``"""

    distribution: Literal["weibull"] = Field(description="P(X > x) = exp(−(x/scale)^shape).")
    scale_s: PositiveSeconds = Field(description="The scale.")
    shape: Shape = Field(description="The shape.")

    def law(self) -> distributions.Distribution:
        return distributions.Weibull(self.scale_s, self.shape)


class ParetoDelaySettings(_RandomDelaySettings):
    """``{ distribution = "pareto", minimum_s = 0.02, shape = 3.0 }``"""

    distribution: Literal["pareto"] = Field(description="P(X > x) = (minimum/x)^shape.")
    minimum_s: PositiveSeconds = Field(description="The shortest delay.")
    shape: Shape = Field(description="The shape; the smaller, the heavier the tail.")

    def law(self) -> distributions.Distribution:
        return distributions.Pareto(self.minimum_s, self.shape)


class ExponentialDelaySettings(_RandomDelaySettings):
    """``{ distribution = "exponential", mean_s = 0.01, offset_s = 0.02 }``"""

    distribution: Literal["exponential"] = Field(
        description="Exponential: offset plus mean on average."
    )
    mean_s: PositiveSeconds = Field(description="Mean.")

    def law(self) -> distributions.Distribution:
        return distributions.Exponential(self.mean_s)


class EmpiricalDelaySettings(FromFile):
    """``{ distribution = "empirical", samples_s = [0.01, 0.02] }``, or ``file = "rtt.csv"``.

    The file has one number (seconds) per line, and a header or none.
    """

    COLUMNS: ClassVar = ("samples_s",)
    distribution: Literal["empirical"] = Field(
        description="One of your measurements, each with equal probability."
    )
    samples_s: Annotated[list[Seconds], Field(min_length=1)] = Field(
        description="The measurements."
    )
    correlation: Correlation = Field(
        default=0.0,
        description="Lag-1 correlation of successive delays; does not change their distribution.",
    )

    @model_validator(mode="after")
    def _can_be_correlated(self) -> "EmpiricalDelaySettings":
        return _correlated(self)

    @property
    def range_ns(self) -> tuple[int, int | None]:
        """The shortest and the longest sample."""
        return nanoseconds(min(self.samples_s)), nanoseconds(max(self.samples_s))

    def quantile_s(self, u: float) -> float:
        """The delay (seconds) that a share ``u`` of messages do not exceed."""
        return distributions.Empirical(self.samples_s).quantile(u)

    def impairment(self) -> Impairment:
        if min(self.samples_s) == max(self.samples_s) and not self.correlation:
            return ConstantDelay(nanoseconds(self.samples_s[0]))
        return RandomDelay(distributions.Empirical(self.samples_s), 0.0, self.correlation)


class TraceDelaySettings(FromFile):
    """``{ distribution = "trace", times_s = [0.0, 1.0], delays_s = [0.01, 0.05], period_s = 2.0 }``

    or ``file = "trace.csv"`` with the columns time and delay (seconds). Without
    ``period_s`` the last row lasts as long as the one before it. Times count
    from the first.
    """

    COLUMNS: ClassVar = ("times_s", "delays_s")
    distribution: Literal["trace"] = Field(description="Replayed over time, in a loop.")
    times_s: Annotated[list[Annotated[float, Field(ge=0.0, le=1e9)]], Field(min_length=1)] = Field(
        description="Start of each delay, from the first."
    )
    delays_s: Annotated[list[Seconds], Field(min_length=1)] = Field(description="The delays.")
    period_s: LongSeconds | None = Field(
        default=None,
        description=(
            "Period of the loop; by default the last row lasts as long as the one before it."
        ),
    )

    def check(self) -> None:
        if len(self.times_s) != len(self.delays_s):
            raise ValueError(
                f"times_s has {len(self.times_s)} entries and delays_s {len(self.delays_s)}"
            )
        if len(self.times_s) == 1 and self.period_s is None:
            raise ValueError("a trace of one row needs period_s")
        *times_ns, period_ns = self._bounds_ns()
        for row, (before, after) in enumerate(pairwise(times_ns), start=1):
            if before >= after:
                raise RowError(
                    "times_s",
                    row,
                    self.times_s[row],
                    f"must be at least 1 ns after the time before it, {self.times_s[row - 1]}",
                )
        if period_ns <= times_ns[-1]:
            last_s = self.times_s[-1] - self.times_s[0]
            raise ValueError(
                f"period_s = {self.period_s} must be at least 1 ns longer than the {last_s} s from "
                "the first time to the last"
            )

    @property
    def range_ns(self) -> tuple[int, int | None]:
        """The shortest and the longest delay of the trace."""
        return nanoseconds(min(self.delays_s)), nanoseconds(max(self.delays_s))

    def quantile_s(self, u: float) -> float:
        """The delay (seconds) that a share ``u`` of messages do not exceed."""
        *times_ns, period_ns = self._bounds_ns()
        lasts = pairwise([*times_ns, period_ns])
        share = 0.0
        for delay_s, (begin, end) in sorted(zip(self.delays_s, lasts, strict=True)):
            share += (end - begin) / period_ns
            if u <= share:
                return delay_s
        return max(self.delays_s)

    def impairment(self) -> Impairment:
        *times_ns, period_ns = self._bounds_ns()
        return TraceDelay(times_ns, [nanoseconds(d) for d in self.delays_s], period_ns)

    def _bounds_ns(self) -> list[int]:
        """When each row begins, and when the trace begins anew."""
        times_ns = [nanoseconds(t - self.times_s[0]) for t in self.times_s]
        if self.period_s is None:
            return [*times_ns, 2 * times_ns[-1] - times_ns[-2]]
        return [*times_ns, nanoseconds(self.period_s)]


DelaySettings = Annotated[
    ConstantDelaySettings
    | UniformDelaySettings
    | NormalDelaySettings
    | LogNormalDelaySettings
    | GammaDelaySettings
    | WeibullDelaySettings
    | ParetoDelaySettings
    | ExponentialDelaySettings
    | EmpiricalDelaySettings
    | TraceDelaySettings,
    Field(discriminator="distribution"),
]
