"""What a run reports while it goes on: a stream of records, and its form as bytes.

The plant emits it; the lab consumes it. In a distributed run it is a pipe of
msgpack objects, so what was sent before a process was killed can still be read.
"""

from collections.abc import Callable, Iterator
from typing import IO, Any, NamedTuple

import msgpack


class Sample(NamedTuple):
    """One robot at one recorded instant, with what it applies from there on.

    The torques are those that reach the wheels (after the limit); None at the
    kinematic level, which has no torques.
    """

    t_ns: int
    robot: int
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    turn_rate_radps: float
    torque_right_nm: float | None
    torque_left_nm: float | None


class LinkRow(NamedTuple):
    """What became of one message on one directed link.

    ``t_usable_ns`` is from when on the receiver could use it, None if it is lost or was
    still in flight at the receiver's last tick.
    """

    t_sent_ns: int
    t_usable_ns: int | None
    source: int
    destination: int
    sequence: int
    fate: str


class Samples(NamedTuple):
    """Consecutive samples, whole ticks only."""

    rows: list[Sample]


class LinkRows(NamedTuple):
    """Fates of messages, in no order."""

    rows: list[LinkRow]


class Event(NamedTuple):
    """Something worth a line in ``events.jsonl``: what, at which virtual time, and details.

    Every run has ``started`` before its first tick and, if it came that far,
    ``last tick`` after its last, before the robots hand in their last reports. One that began
    ends with ``extremes``, those of the motion (:meth:`plant.extremes.Extremes.details`).
    """

    kind: str
    t_ns: int
    details: dict[str, Any]


class Stir(NamedTuple):
    """To the launcher alone: let the stopped processes of ``robots`` run, or stop them again.

    Nothing happens to the robots; they only take in what lies in the network's buffers.
    """

    robots: list[int]
    running: bool


class Outcome(NamedTuple):
    """How the run ended, at virtual time ``t_ns``.

    ``kind`` is ``completed``, ``diverged``, ``interrupted``, ``lost`` (a robot
    died), ``failed`` (a robot could not go on) or ``broken`` (the rest).
    """

    kind: str
    t_ns: int
    robot: int | None
    reason: str


Record = Samples | LinkRows | Event | Outcome
Sink = Callable[[Record], None]
Streamed = Record | Stir
"""What a plant's stream holds."""

_KINDS: dict[str, type[Streamed]] = {
    k.__name__: k for k in (Samples, LinkRows, Event, Stir, Outcome)
}


def pack(record: Streamed) -> bytes:
    """A record as it is in a stream."""
    return msgpack.packb((type(record).__name__, *record))  # type: ignore[no-any-return]


def unpack(data: bytes) -> Streamed:
    """One record. Raises ValueError, TypeError or KeyError if ``data`` is none."""
    return _record(*msgpack.unpackb(data))


def writer(stream: IO[bytes]) -> Callable[[Streamed], None]:
    """A sink that writes every record to ``stream`` at once."""

    def write(record: Streamed) -> None:
        stream.write(pack(record))
        stream.flush()

    return write


def read(stream: IO[bytes]) -> Iterator[Streamed]:
    """The records in ``stream`` until it ends; a record cut off at the end is dropped."""
    unpacker = msgpack.Unpacker(max_buffer_size=2**30)
    while chunk := stream.read1(2**16):  # type: ignore[attr-defined]
        unpacker.feed(chunk)
        for name, *fields in unpacker:
            yield _record(name, *fields)


def _record(name: str, *fields: Any) -> Streamed:
    kind = _KINDS[name]
    if kind is Samples:
        return Samples([Sample(*row) for row in fields[0]])
    if kind is LinkRows:
        return LinkRows([LinkRow(*row) for row in fields[0]])
    return kind(*fields)
