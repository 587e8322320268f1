"""Messages and records: every bit survives, and nothing that is not a message gets in."""

import math
import struct
import typing
from hashlib import sha256
from zlib import crc32

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from formnet.formation.records.rows import LinkRow
from formnet.formation.wire import messages
from formnet.formation.wire.broadcast import BROADCAST_BYTES, Broadcast, Envelope, run_tag, sealed
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
from formnet.netem.core.transit import FATES

finite = st.floats(allow_nan=False, allow_infinity=False)
integers = st.integers(-(2**63), 2**63 - 1)
texts = st.text("aZ09 -_\x00\x1f\x7fé√\u2028\uffff\U0001f600", max_size=20)
states = st.builds(State, finite, finite, finite, finite, finite)
wild_states = st.builds(State, *[st.floats()] * 5)
ids = st.integers(0, 2**31 - 1)
fates = st.sampled_from(sorted(FATES))
link_rows = st.builds(LinkRow, integers, st.none() | integers, ids, ids, integers, fates)
tags = st.binary(min_size=8, max_size=8)
broadcasts = st.builds(Broadcast, tags, st.integers(0, 2**32 - 1), integers, integers, states)

KINDS = {
    Join: st.builds(Join, integers, integers),
    Brief: st.builds(Brief, texts, integers, st.lists(integers, max_size=5)),
    Meet: st.builds(Meet, integers, st.lists(integers, max_size=5)),
    Ready: st.builds(Ready, integers, integers),
    Gone: st.builds(Gone, integers, integers),
    CatchUp: st.builds(CatchUp, integers, integers),
    Begin: st.builds(Begin, integers),
    Ask: st.builds(Ask, integers, integers),
    Measured: st.builds(Measured, integers, integers, wild_states),
    Timing: st.builds(
        Timing, integers, integers, integers, st.lists(finite), st.lists(finite), finite, finite
    ),
    Sense: st.builds(Sense, integers, wild_states),
    Drive: st.builds(Drive, integers, integers, st.floats(), st.floats()),
    Waiting: st.builds(Waiting, integers, integers, st.lists(integers, max_size=5)),
    Links: st.builds(Links, integers, st.lists(link_rows, max_size=3)),
    Rejected: st.builds(Rejected, integers, integers, texts, integers),
    Failed: st.builds(Failed, integers, texts),
    End: st.builds(End, integers, texts, integers),
}
EDGES = [0.0, -0.0, 5e-324, -5e-324, 2.2250738585072014e-308, 1.7976931348623157e308, 0.1]
GOOD = Broadcast(run_tag("run"), 3, 17, 170_000_000, State(1.5, -2.5, 0.25, 3.5, -0.5))


def bits(value):
    """``value`` with every float as its bytes, so that == tells -0.0 from 0.0 and knows NaN."""
    if isinstance(value, float):
        return struct.pack("<d", value)
    if isinstance(value, tuple | list):
        return [bits(item) for item in value]
    return value


# --- round trips ----------------------------------------------------------------------


def test_every_kind_of_message_is_tested_here():
    assert set(typing.get_args(messages.Message)) == set(KINDS)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@given(data=st.data())
def test_lockstep_message_arrives_bit_identical(kind, data):
    message = data.draw(KINDS[kind])
    arrived = decode(encode(message))
    assert type(arrived) is kind
    assert bits(arrived) == bits(message)


def test_sense_arrives_with_a_state():
    assert type(decode(encode(Sense(4, GOOD.state))).state) is State


@given(broadcasts)
def test_broadcast_arrives_bit_identical(broadcast):
    arrived = Broadcast.unpack(broadcast.pack())
    assert type(arrived) is Broadcast
    assert type(arrived.state) is State
    assert bits(arrived) == bits(broadcast)


@pytest.mark.parametrize("value", EDGES)
@pytest.mark.parametrize("place", range(5))
def test_edge_of_the_floats_arrives_bit_identical(value, place):
    state = State(*[value if i == place else 1.0 for i in range(5)])
    arrived = Broadcast.unpack(GOOD._replace(state=state).pack())
    assert bits(arrived.state) == bits(state)
    assert bits(decode(encode(Sense(1, state))).state) == bits(state)


def test_broadcast_of_large_finite_values_is_not_called_infinite():
    """Each is finite although their sum is not."""
    state = State(1.7e308, 1.7e308, 0.0, 0.0, 0.0)
    assert Broadcast.unpack(GOOD._replace(state=state).pack()).state == state


@given(integers, integers, integers)
def test_envelope_arrives_identical(robot, sequence, tick):
    envelope = Envelope(robot, sequence, tick)
    arrived = Envelope.unpack(envelope.pack())
    assert type(arrived) is Envelope
    assert arrived == envelope


# --- what is refused ------------------------------------------------------------------


@pytest.mark.parametrize("value", [math.nan, -math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", range(5))
def test_broadcast_that_is_not_finite_is_refused(place, value):
    state = State(*[value if i == place else 1.0 for i in range(5)])
    with pytest.raises(MessageError, match="not finite"):
        Broadcast.unpack(GOOD._replace(state=state).pack())


def test_opposite_infinities_do_not_cancel():
    state = State(math.inf, -math.inf, 0.0, 0.0, 0.0)
    with pytest.raises(MessageError, match="not finite"):
        Broadcast.unpack(GOOD._replace(state=state).pack())


def test_broadcast_of_another_size_is_malformed():
    data = GOOD.pack()
    for cut in range(len(data)):
        for wrong in (data[:cut], sealed(data[:cut])):
            if len(wrong) != len(data):
                with pytest.raises(MessageError, match="malformed: not 72 bytes"):
                    Broadcast.unpack(wrong)
    for extra in (b"\x00", b"\xc0", data):
        with pytest.raises(MessageError, match="malformed"):
            Broadcast.unpack(data + extra)
        with pytest.raises(MessageError, match="malformed"):
            Broadcast.unpack(sealed(data[:-4] + extra))


def test_a_broadcast_is_laid_out_as_documented():
    """Field by field, by hand: anybody can write another implementation."""
    content = sha256(b"run").digest()[:8] + struct.pack("<I", 3) + struct.pack("<q", 17)
    content += struct.pack("<q", 170_000_000) + struct.pack("<5d", 1.5, -2.5, 0.25, 3.5, -0.5)
    assert GOOD.pack() == content + struct.pack("<I", crc32(content))


@given(st.text(), st.integers(0, 2**32 - 1), integers, integers, wild_states)
def test_every_broadcast_has_the_same_size(run, robot, sequence, stamp_ns, state):
    """What links bill must not depend on the name of a run, nor grow with time."""
    assert (
        len(Broadcast(run_tag(run), robot, sequence, stamp_ns, state).pack())
        == BROADCAST_BYTES
        == 72
    )


@given(broadcasts, st.data())
def test_a_broadcast_with_one_wrong_bit_is_refused(broadcast, data):
    """Some of them would still be finite states of the right robot, and absurd."""
    packed = bytearray(broadcast.pack())
    bit = data.draw(st.integers(0, 8 * len(packed) - 1))
    packed[bit // 8] ^= 1 << bit % 8
    with pytest.raises(MessageError, match="damaged"):
        Broadcast.unpack(bytes(packed))


@pytest.mark.parametrize("size", [0, 1, 8, 23, 25, 48])
def test_envelope_other_than_three_integers_is_malformed(size):
    with pytest.raises(MessageError, match="malformed envelope"):
        Envelope.unpack(bytes(size))


@pytest.mark.parametrize("message", [Sense(1, GOOD.state), Drive(1, 2, 3.0, 4.0)])
def test_message_of_every_tick_of_another_length_is_malformed(message):
    data = encode(message)
    for wrong in (data[:1], data[:-1], data + b"\x00", data + data):
        with pytest.raises(MessageError, match="wrong length"):
            decode(wrong)


@pytest.mark.parametrize(
    ("content", "integers"),
    [
        ([], "tagged list"),
        ({}, "tagged list"),
        (5, "tagged list"),
        (["0", 1, 1], "tagged list"),
        ([False, 1, 1], "tagged list"),
        ([0.0, 1, 1], "tagged list"),
        ([-1, 1, 1], "unknown kind -1"),
        ([13, 1], "unknown kind 13"),
        ([2**64 - 1], f"unknown kind {2**64 - 1}"),
        ([0, 1], "Join"),
        ([0, 1, True], "Join"),
        ([0, 1, 1, 1], "Join"),
        ([1, b"text"], "Brief"),
        ([3, 1, 1, (1, 2), 3], "Waiting"),
        ([3, 1, 1, 7], "Waiting"),
        ([3, 1, 1, ["2"]], "Waiting"),
        ([4, 1, [7]], "Links"),
        ([4, 1, [[0, 0, 1, 2, 3, 4]]], "Links"),
    ],
)
def test_lockstep_message_that_is_none_is_refused_with_the_reason(content, integers):
    with pytest.raises(MessageError, match=integers):
        decode(msgpack.packb(content))


def mutated(data, how):
    """Valid bytes with one damage: a changed byte, a cut, a byte put in."""
    place, byte, kind = how
    place %= len(data) + 1
    if kind == 0:
        return data[:place]
    if kind == 1:
        return data[:place] + bytes([byte]) + data[place:]
    return data[:place] + bytes([byte]) + data[place + 1 :]


damage = st.tuples(st.integers(0, 500), st.integers(0, 255), st.integers(0, 2))
damaged = st.builds(
    mutated,
    st.one_of(broadcasts.map(Broadcast.pack), *[kind.map(encode) for kind in KINDS.values()]),
    damage,
)
anything = st.recursive(
    st.none() | st.booleans() | integers | st.floats() | texts | st.binary(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=8) | st.dictionaries(texts | integers, inner, max_size=3)
    ),
    max_leaves=12,
).map(msgpack.packb)
HOSTILE = [
    b"",
    b"\x91" * 5000,
    b"\xdd\xff\xff\xff\xff",
    b"\xc6\xff\xff\xff\xff",
    b"\xc1",
    b"\x81\x90\x01",
    b"\x81\x81\x01\x01\x01",
    b"\xd6\xff\x00\x00\x00\x00",
    b"\xa1\xff",
    b"\xc7\x0c\xff" + b"\xff" * 12,
    b"\x9f" + b"\xff" * 15,
]


def survives(data):
    """Every decoder takes ``data`` or raises MessageError, and takes only what it can encode."""
    for unpack, kind, some in (
        (Broadcast.unpack, Broadcast, data),
        (Broadcast.unpack, Broadcast, sealed(data)),
        (Envelope.unpack, Envelope, data),
    ):
        try:
            message = unpack(some)
        except MessageError:
            continue
        assert type(message) is kind
        assert unpack(message.pack()) == message
    try:
        message = decode(data)
    except MessageError:
        return
    assert type(message) in KINDS


@settings(max_examples=150)
@given(st.binary(max_size=100))
def test_random_bytes_raise_nothing_but_message_error(data):
    survives(data)


@settings(max_examples=150)
@given(damaged)
def test_damaged_messages_raise_nothing_but_message_error(data):
    survives(data)


@settings(max_examples=150)
@given(anything)
def test_other_msgpack_raises_nothing_but_message_error(data):
    survives(data)


@pytest.mark.parametrize("data", HOSTILE, ids=lambda data: data[:6].hex() or "empty")
def test_hostile_bytes_raise_nothing_but_message_error(data):
    for unpack in (Broadcast.unpack, Envelope.unpack, decode):
        with pytest.raises(MessageError):
            unpack(data)
