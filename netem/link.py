"""One direction of one link, without clock, socket or thread.

Must not know what the messages mean: a payload is opaque bytes.
"""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from random import Random
from typing import Protocol

from netem.duplicate import Duplicate
from netem.streams import stream

DELIVERED = "delivered"
DUPLICATED = "duplicated"
CORRUPTED = "corrupted"
LOST_RANDOM = "lost: random"
LOST_BURST = "lost: burst"
LOST_TRACE = "lost: trace"
LOST_QUEUE = "lost: queue"
LOST_LATE = "lost: late"
LOST_CUT = "lost: cut"


@dataclass(slots=True)
class Transit:
    """One copy of a message on its way through a link.

    Impairments change ``due_ns``, ``payload``, ``fate`` and ``hurried``; what was
    sent (``sequence``, ``sent_ns``) stays. ``fate`` is DELIVERED, DUPLICATED (a
    second copy, delivered), CORRUPTED (delivered damaged) or one of the LOST
    kinds; ``hurried`` says that the copy overtakes delay and rate.
    """

    sequence: int
    sent_ns: int
    due_ns: int
    payload: bytes
    fate: str = DELIVERED
    hurried: bool = False

    @property
    def lost(self) -> bool:
        """Whether the copy never arrives."""
        return self.fate.startswith("lost")


class Impairment(Protocol):
    """One thing that goes wrong on a link.

    An impairment holds its own state, so each object belongs to one link.
    ``name`` picks the random stream and must be unique within a link.
    """

    name: str

    def twin(self) -> "Impairment":
        """What duplicates meet: this object where they share its state (a rate, a queue).

        Otherwise a new one, so that duplication changes no draw of the originals.
        """
        ...

    def apply(self, copy: Transit, random: Random) -> None:
        """Decide about one copy.

        Called in the order of sending, also for a copy that an earlier
        impairment lost: an impairment draws for it all the same, so that its
        later draws do not depend on its predecessors, but lets it take no room
        and no time. A fate once lost stays.
        """
        ...


class Link:
    """A one-way link: ``send`` messages in, ``deliver`` them when they are due.

    ``impairments`` are applied in the order given; ``duplicate`` comes before
    them. ``seed``, ``source`` and ``destination`` name the random streams.

    Due times are exact integer nanoseconds: a message sent at ``s`` on a link
    with constant delay ``d`` is delivered by ``deliver(now)`` if and only if
    ``s + d <= now``; with zero delay that includes ``now == s``.

    Raises:
        ValueError: two impairments of one name.
    """

    def __init__(
        self,
        impairments: Sequence[Impairment],
        *,
        seed: int,
        source: object,
        destination: object,
        duplicate: Duplicate | None = None,
    ) -> None:
        self.source = source
        self.destination = destination
        self._seed = seed
        self._streams: dict[str, Random] = {}
        self._originals: list[tuple[Impairment, Random]] = []
        self._twins: list[tuple[Impairment, Random]] = []
        self._duplicates: tuple[Duplicate, Random] | None = None
        self._cut = False
        self._pending: list[tuple[int, int, Transit]] = []  # due, order of sending, copy
        self._order = 0
        self.change(impairments, duplicate)

    def change(self, impairments: Sequence[Impairment], duplicate: Duplicate | None = None) -> None:
        """Put ``impairments`` in the place of the link's own, for messages sent from now on.

        An object that the link holds already keeps its state; every random
        stream goes on where it is.

        Raises:
            ValueError: as for the constructor; the link stays as it was.
        """
        names = [impairment.name for impairment in impairments]
        if len(set(names)) != len(names):
            raise ValueError(f"impairments of one link need distinct names, got {names}")
        twins = {
            id(original): twin
            for (original, _), (twin, _) in zip(self._originals, self._twins, strict=False)
        }
        self._originals = [(stage, self._stream(stage.name)) for stage in impairments]
        self._twins, self._duplicates = [], None
        if duplicate is None:
            return  # twins are not free: a correlated delay calibrates its copula
        self._twins = [
            (twins.get(id(stage)) or stage.twin(), self._stream(f"{stage.name} of duplicates"))
            for stage in impairments
        ]
        self._duplicates = (duplicate, self._stream("duplicate"))

    def _stream(self, name: str) -> Random:
        if name not in self._streams:
            self._streams[name] = stream(self._seed, self.source, self.destination, name)
        return self._streams[name]

    def send(self, now_ns: int, sequence: int, payload: bytes) -> list[Transit]:
        """Put a message on the link at ``now_ns``; return every copy's fate.

        Messages must be sent in sequence order: the draws are.
        """
        copies = [Transit(sequence, now_ns, now_ns, payload)]
        if self._duplicates is not None:
            duplicate, random = self._duplicates
            if duplicate.doubles(random):
                copies.append(Transit(sequence, now_ns, now_ns, payload, DUPLICATED))
        stages = self._originals
        for transit in copies:
            for impairment, random in stages:
                impairment.apply(transit, random)
            stages = self._twins
            if not transit.lost:
                if self._cut:
                    transit.fate = LOST_CUT
                    continue
                self._order += 1
                heapq.heappush(self._pending, (transit.due_ns, self._order, transit))
        return copies

    def cut(self, *, lose_in_flight: bool) -> list[Transit]:
        """Lose whatever is sent from now on; returns what was in flight and is lost with it.

        Impairments go on drawing, so that a cut changes nothing after it.
        Deliver what is due before.
        """
        self._cut = True
        if not lose_in_flight:
            return []
        lost = [transit for _, _, transit in sorted(self._pending)]
        for transit in lost:
            transit.fate = LOST_CUT
        self._pending = []
        return lost

    def heal(self) -> None:
        """End a cut."""
        self._cut = False

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
