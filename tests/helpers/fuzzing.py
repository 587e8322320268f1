"""``python tests/helpers/fuzzing.py``: broken messages at every decoder; whatever comes, none may raise.

Messages of every kind are mutated (bits, bytes, lengths, numbers, splices; a broadcast's
checksum is made good again half of the time) and given to the decoders, and to whole robots as
if they came from a neighbour. A decoder may refuse with MessageError and nothing else.
"""

import argparse
import random
import struct
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import msgpack

from formnet.agent.law import Command
from formnet.agent.robot import Robot
from formnet.agent.timed import TimedRobot
from formnet.formation.briefing.resolving import resolve
from formnet.formation.records.rows import LinkRow
from formnet.formation.scenario.loading import load
from formnet.formation.wire import messages
from formnet.formation.wire.broadcast import Broadcast, Envelope, run_tag, sealed
from formnet.formation.wire.message_error import MessageError
from formnet.formation.wire.messages import (
    Ask,
    Begin,
    Brief,
    CatchUp,
    Drive,
    End,
    Failed,
    Gone,
    Join,
    Links,
    Measured,
    Meet,
    Ready,
    Rejected,
    Sense,
    Timing,
    Waiting,
    decode,
    encode,
)
from formnet.formation.wire.state import State
from formnet.lab.scenarios.packaged import CONFIGS

_STATE = State(1.5, -2.5, 0.25, 0.0, -1e-3)
_LOCKSTEP: Sequence[messages.Message] = (
    Join(1, 3),
    Brief('{"robot": 1}', 0, [1, 2]),
    Meet(5, [2]),
    Ready(1, 0),
    Gone(3, 17),
    CatchUp(2, 8),
    Sense(4, _STATE),
    Drive(1, 4, 0.5, -0.5),
    Waiting(2, 9, [1, 3]),
    Links(1, [LinkRow(0, 5, 2, 1, 0, "delivered"), LinkRow(1, None, 2, 1, 1, "lost: cut")]),
    Rejected(1, 2, "why", 4),
    Failed(3, "what"),
    End(1, "completed", 100),
    Begin(0),
    Ask(1, 7),
    Measured(7, 70_000_000, _STATE),
    Timing(1, 100, 2, [0.1, 0.2, 0.3], [], -4.0, 1e-4),
)
_NUMBERS = (0, -1, 1, 2**31 - 1, 2**31, 2**63 - 1, 2**63, -(2**63))
_DOUBLES = (float("nan"), float("inf"), -float("inf"), 1e308, 5e-324, -0.0)


class Fuzzed(NamedTuple):
    """How many messages each decoder got, and what it raised that it must not."""

    tried: Counter[str]
    accepted: Counter[str]
    raised: list[str]


class _Nothing:
    def command(self, *_: Any) -> Command:
        return Command(0.0, 0.0)


def fuzz(count: int, seed: int) -> Fuzzed:
    """Give ``count`` broken messages to every decoder."""
    draw = random.Random(seed)
    scenario = load(CONFIGS / "paper" / "section5.toml")
    found = Fuzzed(Counter(), Counter(), [])
    virtual = Robot(resolve(scenario).robot(1), run="run", law=_Nothing())
    sensing = Robot(resolve(scenario).robot(1), run="run", law=_Nothing())
    timed = TimedRobot(resolve(scenario).robot(1), run="run", law=_Nothing())
    valid = [encode(message) for message in _LOCKSTEP]
    broadcast = Broadcast(run_tag("run"), 2, 3, 30_000_000, _STATE).pack()
    envelope = Envelope(2, 3, 30).pack()
    decoders: dict[str, tuple[Iterator[bytes], Callable[[bytes], Any]]] = {
        "lockstep": (_broken(draw, valid), decode),
        "broadcast": (_resealed(draw, broadcast), Broadcast.unpack),
        "envelope": (_broken(draw, [envelope]), Envelope.unpack),
        "a robot's senses, in lockstep": (
            _broken(draw, [encode(Sense(40, _STATE))]),
            lambda data: _feel(sensing, decode(data)),
        ),
        "a robot's ear, in lockstep": (
            _resealed(draw, broadcast),
            lambda data: virtual.on_broadcast(2, data, _one(draw, envelope)),
        ),
        "a robot's ear, in real time": (
            _resealed(draw, broadcast),
            lambda data: _hear(timed, draw, data, _one(draw, envelope)),
        ),
    }
    for name, (mutated, take) in decoders.items():
        for number in range(count):
            data = next(mutated)
            found.tried[name] += 1
            try:
                take(data)
                found.accepted[name] += 1
            except MessageError:
                pass
            except Exception:
                found.raised.append(f"{name}, message {number} {data!r}:\n{traceback.format_exc()}")
    return found


def _feel(robot: Robot, message: messages.Message) -> None:
    if isinstance(message, Sense):
        robot.on_sense(message)


def _hear(robot: TimedRobot, draw: random.Random, data: bytes, envelope: bytes) -> None:
    now_ns = draw.randrange(0, 10**9)
    robot.on_broadcast(2, data, envelope, now_ns)
    robot.on_measured(Measured(draw.randrange(100), now_ns + 10**8, _STATE))
    robot.take_link_rows()


def _broken(draw: random.Random, valid: Sequence[bytes]) -> Iterator[bytes]:
    while True:
        yield _one(draw, draw.choice(valid), valid)


def _resealed(draw: random.Random, valid: bytes) -> Iterator[bytes]:
    while True:
        data = _one(draw, valid[:-4])
        yield sealed(data) if draw.random() < 0.5 else data


def _one(draw: random.Random, data: bytes, others: Sequence[bytes] = (b"",)) -> bytes:
    """``data`` after one to four mutations."""
    content = bytearray(data)
    for _ in range(draw.randrange(1, 5)):
        place = draw.randrange(len(content) + 1)
        match draw.randrange(8):
            case 0 if content:
                content[place - 1] ^= 1 << draw.randrange(8)
            case 1:
                content[place:place] = draw.randbytes(draw.randrange(1, 9))
            case 2:
                del content[place:]
            case 3:
                del content[place : place + draw.randrange(1, 9)]
            case 4:
                content[place : place + 8] = struct.pack("<d", draw.choice(_DOUBLES))
            case 5:
                number = draw.choice(_NUMBERS)
                content[place : place + 1] = msgpack.packb(number)
            case 6:
                content[place:] = draw.choice(others)[draw.randrange(8) :]
            case _ if content:
                content[place - 1] = draw.choice((0x00, 0x90, 0x9F, 0xC1, 0xC6, 0xDC, 0xDD, 0xFF))
    return bytes(content)


def main() -> int:
    """0 if no decoder raised anything but MessageError, else 1."""
    parser = argparse.ArgumentParser(description="Broken messages at every decoder.")
    parser.add_argument("--messages", type=int, default=1_000_000, help="for each decoder")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    found = fuzz(asked.messages, asked.seed)
    for name, count in found.tried.items():
        print(f"{name}: {count} messages, {count - found.accepted[name]} refused")
    print(f"seed {asked.seed}: {len(found.raised)} escaped")
    for text in found.raised[:5]:
        print(text)
    return 1 if found.raised else 0


if __name__ == "__main__":
    sys.exit(main())
