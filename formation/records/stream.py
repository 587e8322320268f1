"""A run's records as a stream of bytes, and read back.

In a distributed run it is a pipe of msgpack objects from the plant to the launcher, so what was
sent before a process was killed can still be read; each of them is on the bus once more, for
watchers. What is read is checked: it may come from anybody.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import isfinite
from typing import IO, Any, get_args, get_type_hints

import msgpack

from formnet.formation.records import checked, events
from formnet.formation.records.checked import Malformed, RobotId, plain
from formnet.formation.records.events import Event
from formnet.formation.records.outcome import Outcome, outcome
from formnet.formation.records.rows import LinkRow, LinkRows, Sample, Samples
from formnet.netem.core.transit import FATES


@dataclass(frozen=True)
class Stir:
    """To the launcher alone: let the stopped processes of ``robots`` run, or stop them again.

    Nothing happens to the robots; they only take in what lies in the network's buffers.
    """

    robots: tuple[RobotId, ...]
    running: bool


Record = Samples | LinkRows | Event | Outcome
Sink = Callable[[Record], None]
Streamed = Record | Stir
"""What a plant's stream holds."""


def pack(record: Streamed) -> bytes:
    """A record as it is in a stream; what is no text, as in names of files, is escaped."""
    match record:
        case Event() | Outcome():
            kind = "Event" if isinstance(record, Event) else "Outcome"
            fields = [kind, record.name, record.t_ns, record.details]
        case Samples() | LinkRows():
            fields = [type(record).__name__, record.rows]
        case Stir():
            fields = ["Stir", plain(record)]
    return msgpack.packb(fields, unicode_errors="backslashreplace")  # type: ignore[no-any-return]


def unpack(data: bytes, robots: Sequence[int]) -> Streamed:
    """One record of a run of ``robots`` (the scenario's, in its order).

    Raises:
        Malformed: ``data`` is none.
    """
    try:
        fields = msgpack.unpackb(data)
    except Exception as error:  # msgpack raises many kinds; all mean the same here
        raise Malformed.at("record", data[:20], f"is not msgpack: {error!r}") from None
    return _record(fields, robots)


def writer(stream: IO[bytes]) -> Callable[[Streamed], None]:
    """A sink that writes every record to ``stream`` at once."""

    def write(record: Streamed) -> None:
        stream.write(pack(record))
        stream.flush()

    return write


def read(stream: IO[bytes], robots: Sequence[int]) -> Iterator[Streamed]:
    """The records in ``stream`` until it ends; a record cut off at the end is dropped.

    ``robots`` are the scenario's, in its order.

    Raises:
        Malformed: the stream holds something else.
    """
    unpacker = msgpack.Unpacker(max_buffer_size=2**30)
    while chunk := stream.read1(2**16):  # type: ignore[attr-defined]
        unpacker.feed(chunk)
        while True:
            try:
                fields = unpacker.unpack()
            except msgpack.OutOfData:
                break
            except Exception as error:  # as above
                raise Malformed.at("record", chunk[:20], f"is not msgpack: {error!r}") from None
            yield _record(fields, robots)


def _record(fields: Any, robots: Sequence[int]) -> Streamed:
    match fields:
        case ["Samples", list(rows)]:
            return Samples(_samples(rows, robots))
        case ["LinkRows", list(rows)]:
            known = frozenset(robots)
            return LinkRows([_link_row(row, known) for row in rows])
        case ["Event", name, t_ns, details]:
            return events.event(name, t_ns, details, robots)
        case ["Outcome", kind, t_ns, details]:
            return outcome(kind, t_ns, details, robots)
        case ["Stir", details]:
            return checked.read(Stir, details, robots, "Stir")
    raise Malformed.at("record", fields, f"is none of {', '.join(_RECORDS)}")


_RECORDS = [kind.__name__ for kind in (Samples, LinkRows, Event, Outcome, Stir)]


def _types(row: type[Sample | LinkRow]) -> frozenset[tuple[type, ...]]:
    """The types that the values of a row may have together."""
    hints = get_type_hints(row).values()
    return frozenset(product(*(get_args(hint) or (hint,) for hint in hints)))


_SAMPLE_TYPES, _LINK_ROW_TYPES = _types(Sample), _types(LinkRow)


def _samples(rows: list[Any], robots: Sequence[int]) -> list[Sample]:
    """Whole ticks, robots in their order; states are finite, and torques what they were."""
    count = len(robots)
    found: list[Sample] = []
    for number, row in enumerate(rows):
        if type(row) is not list or tuple(map(type, row)) not in _SAMPLE_TYPES:
            raise Malformed.at("Samples", row, f"must be {', '.join(Sample._fields)}")
        sample = Sample(*row)
        if not (sample.t_ns < 2**63 and all(map(isfinite, row[2:7]))):
            raise Malformed.at("Samples", row, "must have a time of 64 bits and a finite state")
        place = number % count
        if sample.robot != robots[place] or (place and sample.t_ns != found[-1].t_ns):
            raise Malformed.at("Samples", row, "must be in whole ticks, robots in their order")
        found.append(sample)
    if len(rows) % count:
        raise Malformed.at("Samples", rows[-1], "must be of whole ticks")
    return found


def _link_row(row: Any, robots: frozenset[int]) -> LinkRow:
    if type(row) is not list or tuple(map(type, row)) not in _LINK_ROW_TYPES:
        raise Malformed.at("LinkRows", row, f"must be {', '.join(LinkRow._fields)}")
    found = LinkRow(*row)
    if found.source not in robots or found.destination not in robots:
        raise Malformed.at("LinkRows", row, "must be of the scenario's robots")
    if max(found.t_sent_ns, found.t_usable_ns or 0, found.sequence) >= 2**63:
        raise Malformed.at("LinkRows", row, "must have integers of 64 bits")
    if found.fate not in FATES:
        rule = f"the fate must be one of {', '.join(sorted(FATES))}"
        raise Malformed.at("LinkRows", row, rule)
    return found
