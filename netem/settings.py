"""A link's settings as they stand in a file, and the link they describe."""

import csv
import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from netem import distributions
from netem.corrupt import Corrupt
from netem.delay import ConstantDelay, RandomDelay, TraceDelay, UniformDelay
from netem.duplicate import Duplicate
from netem.link import Impairment, Link
from netem.loss import EveryNthLoss, RandomLoss, TraceLoss
from netem.markov import FourState, GilbertElliott
from netem.order import KeepOrder
from netem.playout import Playout
from netem.presets import PRESETS
from netem.queue import QueueEntry, QueueExit, QueueLimit
from netem.rate import Rate
from netem.reorder import Reorder
from netem.slots import Slots

_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

Seconds = Annotated[float, Field(ge=0.0, le=3600.0)]
PositiveSeconds = Annotated[float, Field(gt=0.0, le=3600.0)]
Positive = Annotated[float, Field(gt=0.0)]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Correlation = Annotated[float, Field(ge=0.0, lt=1.0)]
Count = Annotated[int, Field(ge=0)]


def nanoseconds(seconds: float) -> int:
    """Seconds as the nearest whole number of nanoseconds."""
    return round(seconds * 1e9)


class _Table(BaseModel):
    model_config = _STRICT


class ConstantDelaySettings(_Table):
    """``delay = { distribution = "constant", mean_s = 0.1 }``"""

    distribution: Literal["constant"] = "constant"
    mean_s: Seconds = 0.0

    @property
    def range_ns(self) -> tuple[int, int | None]:
        """The shortest and the longest delay; None if there is no longest."""
        return nanoseconds(self.mean_s), nanoseconds(self.mean_s)

    def impairment(self) -> Impairment:
        return ConstantDelay(nanoseconds(self.mean_s))


class UniformDelaySettings(_Table):
    """``delay = { distribution = "uniform", low_s = 0.05, high_s = 0.3 }``"""

    distribution: Literal["uniform"]
    low_s: Seconds
    high_s: Seconds
    correlation: Correlation = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> "UniformDelaySettings":
        if self.low_s > self.high_s:
            raise ValueError(f"low_s = {self.low_s} must not exceed high_s = {self.high_s}")
        return self

    @property
    def range_ns(self) -> tuple[int, int | None]:
        """The shortest and the longest delay."""
        return nanoseconds(self.low_s), nanoseconds(self.high_s)

    def impairment(self) -> Impairment:
        return UniformDelay(nanoseconds(self.low_s), nanoseconds(self.high_s), self.correlation)


class _RandomDelaySettings(_Table):
    """What all unbounded distributions share: ``offset_s`` is added to every draw."""

    offset_s: Seconds = 0.0
    correlation: Correlation = 0.0

    @property
    def range_ns(self) -> tuple[int, int | None]:
        """The shortest delay; there is no longest."""
        return nanoseconds(self.offset_s), None

    def law(self) -> distributions.Distribution:
        """The distribution of what comes on top of the offset."""
        raise TypeError(type(self))

    def impairment(self) -> Impairment:
        return RandomDelay(self.law(), self.offset_s, self.correlation)


class NormalDelaySettings(_RandomDelaySettings):
    """``{ distribution = "normal", mean_s = 0.05, stddev_s = 0.01 }``, truncated at zero."""

    distribution: Literal["normal"]
    mean_s: PositiveSeconds
    stddev_s: PositiveSeconds

    def law(self) -> distributions.Distribution:
        return distributions.Normal(self.mean_s, self.stddev_s)


class LogNormalDelaySettings(_RandomDelaySettings):
    """``{ distribution = "lognormal", mean_s = 0.05, stddev_s = 0.01 }`` of the delay itself."""

    distribution: Literal["lognormal"]
    mean_s: PositiveSeconds
    stddev_s: PositiveSeconds

    def law(self) -> distributions.Distribution:
        return distributions.LogNormal(self.mean_s, self.stddev_s)


class GammaDelaySettings(_RandomDelaySettings):
    """``{ distribution = "gamma", mean_s = 0.05, stddev_s = 0.01 }``"""

    distribution: Literal["gamma"]
    mean_s: PositiveSeconds
    stddev_s: PositiveSeconds

    def law(self) -> distributions.Distribution:
        return distributions.Gamma(self.mean_s, self.stddev_s)


class WeibullDelaySettings(_RandomDelaySettings):
    """``{ distribution = "weibull", scale_s = 0.05, shape = 1.5 }``"""

    distribution: Literal["weibull"]
    scale_s: PositiveSeconds
    shape: Positive

    def law(self) -> distributions.Distribution:
        return distributions.Weibull(self.scale_s, self.shape)


class ParetoDelaySettings(_RandomDelaySettings):
    """``{ distribution = "pareto", minimum_s = 0.02, shape = 3.0 }``"""

    distribution: Literal["pareto"]
    minimum_s: PositiveSeconds
    shape: Positive

    @model_validator(mode="after")
    def _has_variance(self) -> "ParetoDelaySettings":
        if self.correlation and self.shape <= 2.0:
            raise ValueError(
                f"shape = {self.shape} has no variance, so correlation = {self.correlation} "
                "means nothing: needs shape > 2"
            )
        return self

    def law(self) -> distributions.Distribution:
        return distributions.Pareto(self.minimum_s, self.shape)


class ExponentialDelaySettings(_RandomDelaySettings):
    """``{ distribution = "exponential", mean_s = 0.01, offset_s = 0.02 }``"""

    distribution: Literal["exponential"]
    mean_s: PositiveSeconds

    def law(self) -> distributions.Distribution:
        return distributions.Exponential(self.mean_s)


class _FromFile(_Table):
    """A table that may name a CSV ``file`` instead of giving the numbers.

    Where it is looked for is ``folder`` in the context of the validation.
    """

    @model_validator(mode="before")
    @classmethod
    def _read(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, Mapping) or "file" not in data:
            return data
        folder = (info.context or {}).get("folder")
        if folder is None:
            raise ValueError(f"file {data['file']}: may only be named in a file; give the numbers")
        rest = {key: value for key, value in data.items() if key != "file"}
        return rest | cls.columns(Path(folder, str(data["file"])))

    @classmethod
    def columns(cls, path: Path) -> dict[str, Any]:
        """The file's columns by the names they have in the table."""
        raise TypeError(cls)


class EmpiricalDelaySettings(_FromFile):
    """``{ distribution = "empirical", samples_s = [0.01, 0.02] }``, or ``file = "rtt.csv"``.

    The file has one number (seconds) per line; a first line that is none is a header.
    """

    distribution: Literal["empirical"]
    samples_s: Annotated[list[Seconds], Field(min_length=1)]
    correlation: Correlation = 0.0

    @classmethod
    def columns(cls, path: Path) -> dict[str, Any]:
        return {"samples_s": [row[0] for row in read_numbers(path, 1)]}

    @property
    def range_ns(self) -> tuple[int, int | None]:
        """The shortest and the longest sample."""
        return nanoseconds(min(self.samples_s)), nanoseconds(max(self.samples_s))

    def impairment(self) -> Impairment:
        if min(self.samples_s) == max(self.samples_s):
            return ConstantDelay(nanoseconds(self.samples_s[0]))
        return RandomDelay(distributions.Empirical(self.samples_s), 0.0, self.correlation)


class TraceDelaySettings(_FromFile):
    """``{ distribution = "trace", times_s = [0.0, 1.0], delays_s = [0.01, 0.05], period_s = 2.0 }``

    or ``file = "trace.csv"`` with the columns time and delay (seconds). Without
    ``period_s`` the last row lasts as long as the one before it. Times count
    from the first.
    """

    distribution: Literal["trace"]
    times_s: Annotated[list[Annotated[float, Field(ge=0.0)]], Field(min_length=1)]
    delays_s: Annotated[list[Seconds], Field(min_length=1)]
    period_s: Positive | None = None

    @classmethod
    def columns(cls, path: Path) -> dict[str, Any]:
        rows = read_numbers(path, 2)
        return {"times_s": [row[0] for row in rows], "delays_s": [row[1] for row in rows]}

    @model_validator(mode="after")
    def _replayable(self) -> "TraceDelaySettings":
        if len(self.times_s) != len(self.delays_s):
            raise ValueError(
                f"times_s has {len(self.times_s)} entries and delays_s {len(self.delays_s)}"
            )
        if len(self.times_s) == 1 and self.period_s is None:
            raise ValueError("a trace of one row needs period_s")
        bounds = self._bounds_ns()
        for index, (before, after) in enumerate(pairwise(bounds)):
            if before >= after:
                what = "period_s" if index == len(self.times_s) - 1 else f"times_s[{index + 1}]"
                raise ValueError(f"{what} must exceed the time before it: times ascend")
        return self

    @property
    def range_ns(self) -> tuple[int, int | None]:
        """The shortest and the longest delay of the trace."""
        return nanoseconds(min(self.delays_s)), nanoseconds(max(self.delays_s))

    def impairment(self) -> Impairment:
        *times_ns, period_ns = self._bounds_ns()
        return TraceDelay(times_ns, [nanoseconds(d) for d in self.delays_s], period_ns)

    def _bounds_ns(self) -> list[int]:
        """When each row begins, and when the trace begins anew."""
        times_ns = [nanoseconds(t - self.times_s[0]) for t in self.times_s]
        if self.period_s is None:
            return [*times_ns, 2 * times_ns[-1] - times_ns[-2]]
        return [*times_ns, nanoseconds(self.period_s)]


class RandomLossSettings(_Table):
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


class GilbertElliottSettings(_Table):
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


class FourStateSettings(_Table):
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


class TraceLossSettings(_FromFile):
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


class EveryNthLossSettings(_Table):
    """``{ model = "every_nth", n = 10 }``: the 10th, the 20th and so on are lost."""

    model: Literal["every_nth"]
    n: Annotated[int, Field(ge=1)]

    @property
    def never(self) -> bool:
        """Whether nothing is ever lost."""
        return False

    def impairment(self) -> Impairment:
        return EveryNthLoss(self.n)


class DuplicateSettings(_Table):
    """``duplicate = { probability = 0.01 }``"""

    probability: Probability = 0.0


class CorruptSettings(_Table):
    """``corrupt = { probability = 0.001 }``"""

    probability: Probability = 0.0


class ReorderSettings(_Table):
    """``reorder = { probability = 0.25, gap = 5 }``"""

    probability: Probability = 0.0
    gap: Annotated[int, Field(ge=1)] = 1


class RateSettings(_Table):
    """``rate = { bits_per_s = 1_000_000, overhead_bytes = 38 }``; 0 bits_per_s: no limit."""

    bits_per_s: Count = 0
    overhead_bytes: Count = 0
    cell_bytes: Count = 0
    cell_overhead_bytes: Count = 0


class QueueSettings(_Table):
    """``queue = { messages = 1000, bytes = 64_000 }``; 0: no limit."""

    messages: Count = 0
    bytes: Count = 0


class SlotsSettings(_Table):
    """``slots = { min_s = 0.001, max_s = 0.002, messages = 8, bytes = 1500 }``; max_s = 0: none."""

    min_s: Seconds = 0.0
    max_s: Seconds = 0.0
    messages: Count = 0
    bytes: Count = 0

    @model_validator(mode="after")
    def _ordered(self) -> "SlotsSettings":
        if self.max_s and not 0.0 < self.min_s <= self.max_s:
            raise ValueError(f"need 0 < min_s <= max_s, got {self.min_s} and {self.max_s}")
        return self


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
LossSettings = Annotated[
    RandomLossSettings
    | GilbertElliottSettings
    | FourStateSettings
    | TraceLossSettings
    | EveryNthLossSettings,
    Field(discriminator="model"),
]


class _Preset(_Table):
    """A table that may begin with ``preset = "wifi"``; what it names beside that wins."""

    @model_validator(mode="before")
    @classmethod
    def _expand(cls, data: Any) -> Any:
        if not isinstance(data, Mapping) or "preset" not in data:
            return data
        name = data["preset"]
        if name not in PRESETS:
            raise ValueError(f"preset {name!r} is none of {', '.join(PRESETS)}")
        rest = {key: value for key, value in data.items() if key != "preset"}
        return PRESETS["ideal"] | PRESETS[name] | rest

    @field_validator("loss", mode="before", check_fields=False)
    @classmethod
    def _random_by_default(cls, loss: Any) -> Any:
        return {"model": "random"} | loss if isinstance(loss, dict) else loss


class LinkOverrides(_Preset):
    """What a rule names of a link's settings; what it does not name stays."""

    delay: DelaySettings | None = None
    loss: LossSettings | None = None
    duplicate: DuplicateSettings | None = None
    corrupt: CorruptSettings | None = None
    reorder: ReorderSettings | None = None
    rate: RateSettings | None = None
    queue: QueueSettings | None = None
    slots: SlotsSettings | None = None
    keep_order: bool | None = None
    playout_s: Seconds | None = None


class LinkSettings(_Preset):
    """All settings of one direction of a link; the default is an ideal link.

    ``playout_s`` = 0 means no playout buffer.
    """

    delay: DelaySettings = ConstantDelaySettings()
    loss: LossSettings = RandomLossSettings()
    duplicate: DuplicateSettings = DuplicateSettings()
    corrupt: CorruptSettings = CorruptSettings()
    reorder: ReorderSettings = ReorderSettings()
    rate: RateSettings = RateSettings()
    queue: QueueSettings = QueueSettings()
    slots: SlotsSettings = SlotsSettings()
    keep_order: bool = False
    playout_s: Seconds = 0.0

    def changed(self, overrides: LinkOverrides) -> "LinkSettings":
        """These settings with exactly what ``overrides`` names replaced."""
        named = {
            name: value
            for name in LinkSettings.model_fields
            if (value := getattr(overrides, name)) is not None
        }
        return self.model_copy(update=named)

    @property
    def constant_ns(self) -> int | None:
        """The delay if every message that arrives has the same one."""
        shortest, longest = self.delay.range_ns
        if self.rate.bits_per_s or self.slots.max_s:
            return None
        if self.playout_s:
            return nanoseconds(self.playout_s)
        return shortest if shortest == longest and not self.reorder.probability else None

    @property
    def lossless(self) -> bool:
        """Whether every message arrives, undamaged."""
        longest = self.delay.range_ns[1]
        in_time = not self.playout_s or (
            longest is not None and longest <= nanoseconds(self.playout_s)
        )
        queued = self.queue.messages or self.queue.bytes
        return self.loss.never and in_time and not queued and not self.corrupt.probability

    def impairments(self) -> list[Impairment]:
        """What is on, in the order of tc-netem's pipeline.

        Loss, corrupt, queue; then reorder, delay, rate, slots, order; then
        playout, at the receiver. (Duplicates are made before all of them.)
        """
        limit = QueueLimit(self.queue.messages, self.queue.bytes)
        limited = self.queue.messages > 0 or self.queue.bytes > 0
        stages: list[tuple[bool, Any]] = [
            (not self.loss.never, self.loss.impairment),
            (self.corrupt.probability > 0, lambda: Corrupt(self.corrupt.probability)),
            (limited, lambda: QueueEntry(limit)),
            (
                self.reorder.probability > 0,
                lambda: Reorder(self.reorder.probability, self.reorder.gap),
            ),
            (self.delay.range_ns != (0, 0), self.delay.impairment),
            (self.rate.bits_per_s > 0, lambda: Rate(**dict(self.rate))),
            (self.slots.max_s > 0, self._slots),
            (self.keep_order, KeepOrder),
            (limited, lambda: QueueExit(limit)),
            (self.playout_s > 0, lambda: Playout(nanoseconds(self.playout_s))),
        ]
        return [make() for is_on, make in stages if is_on]

    def _slots(self) -> Slots:
        slots = self.slots
        return Slots(
            nanoseconds(slots.min_s), nanoseconds(slots.max_s), slots.messages, slots.bytes
        )

    def link(self, *, seed: int, source: object, destination: object) -> Link:
        """The link that these settings describe."""
        share = self.duplicate.probability
        return Link(
            self.impairments(),
            seed=seed,
            source=source,
            destination=destination,
            duplicate=Duplicate(share) if share else None,
        )


def read_numbers(path: Path, columns: int) -> list[list[float]]:
    """The rows of a CSV file of ``columns`` finite numbers; a first row of words is a header.

    Raises:
        ValueError: it cannot be read, is empty, or a row is something else; names file and line.
    """
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            lines = list(enumerate(csv.reader(stream), start=1))
    except OSError as error:
        raise ValueError(f"file {path} cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"file {path} is no CSV: {error}") from None
    rows = []
    for number, row in lines:
        if not row:
            continue
        try:
            values = [float(field) for field in row]
        except ValueError:
            if number == 1:
                continue
            values = []
        if len(values) != columns or not all(map(math.isfinite, values)):
            raise ValueError(
                f"file {path}, line {number}: {','.join(row)!r} is not {columns} finite number(s)"
            )
        rows.append(values)
    if not rows:
        raise ValueError(f"file {path} holds no numbers")
    return rows
