"""Slots: messages leave in bursts (TDMA, aggregation on Wi-Fi)."""

from random import Random

from netem.link import Impairment, Transit

_SLOTS_DRAWN = 1000


class Slots:
    """Messages leave in order, at the instants at which slots open.

    From one opening to the next it takes a time uniform between ``min_ns`` and
    ``max_ns``; a slot holds up to ``messages`` and ``bytes_`` (0: no limit; a
    message larger than that has a slot to itself). The first slot opens at 0.
    After a long idle time all slots but the last thousand are taken as ``max_ns`` long.
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
        self._open_ns = 0
        self._held = 0
        self._held_bytes = 0

    def twin(self) -> "Slots":
        return self

    def inherit(self, before: Impairment) -> None:
        if isinstance(before, Slots):
            self._open_ns = before._open_ns
            self._held, self._held_bytes = before._held, before._held_bytes

    def apply(self, copy: Transit, random: Random) -> None:
        if copy.lost:
            return
        size = len(copy.payload)
        self._skip(copy.due_ns)
        while self._open_ns < copy.due_ns or self._full(size):
            self._open_ns += self._min_ns + int(random.random() * self._span_ns)
            self._held = self._held_bytes = 0
        self._held += 1
        self._held_bytes += size
        copy.due_ns = self._open_ns

    def _skip(self, until_ns: int) -> None:
        skipped = (until_ns - self._open_ns) // self._max_ns - _SLOTS_DRAWN
        if skipped > 0:
            self._open_ns += skipped * self._max_ns
            self._held = self._held_bytes = 0

    def _full(self, size: int) -> bool:
        if not self._held:
            return False
        too_many = self._messages > 0 and self._held >= self._messages
        return too_many or (self._bytes > 0 and self._held_bytes + size > self._bytes)
