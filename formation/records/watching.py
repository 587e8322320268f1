"""What a plant puts on the bus for watchers: each record with its number, and the history.

Both are read as strangers' data: without keys anybody on the bus may send them.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import msgpack

from formnet.formation.records.checked import Malformed
from formnet.formation.records.stream import Record, Stir, unpack


class History(NamedTuple):
    """For who comes late: the scenario (TOML), what happened so far, and what comes next.

    ``events`` are packed records, ``number`` is that of the next record on the bus.
    """

    scenario: str
    events: list[bytes]
    number: int


def pack_numbered(number: int, packed: bytes) -> bytes:
    """A record (:func:`formation.records.stream.pack`) as it is on the bus."""
    return msgpack.packb((number, packed))  # type: ignore[no-any-return]


def unpack_numbered(data: bytes, robots: Sequence[int]) -> tuple[int, Record]:
    """The number of a record on the bus, and the record; ``robots`` are the scenario's.

    Raises:
        Malformed: ``data`` are none.
    """
    match _unpacked(data):
        case [int(number), bytes(packed)] if type(number) is int and 0 <= number < 2**63:
            return number, unpack_shown(packed, robots)
    raise Malformed.at("message", data[:20], "must be a record with its number")


def unpack_shown(packed: bytes, robots: Sequence[int]) -> Record:
    """A record that is for everybody. Raises Malformed."""
    record = unpack(packed, robots)
    if isinstance(record, Stir):
        raise Malformed.at("record", "Stir", "is for the launcher alone")
    return record


def pack_history(history: History) -> bytes:
    """A history as it is on the bus."""
    return msgpack.packb(history)  # type: ignore[no-any-return]


def unpack_history(data: bytes) -> History:
    """The history that a plant has answered with; its records are still packed.

    Raises:
        Malformed: ``data`` are none.
    """
    match _unpacked(data):
        case [str(scenario), list(events), int(number)] if (
            all(type(event) is bytes for event in events) and type(number) is int and number >= 0
        ):
            return History(scenario, events, number)
    raise Malformed.at("history", data[:20], "must be a scenario, events and a number")


def _unpacked(data: bytes) -> Any:
    try:
        return msgpack.unpackb(data)
    except Exception as error:  # msgpack raises many kinds; all mean the same here
        raise Malformed.at("message", data[:20], f"is not msgpack: {error!r}") from None
