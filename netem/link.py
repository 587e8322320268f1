"""One direction of one link, without clock, socket or thread.

Must not know what the messages mean: a payload is opaque bytes.
"""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from random import Random
from typing import Protocol

from netem.streams import stream

DELIVERED = "delivered"
LOST_RANDOM = "lost: random"


@dataclass(slots=True)
class Transit:
    """One copy of a message on its way through a link.

    Impairments change ``due_ns``, ``fate`` and ``payload``; what was sent
    (``sequence``, ``sent_ns``) stays.
    """

    sequence: int
    sent_ns: int
    due_ns: int
    payload: bytes
    fate: str = DELIVERED


class Impairment(Protocol):
    """One thing that goes wrong on a link.

    ``name`` picks the random stream and must be unique within a link.
    """

    @property
    def name(self) -> str: ...

    def apply(self, copies: list[Transit], random: Random) -> list[Transit]:
        """Take the copies of one message and return what becomes of them.

        Called once per message, in sequence order, also for a message that an
        earlier impairment lost: an impairment draws for it all the same, so
        that its later draws do not depend on its predecessors. A lost copy
        stays in the list with its fate; the list may grow (duplicates).
        """
        ...


class Link:
    """A one-way link: ``send`` messages in, ``deliver`` them when they are due.

    ``impairments`` are applied in the order given. ``seed``, ``source`` and
    ``destination`` name the random streams.

    Due times are exact integer nanoseconds: a message sent at ``s`` on a link
    with constant delay ``d`` is delivered by ``deliver(now)`` if and only if
    ``s + d <= now``; with zero delay that includes ``now == s``.
    """

    def __init__(
        self,
        impairments: Sequence[Impairment],
        *,
        seed: int,
        source: object,
        destination: object,
    ) -> None:
        names = [impairment.name for impairment in impairments]
        if len(set(names)) != len(names):
            raise ValueError(f"impairments of one link need distinct names, got {names}")
        self.source = source
        self.destination = destination
        self._stages = [
            (impairment, stream(seed, source, destination, impairment.name))
            for impairment in impairments
        ]
        self._pending: list[tuple[int, int, Transit]] = []  # due, order of sending, copy
        self._order = 0

    def send(self, now_ns: int, sequence: int, payload: bytes) -> list[Transit]:
        """Put a message on the link at ``now_ns``; return every copy's fate.

        Messages must be sent in sequence order: the draws are.
        """
        copies = [Transit(sequence, now_ns, now_ns, payload)]
        for impairment, random in self._stages:
            copies = impairment.apply(copies, random)
        for copy in copies:
            if copy.fate == DELIVERED:
                self._order += 1
                heapq.heappush(self._pending, (copy.due_ns, self._order, copy))
        return copies

    @property
    def next_due_ns(self) -> int | None:
        """When the next delivery is due, or None when nothing is in flight."""
        return self._pending[0][0] if self._pending else None

    def deliver(self, now_ns: int) -> list[Transit]:
        """Take off the link all that is due by ``now_ns``, earliest first.

        Copies due at the same instant come in the order they were sent.
        """
        due: list[Transit] = []
        while self._pending and self._pending[0][0] <= now_ns:
            due.append(heapq.heappop(self._pending)[2])
        return due
