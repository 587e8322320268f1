"""The tables of a link's settings, but for those of delay and loss, which come in kinds.

Each says in :meth:`StageTable.stages` which impairments it turns on, by the names that
:data:`formnet.netem.settings.links.PIPELINE` puts in order.
"""

from collections.abc import Callable, Mapping
from typing import Annotated

from pydantic import Field, model_validator

from formnet.netem.core.duplicate import Duplicate
from formnet.netem.core.link import Impairment
from formnet.netem.files.tables import Count, Probability, Seconds, Table, nanoseconds
from formnet.netem.impairments.corrupt import Corrupt
from formnet.netem.impairments.queue import QueueEntry, QueueExit, QueueLimit
from formnet.netem.impairments.rate import Rate
from formnet.netem.impairments.reorder import Reorder
from formnet.netem.impairments.slots import Slots

Stages = Mapping[str, Callable[[], Impairment]]
"""What makes each impairment that is on, by its name."""


class StageTable(Table):
    """A table that turns impairments on."""

    def stages(self) -> Stages:
        """What it turns on; nothing if it is off."""
        raise NotImplementedError


class DuplicateSettings(Table):
    """``duplicate = { probability = 0.01 }``"""

    probability: Probability = Field(
        default=0.0, description="Share of messages that are sent twice."
    )

    def duplicate(self) -> Duplicate | None:
        """What makes duplicates, if anything does."""
        return Duplicate(self.probability) if self.probability else None


class CorruptSettings(StageTable):
    """``corrupt = { probability = 0.001 }``"""

    probability: Probability = Field(
        default=0.0, description="Share of messages in which one bit is flipped."
    )

    def stages(self) -> Stages:
        return {"corrupt": lambda: Corrupt(self.probability)} if self.probability else {}


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


class RateSettings(StageTable):
    """``rate = { bits_per_s = 1_000_000, overhead_bytes = 38 }``; 0 bits_per_s: no limit."""

    bits_per_s: Count = Field(default=0, description="Rate limit; 0: no limit.")
    overhead_bytes: Count = Field(default=0, description="Added to every message.")
    cell_bytes: Count = Field(
        default=0, description="Messages fill whole cells of this size; 0: no cells."
    )
    cell_overhead_bytes: Count = Field(default=0, description="Added to every cell.")

    def stages(self) -> Stages:
        return {"rate": lambda: Rate(**dict(self))} if self.bits_per_s else {}


class QueueSettings(StageTable):
    """``queue = { messages = 1000, bytes = 64_000 }``; 0: no limit."""

    messages: Count = Field(
        default=0, description="Messages beyond this number in transit are lost; 0: no limit."
    )
    bytes: Count = Field(default=0, description="The same limit in bytes.")

    def stages(self) -> Stages:
        if not (self.messages or self.bytes):
            return {}
        limit = QueueLimit(self.messages, self.bytes)
        return {"queue": lambda: QueueEntry(limit), "queue exit": lambda: QueueExit(limit)}


class SlotsSettings(StageTable):
    """``slots = { min_s = 0.001, max_s = 0.002, messages = 8, bytes = 1500 }``; max_s = 0: none."""

    min_s: Seconds = Field(default=0.0, description="Shortest time between two slots.")
    max_s: Seconds = Field(default=0.0, description="Longest time between two slots; 0: no slots.")
    messages: Count = Field(default=0, description="Most messages per slot; 0: no limit.")
    bytes: Count = Field(default=0, description="Most bytes per slot; 0: no limit.")

    @model_validator(mode="after")
    def _ordered(self) -> "SlotsSettings":
        if self.max_s and not 1e-9 <= self.min_s <= self.max_s:
            raise ValueError(f"need 1e-9 <= min_s <= max_s, got {self.min_s} and {self.max_s}")
        return self

    def stages(self) -> Stages:
        if not self.max_s:
            return {}
        shortest_ns, longest_ns = nanoseconds(self.min_s), nanoseconds(self.max_s)
        return {"slots": lambda: Slots(shortest_ns, longest_ns, self.messages, self.bytes)}
