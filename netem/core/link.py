"""One direction of one link, without clock, socket or thread.

Must not know what the messages mean: a payload is opaque bytes.
"""

import heapq
from collections.abc import Sequence
from random import Random
from typing import Any, Protocol

from formnet.netem.core.duplicate import Duplicate
from formnet.netem.core.shared import Shared
from formnet.netem.core.streams import stream
from formnet.netem.core.transit import DUPLICATED, LOST_CUT, Transit


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
        impairment lost and for one sent on a link that is cut: an impairment
        draws for it all the same, so that its later draws do not depend on its
        predecessors or on the cut, but lets it take no room and no time
        (``Transit.absent``). A fate once lost stays.
        """
        ...

    def inherit(self, before: "Impairment") -> None:
        """Go on from the state of ``before``, of the same name, in whose place this one comes.

        A burst, a backlog or a count survives a change of settings; nothing is
        taken over from another kind of impairment.
        """
        ...


class _Draws:
    """A link's impairments with the streams from which one kind of message draws."""

    def __init__(
        self,
        originals: list[tuple[Impairment, Random]],
        twins: list[tuple[Impairment, Random]],
        duplicate: Random,
    ) -> None:
        self.originals = originals
        self.twins = twins
        self.duplicate = duplicate


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
        self._streams: dict[tuple[str, str], Random] = {}
        self._originals: list[Impairment] = []
        self._twins: list[Impairment] = []
        self._duplicate: Duplicate | None = None
        self._kinds: dict[str, _Draws] = {}
        self._cut = False
        self._pending: list[tuple[int, int, Transit]] = []  # due, order of sending, copy
        self._refused: list[tuple[int, int, Transit]] = []  # by the receiver: leaves, likewise
        self._order = 0
        self.change(impairments, duplicate)

    def change(self, impairments: Sequence[Impairment], duplicate: Duplicate | None = None) -> None:
        """Put ``impairments`` in the place of the link's own, for messages sent from now on.

        An object that the link holds already stays as it is, one in whose place
        another of its name comes hands its state on, and every random stream
        goes on where it is. What is under way takes room and time in a :class:`Shared`
        one that is turned on, and is not overtaken where order is kept.

        Raises:
            ValueError: as for the constructor; the link stays as it was.
        """
        names = [impairment.name for impairment in impairments]
        if len(set(names)) != len(names):
            raise ValueError(f"impairments of one link need distinct names, got {names}")
        twins = dict(zip(map(id, self._originals), self._twins, strict=False))
        before = {stage.name: stage for stage in self._originals}
        before_twins = {stage.name: stage for stage in self._twins}
        held, self._originals = self._originals, list(impairments)
        for stage in self._originals:
            known = before.get(stage.name)
            if isinstance(stage, Shared) and type(known) is not type(stage):
                stage.occupy(self._under_way())
            _inherit(stage, known)
        self._hand_over([stage.name for stage in held if isinstance(stage, Shared)])
        self._twins = []
        if duplicate is not None:  # twins are not free: a correlated delay calibrates its copula
            self._twins = [twins.get(id(stage)) or stage.twin() for stage in self._originals]
            for original, twin in zip(self._originals, self._twins, strict=True):
                if twin is not original:
                    _inherit(twin, before_twins.get(twin.name))
        self._duplicate = duplicate
        self._kinds = {}

    def _hand_over(self, shared: list[str]) -> None:
        """Where the last of what was ``shared`` is off, have the last that is still on know
        when what is under way leaves: it has not seen what held it up behind it."""
        stages = {stage.name: stage for stage in self._originals}
        still_on = [name for name in shared if name in stages]
        if still_on and still_on[-1] != shared[-1]:
            last = stages[still_on[-1]]
            if isinstance(last, Shared):
                last.occupy(self._under_way())

    def _under_way(self) -> list[Transit]:
        """What has not left the line, as far as is known, also if the receiver will refuse it."""
        return [transit for _, _, transit in [*self._pending, *self._refused]]

    @property
    def impairments(self) -> list[Impairment]:
        """What a message meets, in order."""
        return list(self._originals)

    def _draws_of(self, kind: str) -> _Draws:
        draws = self._kinds.get(kind)
        if draws is None:
            draws = self._kinds[kind] = _Draws(
                [(stage, self._stream(stage.name, kind)) for stage in self._originals],
                [
                    (stage, self._stream(f"{stage.name} of duplicates", kind))
                    for stage in self._twins
                ],
                self._stream("duplicate", kind),
            )
        return draws

    def _stream(self, name: str, kind: str) -> Random:
        if (name, kind) not in self._streams:
            self._streams[name, kind] = stream(
                self._seed, self.source, self.destination, name, kind
            )
        return self._streams[name, kind]

    def send(
        self, now_ns: int, sequence: int, payload: bytes, *, kind: str = "", note: Any = None
    ) -> list[Transit]:
        """Put a message on the link at ``now_ns``; return every copy's fate.

        Messages must be sent in sequence order: the draws are. Each ``kind`` of
        message draws from streams of its own, so that a new kind changes no draw
        of the others, though all share the line. ``note`` travels along unread.
        """
        draws = self._draws_of(kind)
        copies = [Transit(sequence, now_ns, now_ns, payload, note=note)]
        if self._duplicate is not None and self._duplicate.doubles(draws.duplicate):
            copies.append(Transit(sequence, now_ns, now_ns, payload, DUPLICATED, note=note))
        stages = draws.originals
        for transit in copies:
            transit.cut = self._cut
            for impairment, random in stages:
                impairment.apply(transit, random)
            stages = draws.twins
            if not transit.lost:
                if self._cut:
                    transit.fate = LOST_CUT
                    continue
                self._order += 1
                heapq.heappush(self._pending, (transit.due_ns, self._order, transit))
            elif transit.left_ns is not None and not self._cut:
                self._note_refused(transit)
        return copies

    def _note_refused(self, transit: Transit) -> None:
        """Remember a copy that is on the line although the receiver will refuse it."""
        while self._refused and self._refused[0][0] <= transit.sent_ns:
            heapq.heappop(self._refused)
        self._order += 1
        heapq.heappush(self._refused, (transit.leaves_ns, self._order, transit))

    def cut(self, now_ns: int, *, lose_in_flight: bool) -> list[Transit]:
        """Lose whatever is sent from now on, and what is due after ``now_ns`` if asked to.

        Returns what was in flight and is lost, in the order it would have come.
        Impairments go on drawing, so that a cut changes nothing after it; what it
        loses takes no room and no time.
        """
        self._cut = True
        if not lose_in_flight:
            return []
        lost = [transit for due_ns, _, transit in sorted(self._pending) if due_ns > now_ns]
        for transit in lost:
            transit.fate = LOST_CUT
        self._pending = [entry for entry in self._pending if not entry[2].lost]
        heapq.heapify(self._pending)
        self._refused = []
        for stage in self._originals:
            if isinstance(stage, Shared):
                stage.occupy(self._under_way())
        return lost

    def heal(self) -> None:
        """End a cut; what it lost stays lost."""
        self._cut = False

    @property
    def in_flight(self) -> list[Transit]:
        """What is on the link, earliest due first."""
        return [transit for _, _, transit in sorted(self._pending)]

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


def _inherit(stage: Impairment, before: Impairment | None) -> None:
    if before is not None and before is not stage:
        stage.inherit(before)
