"""Slots: messages leave in bursts (TDMA, aggregation on Wi-Fi)."""

from bisect import bisect_left
from collections.abc import Sequence
from random import Random

from pydantic import Field, model_validator

from formnet.netem.core.link import Impairment
from formnet.netem.core.transit import Transit
from formnet.netem.files.tables import Count, Seconds, nanoseconds
from formnet.netem.impairments.stage import Stages, StageTable

_SLOTS_DRAWN = 1000


class Slots:
    """Messages leave in order, at the instants at which slots open.

    From one opening to the next it takes a time uniform between ``min_ns`` and
    ``max_ns``; a slot holds up to ``messages`` and ``bytes_`` (0: no limit; a
    message larger than that has a slot to itself). The first slot opens at 0.
    After a long idle time all slots but the last thousand are taken as ``max_ns`` long.
    No message passes what was under way when the slots were turned on.
    """

    name = "slots"

    def __init__(self, min_ns: int, max_ns: int, messages: int = 0, bytes_: int = 0) -> None:
        if not 0 < min_ns <= max_ns:
            raise ValueError(f"need 0 < min_ns <= max_ns, got min_ns={min_ns}, max_ns={max_ns}")
        if messages < 0 or bytes_ < 0:
            raise ValueError(f"messages and bytes must be >= 0, got {messages} and {bytes_}")
        self._min_ns = min_ns
        self._max_ns = max_ns
        self._span_ns = max_ns - min_ns + 1
        self._messages = messages
        self._bytes = bytes_
        self._openings = [0]  # all that are drawn from the last one before now on
        self._latest_ns = 0  # when the last message leaves, and those that leave with it:
        self._held = 0
        self._held_bytes = 0

    def twin(self) -> "Slots":
        return self

    def inherit(self, before: Impairment) -> None:
        if isinstance(before, Slots):
            self._openings = before._openings
            self._latest_ns = before._latest_ns
            self._held, self._held_bytes = before._held, before._held_bytes

    def occupy(self, under_way: Sequence[Transit]) -> None:
        self._latest_ns = max((copy.leaves_ns for copy in under_way), default=0)
        last = [len(copy.payload) for copy in under_way if copy.leaves_ns == self._latest_ns]
        self._held, self._held_bytes = len(last), sum(last)

    def apply(self, copy: Transit, random: Random) -> None:
        if copy.lost:
            return
        del self._openings[: max(0, bisect_left(self._openings, copy.sent_ns) - 1)]
        if copy.cut:
            self._opening(copy.due_ns, random)  # slots open as if it had come
            return
        size = len(copy.payload)
        opens_ns = self._opening(max(copy.due_ns, self._latest_ns), random)
        if opens_ns == self._latest_ns and self._full(size):
            opens_ns = self._opening(opens_ns + 1, random)
        if opens_ns != self._latest_ns:
            self._latest_ns = opens_ns
            self._held = self._held_bytes = 0
        self._held += 1
        self._held_bytes += size
        copy.due_ns = opens_ns

    def _opening(self, earliest_ns: int, random: Random) -> int:
        """When the first slot opens that opens at ``earliest_ns`` or later."""
        openings = self._openings
        skipped = (earliest_ns - openings[-1]) // self._max_ns - _SLOTS_DRAWN
        if skipped > 0:
            openings.append(openings[-1] + skipped * self._max_ns)
        while openings[-1] < earliest_ns:
            openings.append(openings[-1] + self._min_ns + int(random.random() * self._span_ns))
        index = bisect_left(openings, earliest_ns)
        if index == 0:
            return openings[0]
        before_ns = openings[index - 1]
        longest = -(-(earliest_ns - before_ns) // self._max_ns) * self._max_ns
        return min(openings[index], before_ns + longest)  # the sooner one among those skipped

    def _full(self, size: int) -> bool:
        if not self._held:
            return False
        too_many = self._messages > 0 and self._held >= self._messages
        return too_many or (self._bytes > 0 and self._held_bytes + size > self._bytes)


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

    @property
    def delays(self) -> bool:
        return self.max_s > 0
