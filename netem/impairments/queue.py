"""A queue of limited length: what does not fit is lost (tail drop)."""

import heapq
from collections.abc import Sequence
from random import Random

from pydantic import Field

from formnet.netem.core.link import Impairment
from formnet.netem.core.transit import LOST_QUEUE, Transit
from formnet.netem.files.tables import Count
from formnet.netem.impairments.stage import Stages, StageTable


class QueueLimit:
    """At most ``messages`` and ``bytes_`` under way at once, each 0 for no limit.

    Whatever has been sent and has not arrived counts, delayed messages too, as
    tc-netem's ``limit`` does. :class:`QueueEntry` must stand where a message
    would be refused, :class:`QueueExit` after everything that delays it.
    """

    def __init__(self, messages: int = 0, bytes_: int = 0) -> None:
        if messages < 0 or bytes_ < 0:
            raise ValueError(f"messages and bytes must be >= 0, got {messages} and {bytes_}")
        self._messages = messages
        self._bytes = bytes_
        self._departures: list[tuple[int, int]] = []  # when, bytes
        self._backlog_bytes = 0

    def admits(self, now_ns: int, size: int) -> bool:
        """Whether a message of ``size`` bytes finds room at ``now_ns``."""
        while self._departures and self._departures[0][0] <= now_ns:
            self._backlog_bytes -= heapq.heappop(self._departures)[1]
        if self._messages and len(self._departures) >= self._messages:
            return False
        return not self._bytes or self._backlog_bytes + size <= self._bytes

    def enter(self, leaves_ns: int, size: int) -> None:
        """Take the room of ``size`` bytes until ``leaves_ns``."""
        heapq.heappush(self._departures, (leaves_ns, size))
        self._backlog_bytes += size

    def occupy(self, under_way: Sequence[Transit]) -> None:
        """Have ``under_way`` take room, each until it leaves the line, and nothing else."""
        self._departures = [(copy.leaves_ns, len(copy.payload)) for copy in under_way]
        heapq.heapify(self._departures)
        self._backlog_bytes = sum(size for _, size in self._departures)

    def take_over(self, before: "QueueLimit") -> None:
        """Count what is under way in ``before`` as being here."""
        self._departures = before._departures
        self._backlog_bytes = before._backlog_bytes


class QueueEntry:
    """Loses what finds no room in ``limit``."""

    name = "queue"

    def __init__(self, limit: QueueLimit) -> None:
        self._limit = limit

    def twin(self) -> "QueueEntry":
        return self

    def inherit(self, before: Impairment) -> None:
        if isinstance(before, QueueEntry):
            self._limit.take_over(before._limit)

    def occupy(self, under_way: Sequence[Transit]) -> None:
        self._limit.occupy(under_way)

    def apply(self, copy: Transit, random: Random) -> None:
        if not copy.absent and not self._limit.admits(copy.sent_ns, len(copy.payload)):
            copy.fate = LOST_QUEUE


class QueueExit:
    """Notes when a message leaves ``limit`` again."""

    name = "queue exit"

    def __init__(self, limit: QueueLimit) -> None:
        self._limit = limit

    def twin(self) -> "QueueExit":
        return self

    def inherit(self, before: Impairment) -> None:
        """Nothing: the entry takes over what both share."""

    def apply(self, copy: Transit, random: Random) -> None:
        if not copy.absent:
            self._limit.enter(copy.due_ns, len(copy.payload))


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

    @property
    def loses(self) -> bool:
        return self.messages > 0 or self.bytes > 0
