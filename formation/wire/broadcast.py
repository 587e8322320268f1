"""Broadcasts: the data of the experiment.

One robot's stamped state for its neighbours. Broadcasts pass through emulated links and are
trusted by nobody. They and their envelopes are fixed little-endian structures; floats travel as
IEEE 754 doubles, so a value arrives bit-identical.
"""

import struct
from hashlib import sha256
from typing import Final, NamedTuple
from zlib import crc32

from formnet.formation.wire.message_error import MessageError
from formnet.formation.wire.state import State, finite
from formnet.formation.wire.tuples import make

_BROADCAST_LAYOUT: Final = struct.Struct("<8sIqq5d")
BROADCAST_BYTES: Final = _BROADCAST_LAYOUT.size + 4
"""The size of every broadcast (72): links bill it, so it depends on nothing, not even the run."""


def run_tag(run: str) -> bytes:
    """The eight bytes that stand for run ``run`` in a broadcast: its SHA-256's first."""
    return sha256(run.encode(errors="surrogateescape")).digest()[:8]


class Broadcast(NamedTuple):
    """What robot ``robot`` of the run with this ``tag`` (see :func:`run_tag`) tells its neighbours.

    On the wire, BROADCAST_BYTES in this order: tag, robot as an unsigned 32-bit integer, sequence
    and stamp as 64-bit integers, the state as five doubles, and a CRC-32 of all that: a damaged
    state may be finite and still absurd.
    """

    tag: bytes
    robot: int
    sequence: int
    stamp_ns: int
    state: State

    def pack(self) -> bytes:
        return sealed(
            _BROADCAST_LAYOUT.pack(self.tag, self.robot, self.sequence, self.stamp_ns, *self.state)
        )

    @classmethod
    def unpack(cls, data: bytes) -> "Broadcast":
        """Decode and check a broadcast.

        Raises:
            MessageError: another size, damaged, or not finite.
        """
        if len(data) != BROADCAST_BYTES:
            raise MessageError(f"malformed: not {BROADCAST_BYTES} bytes")
        content = data[:-4]
        if data[-4:] != crc32(content).to_bytes(4, "little"):
            raise MessageError("damaged: its checksum is another")
        fields = _BROADCAST_LAYOUT.unpack(content)
        state = make(State, fields[4:])
        if not finite(state):
            raise MessageError("not finite: pose or velocity")
        return make(cls, (*fields[:4], state))


def sealed(content: bytes) -> bytes:
    """``content`` followed by its CRC-32, little-endian."""
    return content + crc32(content).to_bytes(4, "little")


_ENVELOPE_LAYOUT: Final = struct.Struct("<3q")


class Envelope(NamedTuple):
    """The runtime's note beside a broadcast (a Zenoh attachment).

    It tells a lockstep receiver that robot ``robot`` sent its broadcast of
    ``tick``, so that it can wait for exactly that; the emulated link and the
    law never see it. In real time, ``tick`` is the broadcast's stamp in nanoseconds.
    ``tick`` -1 is the hello of the start handshake.
    """

    robot: int
    sequence: int
    tick: int

    def pack(self) -> bytes:
        return _ENVELOPE_LAYOUT.pack(*self)

    @classmethod
    def unpack(cls, data: bytes) -> "Envelope":
        """Raises MessageError unless ``data`` is three 64-bit integers."""
        try:
            return make(cls, _ENVELOPE_LAYOUT.unpack(data))
        except struct.error:
            raise MessageError("malformed envelope: not three 64-bit integers") from None


HELLO: Final = -1
"""The tick of an envelope that says no more than "I can be heard"."""
