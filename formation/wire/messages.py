"""Messages between the plant and one robot, and their form on the wire.

They keep the time of a run, virtual or real, and belong to the runtime, not to the experiment,
whose data are broadcasts (:mod:`formation.wire.broadcast`).

Everything is msgpack, but for what is sent every tick (``Sense`` and ``Drive``, ``Ask`` and
``Measured``), which are fixed little-endian structures. Floats travel as IEEE 754 doubles, so a
value arrives bit-identical.
"""

import math
import struct
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import msgpack

from formnet.formation.records.rows import LinkRow
from formnet.formation.wire.message_error import MessageError
from formnet.formation.wire.state import State
from formnet.formation.wire.tuples import make
from formnet.netem.core.transit import FATES

PROTOCOL: Final = 6
"""Version of the messages, and of the arithmetic: a robot and a plant must agree on both."""

MOST_BYTES: Final = 8 * 2**20
"""The longest message: a plan with thousands of robots."""
MOST_TEXT: Final = 4000
"""The longest text in them, in characters, but for the plan."""


class Join(NamedTuple):
    """Robot to plant: I am here; repeated until the brief arrives."""

    robot: int
    protocol: int


class Brief(NamedTuple):
    """Plant to robot: your plan, as JSON (``RobotPlan.pack``), from ``tick`` on.

    ``neighbours`` are those to meet first (see :class:`Meet`).
    """

    plan: str
    tick: int
    neighbours: list[int]


class Meet(NamedTuple):
    """Plant to robot: these neighbours take part from ``tick`` on; say hello until you hear them.

    Until the next ``Sense``, for they have to hear you too.
    """

    tick: int
    neighbours: list[int]


class Ready(NamedTuple):
    """Robot to plant: I hear all whom I had to meet before ``tick``; repeated until then."""

    robot: int
    tick: int


class Gone(NamedTuple):
    """Plant to robot: ``robot`` is gone, unplanned, from ``tick`` on."""

    robot: int
    tick: int


class Sense(NamedTuple):
    """Plant to robot at tick ``tick``: your own state, measured."""

    tick: int
    state: State


class Drive(NamedTuple):
    """Robot to plant, the answer to ``Sense``: held from this tick to the next.

    ``right`` and ``left`` are wheel torques (N m) at the dynamic level; at the
    kinematic level they are speed (m/s) and turn rate (rad/s).
    """

    robot: int
    tick: int
    right: float
    left: float


class Waiting(NamedTuple):
    """Robot to plant: at ``tick`` I have been waiting for these neighbours for a while."""

    robot: int
    tick: int
    neighbours: list[int]


class Links(NamedTuple):
    """Robot to plant: fates of messages on my incoming links (rows of ``record.LinkRow``)."""

    robot: int
    rows: list[LinkRow]


class Rejected(NamedTuple):
    """Robot to plant: a message from ``source`` was refused, ``times`` so far for this reason.

    ``source`` is a robot's id, or PLANT: what came on the plant's key need not be the plant's.
    """

    robot: int
    source: int
    reason: str
    times: int


PLANT: Final = -1
"""Stands for the plant where else a robot's id does."""


class Failed(NamedTuple):
    """Robot to plant: I cannot go on."""

    robot: int
    error: str


class End(NamedTuple):
    """Plant to robot: it is over for you; robot to plant: I have said all I had to say.

    ``tick`` is the last one whose broadcasts were all sent.
    """

    robot: int
    reason: str
    tick: int


class Begin(NamedTuple):
    """Plant to robot, in real time: go on your own from here; it is ``t_ns``."""

    t_ns: int


class Ask(NamedTuple):
    """Robot to plant, in real time: where am I? For its control period ``number``."""

    robot: int
    number: int


class Measured(NamedTuple):
    """Plant to robot, the answer to ``Ask``: your own state at ``t_ns`` of the plant's time."""

    number: int
    t_ns: int
    state: State


class Timing(NamedTuple):
    """Robot to plant: how real time went so far.

    Of ``periods`` control periods it missed some: it woke too late for one, or the
    plant's answer was. Lists are [p50, p99, max] in seconds, or empty: by how much it woke late,
    and how long neighbours' messages were on the real network. ``uncertainty_s`` bounds the
    error of its estimate of the plant's clock, ``offset_s`` is the estimate.
    """

    robot: int
    periods: int
    missed: int
    lateness_s: list[float]
    transit_s: list[float]
    offset_s: float
    uncertainty_s: float


class CatchUp(NamedTuple):
    """Plant to a paused robot, let run for a moment: take in all broadcasts up to ``tick``.

    Robot to plant: I have. Otherwise they would fill the network's buffers, and those who
    send them would stand still.
    """

    robot: int
    tick: int


KILL: Final = "kill"
"""The reason of an End for a robot that is to be killed: it says its last and waits for that."""

Message = (
    Join
    | Brief
    | Meet
    | Ready
    | Gone
    | CatchUp
    | Sense
    | Drive
    | Waiting
    | Links
    | Rejected
    | Failed
    | End
    | Begin
    | Ask
    | Measured
    | Timing
)

_KINDS: Final[tuple[type[Message], ...]] = (
    Join,
    Brief,
    Ready,
    Waiting,
    Links,
    Rejected,
    Failed,
    End,
    Meet,
    Gone,
    CatchUp,
    Begin,
    Timing,
)
_TAGS: Final = {kind: tag for tag, kind in enumerate(_KINDS)}
_FIELD_TYPES: Final = {
    kind: [_type if isinstance(_type, type) else list for _type in kind.__annotations__.values()]
    for kind in _KINDS
}

_pack: Final[Callable[[Any], bytes]] = msgpack.Packer(autoreset=True).pack

# The messages of every tick have fixed layouts. Their first bytes are no msgpack list's.
_SENSE: Final = 0x01
_DRIVE: Final = 0x02
_ASK: Final = 0x03
_MEASURED: Final = 0x04
_SENSE_LAYOUT: Final = struct.Struct("<Bq5d")
_DRIVE_LAYOUT: Final = struct.Struct("<Bqq2d")
_ASK_LAYOUT: Final = struct.Struct("<Bqq")
_MEASURED_LAYOUT: Final = struct.Struct("<Bqq5d")


def _unpack(data: bytes) -> Any:
    try:
        return msgpack.unpackb(data)
    except Exception:  # msgpack raises many kinds; all mean the same here
        raise MessageError("malformed: not msgpack") from None


def encode(message: Message) -> bytes:
    """A lockstep message's bytes."""
    if isinstance(message, Drive):
        return _DRIVE_LAYOUT.pack(_DRIVE, *message)
    if isinstance(message, Sense):
        return _SENSE_LAYOUT.pack(_SENSE, message.tick, *message.state)
    if isinstance(message, Ask):
        return _ASK_LAYOUT.pack(_ASK, *message)
    if isinstance(message, Measured):
        return _MEASURED_LAYOUT.pack(_MEASURED, message.number, message.t_ns, *message.state)
    return _pack((_TAGS[type(message)], *message))


def decode(data: bytes) -> Message:
    """The lockstep message in ``data``.

    Raises:
        MessageError: oversized, unknown kind, wrong number of fields, or wrong types.
    """
    if len(data) > MOST_BYTES:
        raise MessageError(f"oversized: more than {MOST_BYTES} bytes")
    first = data[0] if data else -1
    try:
        if first == _DRIVE:
            _, robot, tick, right, left = _DRIVE_LAYOUT.unpack(data)
            return make(Drive, (robot, tick, right, left))
        if first == _SENSE:
            _, tick, x, y, heading, speed, turn_rate = _SENSE_LAYOUT.unpack(data)
            return make(Sense, (tick, make(State, (x, y, heading, speed, turn_rate))))
        if first == _ASK:
            return make(Ask, _ASK_LAYOUT.unpack(data)[1:])
        if first == _MEASURED:
            fields = _MEASURED_LAYOUT.unpack(data)
            return make(Measured, (fields[1], fields[2], make(State, fields[3:])))
    except struct.error:
        raise MessageError("malformed: a message of every tick with the wrong length") from None
    return _decode_rare(data)


def _decode_rare(data: bytes) -> Message:
    fields = _unpack(data)
    if type(fields) is not list or not fields or type(fields[0]) is not int:
        raise MessageError("malformed: not a tagged list")
    if not 0 <= fields[0] < len(_KINDS):
        raise MessageError(f"unknown kind {fields[0]}")
    kind: Any = _KINDS[fields[0]]
    if [type(value) for value in fields[1:]] != _FIELD_TYPES[kind]:
        raise MessageError(f"malformed: {kind.__name__}")
    if kind is Links:
        fields[2] = [_link_row(row) for row in fields[2]]
    else:
        longest = MOST_BYTES if kind is Brief else MOST_TEXT
        inner: Any = float if kind is Timing else int
        for value in fields[1:]:
            elements = value if type(value) is list else [value]
            if not all(_sound(element, longest) for element in elements):
                raise MessageError(f"out of range: {kind.__name__}")
            if type(value) is list and any(type(element) is not inner for element in value):
                raise MessageError(f"malformed: {kind.__name__}")
    message: Message = kind(*fields[1:])
    return message


def _sound(value: Any, longest: int) -> bool:
    """Whether it can be worked with: integers of 64 bits, finite numbers, texts not too long."""
    if type(value) is int:
        return -(2**63) <= value < 2**63
    if type(value) is float:
        return math.isfinite(value)
    return type(value) is not str or len(value) <= longest


def _link_row(row: Any) -> LinkRow:
    kinds = [type(value) for value in row] if type(row) is list else []
    usable = kinds[1:2] in ([int], [type(None)])
    if not usable or [*kinds[:1], *kinds[2:]] != [int, int, int, int, str]:
        raise MessageError("malformed: Links")
    _, _, source, destination, _, fate = row
    if not all(_sound(value, MOST_TEXT) for value in row) or fate not in FATES:
        raise MessageError("out of range: Links")
    if not (0 <= source < 2**31 and 0 <= destination < 2**31):
        raise MessageError("out of range: Links")
    return LinkRow(*row)
