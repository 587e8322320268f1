"""Rate: a link that takes its time to send a message."""

from collections.abc import Sequence
from random import Random

from pydantic import Field

from formnet.netem.core.link import Impairment
from formnet.netem.core.transit import Transit
from formnet.netem.files.tables import Count
from formnet.netem.impairments.stage import Stages, StageTable


class Rate:
    """At most ``bits_per_s``; a message goes out when the one before it has left.

    The time on the line of a payload of n bytes is that of L = n +
    ``overhead_bytes``; with cells, L = ceil(L / cell_bytes) · (cell_bytes +
    cell_overhead_bytes) (tc-netem(8): ATM, for example). It ends at
    max(arrival, end of the one before) + 8 L / rate, rounded up to whole
    nanoseconds, so the rate is exceeded over no stretch of time, order is kept,
    and idle time earns no credit. Put it after delay: the line is at the far end.
    Turned on, the line is free when the last of what is under way has left.
    """

    name = "rate"

    def __init__(
        self,
        bits_per_s: int,
        overhead_bytes: int = 0,
        cell_bytes: int = 0,
        cell_overhead_bytes: int = 0,
    ) -> None:
        if bits_per_s < 1:
            raise ValueError(f"bits_per_s must be >= 1, got {bits_per_s}")
        if min(overhead_bytes, cell_bytes, cell_overhead_bytes) < 0:
            raise ValueError(
                "overhead_bytes, cell_bytes and cell_overhead_bytes must be >= 0, got "
                f"{overhead_bytes}, {cell_bytes}, {cell_overhead_bytes}"
            )
        self._bits_per_s = bits_per_s
        self._overhead = overhead_bytes
        self._cell = cell_bytes
        self._cell_overhead = cell_overhead_bytes
        self._free_ns = 0

    def duration_ns(self, payload_bytes: int) -> int:
        """How long a payload is on the line."""
        length = payload_bytes + self._overhead
        if self._cell:
            length = -(-length // self._cell) * (self._cell + self._cell_overhead)
        return -(-8 * length * 1_000_000_000 // self._bits_per_s)

    def twin(self) -> "Rate":
        return self

    def inherit(self, before: Impairment) -> None:
        if isinstance(before, Rate):
            self._free_ns = before._free_ns

    def occupy(self, under_way: Sequence[Transit]) -> None:
        self._free_ns = max((copy.leaves_ns for copy in under_way), default=0)

    def apply(self, copy: Transit, random: Random) -> None:
        if copy.absent or copy.hurried:
            return
        start_ns = max(copy.due_ns, self._free_ns)
        self._free_ns = start_ns + self.duration_ns(len(copy.payload))
        copy.due_ns = self._free_ns


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

    @property
    def delays(self) -> bool:
        return self.bits_per_s > 0
