"""The messages of a lockstep tick as bytes made beforehand, and when each one is sent.

Shared by the exchanges that formnet is compared with, so that they carry bytes
of the same form and length as formnet's at tick 1000, and equally often.
"""

from typing import NamedTuple

from formnet.formation.wire.broadcast import Broadcast, Envelope, run_tag
from formnet.formation.wire.messages import Drive, Sense, encode
from formnet.formation.wire.state import State

BROADCAST_EVERY = 10
"""Ticks from one broadcast to the next: 10 ms at a control period of 1 ms."""

_TICK = 1000
_STATE = State(12.345678, -9.87654321, 1.2345678, 0.987654321, -0.12345678)


class Wire(NamedTuple):
    """One message of each kind, encoded."""

    sense: bytes
    drive: bytes
    broadcast: bytes
    envelope: bytes


def wire(run: str) -> Wire:
    """The messages of a robot of run ``run``."""
    sequence, stamp_ns = _TICK // BROADCAST_EVERY, _TICK * 1_000_000
    return Wire(
        sense=encode(Sense(_TICK, _STATE)),
        drive=encode(Drive(1, _TICK, 0.123456789, -0.987654321)),
        broadcast=Broadcast(run_tag(run), 1, sequence, stamp_ns, _STATE).pack(),
        envelope=Envelope(1, sequence, _TICK).pack(),
    )


def ring(robot: int, robots: int) -> list[int]:
    """The neighbours of ``robot`` (1 to ``robots``) on a ring, ascending."""
    return sorted({robot % robots + 1, (robot - 2) % robots + 1} - {robot})
