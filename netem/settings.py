"""A link's settings as they stand in a file, and the link they describe."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, field_validator, model_validator

from netem.corrupt import Corrupt
from netem.delay_settings import ConstantDelaySettings, DelaySettings
from netem.duplicate import Duplicate
from netem.link import Impairment, Link
from netem.loss_settings import LossSettings, RandomLossSettings
from netem.order import KeepOrder
from netem.playout import Playout
from netem.presets import PRESETS
from netem.queue import QueueEntry, QueueExit, QueueLimit
from netem.rate import Rate
from netem.reorder import Reorder
from netem.slots import Slots
from netem.tables import Count, Probability, Seconds, Table, nanoseconds


class DuplicateSettings(Table):
    """``duplicate = { probability = 0.01 }``"""

    probability: Probability = 0.0


class CorruptSettings(Table):
    """``corrupt = { probability = 0.001 }``"""

    probability: Probability = 0.0


class ReorderSettings(Table):
    """``reorder = { probability = 0.25, gap = 5 }``"""

    probability: Probability = 0.0
    gap: Annotated[int, Field(ge=1)] = 1


class RateSettings(Table):
    """``rate = { bits_per_s = 1_000_000, overhead_bytes = 38 }``; 0 bits_per_s: no limit."""

    bits_per_s: Count = 0
    overhead_bytes: Count = 0
    cell_bytes: Count = 0
    cell_overhead_bytes: Count = 0


class QueueSettings(Table):
    """``queue = { messages = 1000, bytes = 64_000 }``; 0: no limit."""

    messages: Count = 0
    bytes: Count = 0


class SlotsSettings(Table):
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


class _Preset(Table):
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
