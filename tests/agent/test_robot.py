"""The lockstep robot: what its law may see and when, what it waits for, what it refuses.

The law here only takes notes, so a test compares what the law saw at every tick
with what the conventions of the sampled loop say it should have seen.
"""

import math
from collections import Counter
from random import Random

import msgpack
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from formnet.agent.law import Command, LawFailed
from formnet.agent.robot import Outgoing, Robot
from formnet.formation.briefing.resolving import resolve
from formnet.formation.wire.broadcast import HELLO, Broadcast, Envelope, run_tag, sealed
from formnet.formation.wire.messages import (
    PLANT,
    Drive,
    Links,
    Rejected,
    Sense,
    decode,
    encode,
)
from formnet.formation.wire.state import Stamped, State
from formnet.netem import DELIVERED, IN_FLIGHT, LOST_RANDOM, stream

MS = 1_000_000
RUN = "the-run"
ME, LEFT, RIGHT = 1, 2, 5  # robot 1 and its neighbours on the ring of five


class Notebook:
    """A law that writes down what it is given and answers (tick in ms, -1)."""

    def __init__(self):
        self.calls = []

    def command(self, now_ns, own, heard):
        self.calls.append((now_ns, own, tuple(heard)))
        return Command(now_ns / MS, -1.0)

    @property
    def heard(self):
        """The last call's neighbours: {id: stamp in ms}."""
        return {stamped.robot: stamped.stamp_ns / MS for stamped in self.calls[-1][2]}


def state_of(robot, tick):
    """A state that tells whose it is and when it was."""
    return State(float(robot), float(tick), robot + tick / 1000, 0.5, -0.25)


def packed(robot, tick, period_ns=MS, run=RUN):
    """The payload and envelope that ``robot`` sends at ``tick`` (sequence = tick)."""
    payload = Broadcast(run_tag(run), robot, tick, tick * period_ns, state_of(robot, tick)).pack()
    return payload, Envelope(robot, tick, tick).pack()


@pytest.fixture(scope="session")
def make(paper):
    """``make("clock...=...", law=...)``: robot 1 of a ring at 1 ms, broadcasting every tick."""

    def robot(*overrides, law=None, me=ME):
        defaults = ["clock.broadcast_period_s=0.001", *overrides]
        law = Notebook() if law is None else law
        return Robot(resolve(paper("theorem2", *defaults)).robot(me), run=RUN, law=law), law

    return robot


def links(*rules):
    """An override with one rule per (source, TOML of its settings)."""
    tables = ", ".join(f"{{from=[{source}], to=[{ME}], {text}}}" for source, text in rules)
    return f"network.links=[{tables}]"


def constant(delay_ns):
    return f'delay={{distribution="constant", mean_s={delay_ns / 1e9!r}}}'


def hear(robot, *sources, tick):
    """The broadcasts of ``sources`` at ``tick`` arrive; returns the last answer."""
    answer = None
    for source in sources:
        answer = robot.on_broadcast(source, *packed(source, tick))
    return answer


def sense(robot, tick):
    """The plant's measurement arrives; returns the answer, if there is one."""
    return robot.on_sense(Sense(tick, state_of(ME, tick)))[1]


def step(robot, tick):
    """A whole tick in which both neighbours broadcast before the robot is asked."""
    hear(robot, LEFT, RIGHT, tick=tick)
    answer = sense(robot, tick)
    assert answer is not None
    return answer


def steps(robot, ticks):
    """All ticks before ``ticks``."""
    for tick in range(ticks):
        step(robot, tick)


def drive_in_random_order(robot, *, every, ticks, seed, period_ns=MS):
    """Run ``ticks`` ticks, each message arriving in an order drawn from ``seed``.

    Senses come one by one, each after the answer to the one before; broadcasts
    come in their sender's order, before or after the sense of their tick, as the
    lockstep allows. Returns the answers.
    """
    random = Random(seed)
    tick, upcoming, answers = 0, dict.fromkeys(robot.neighbours, 0), []
    while len(answers) < ticks:
        now = tick if robot.pending_tick is None else robot.pending_tick
        choices = [s for s, next_tick in upcoming.items() if next_tick <= now]
        if robot.pending_tick is None:
            choices.append("sense")
        choice = random.choice(choices)
        if choice == "sense":
            out = robot.on_sense(Sense(tick, state_of(robot.robot, tick)))
            answers += [item for item in out if type(item) is Drive]
            tick += 1
        else:
            payload, envelope = packed(choice, upcoming[choice], period_ns)
            upcoming[choice] += every
            answer = robot.on_broadcast(choice, payload, envelope)
            answers += [] if answer is None else [answer]
    return answers


# --- when the law sees what -----------------------------------------------------------


@given(
    st.integers(1, 6),
    st.tuples(st.integers(0, 25 * MS), st.integers(0, 25 * MS)),
    st.booleans(),
    st.integers(0, 2**32),
)
def test_law_sees_a_state_from_its_stamp_plus_delay_on_and_not_before(
    make, every, delays, on_grid, seed
):
    """At every tick exactly the newest stamp with t_s + δ <= t_k, whatever the order of arrival."""
    if on_grid:
        delays = tuple(delay // MS * MS for delay in delays)
    robot, law = make(
        f"clock.broadcast_period_s={every * MS / 1e9!r}",
        links((LEFT, constant(delays[0])), (RIGHT, constant(delays[1]))),
    )
    answers = drive_in_random_order(robot, every=every, ticks=45, seed=seed)
    assert answers == [Drive(ME, k, float(k), -1.0) for k in range(45)]
    for k, (now_ns, own, heard) in enumerate(law.calls):
        expected = []
        for source, delay_ns in zip((LEFT, RIGHT), delays, strict=True):
            newest = (k * MS - delay_ns) // (every * MS) * every
            if newest >= 0:
                expected.append(Stamped(source, newest * MS, state_of(source, newest)))
        assert (now_ns, own) == (k * MS, state_of(ME, k))
        assert heard == tuple(expected)
    assert robot.take_rejections() == []


@given(
    st.integers(1, 4),
    st.integers(0, 5 * MS),
    st.integers(0, 30 * MS),
    st.sampled_from([0.0, 0.3, 0.9]),
    st.integers(0, 2**32),
)
def test_newest_stamp_wins_when_messages_overtake_or_are_lost(
    make, every, low_ns, width_ns, probability, seed
):
    """The draws are repeated here from the documented streams."""
    high_ns = low_ns + width_ns
    robot, law = make(
        f"seed={seed}",
        f"clock.broadcast_period_s={every * MS / 1e9!r}",
        f"network.default.loss={{probability={probability}}}",
        'network.default.delay={distribution="uniform", '
        f"low_s={low_ns / 1e9!r}, high_s={high_ns / 1e9!r}}}",
    )
    drive_in_random_order(robot, every=every, ticks=40, seed=seed)
    usable = {}
    for source in (LEFT, RIGHT):
        loss, delay = (stream(seed, source, ME, name) for name in ("loss", "delay"))
        for tick in range(0, 80, every):
            lost = loss.random() < probability
            due_ns = tick * MS + low_ns + int(delay.random() * (width_ns + 1))
            usable[source, tick] = None if lost else due_ns
    for now_ns, _, heard in law.calls:
        expected = []
        for source in (LEFT, RIGHT):
            ticks = [
                tick
                for (of, tick), due_ns in usable.items()
                if of == source and due_ns is not None and due_ns <= now_ns
            ]
            if ticks:
                expected.append(Stamped(source, max(ticks) * MS, state_of(source, max(ticks))))
        assert heard == tuple(expected)
    for row in robot.take_link_rows():
        due_ns = usable[row.source, row.t_sent_ns // MS]
        assert (row.t_usable_ns, row.destination) == (due_ns, ME)
        assert row.fate == (LOST_RANDOM if due_ns is None else DELIVERED)


def test_overtaken_message_does_not_replace_the_newer_one(make):
    """Seed 3 makes messages overtake (asserted); the stamps the law sees never fall."""
    robot, law = make(
        "seed=3", 'network.default.delay={distribution="uniform", low_s=0.0, high_s=0.02}'
    )
    drive_in_random_order(robot, every=1, ticks=100, seed=3)
    rows = [row for row in robot.take_link_rows() if row.source == LEFT]
    rows.sort(key=lambda row: row.t_usable_ns)
    arrived = [row.t_sent_ns for row in rows]
    assert arrived != sorted(arrived)
    stamps = [stamped.stamp_ns for _, _, heard in law.calls for stamped in heard[:1]]
    assert stamps == sorted(stamps)
    assert len(set(stamps)) > 10


def test_no_delay_is_usable_at_the_same_tick(make):
    robot, law = make()
    for tick in range(3):
        step(robot, tick)
        assert law.heard == {LEFT: tick, RIGHT: tick}


def test_delay_of_one_nanosecond_more_than_a_tick_is_a_tick_later(make):
    robot, law = make(links((LEFT, constant(2 * MS)), (RIGHT, constant(2 * MS + 1))))
    for tick in range(5):
        step(robot, tick)
    assert law.heard == {LEFT: 2.0, RIGHT: 1.0}


def test_neighbour_not_heard_is_left_out(make):
    robot, law = make(links((LEFT, constant(3 * MS)), (RIGHT, "loss={probability=1.0}")))
    for tick in range(10):
        step(robot, tick)
        assert law.heard == ({LEFT: tick - 3} if tick >= 3 else {})


def test_neighbours_come_in_ascending_order(make):
    robot, law = make(links((LEFT, constant(5 * MS))))  # the right neighbour is heard first
    for tick in range(8):
        step(robot, tick)
    assert [stamped.robot for stamped in law.calls[2][2]] == [RIGHT]
    assert [stamped.robot for stamped in law.calls[7][2]] == [LEFT, RIGHT]


def test_law_is_given_the_same_object_until_something_new_is_heard(make):
    """Laws may memoise what follows from it."""
    seen = []

    class Keeper:
        def command(self, now_ns, own, heard):
            seen.append(heard)
            return Command(0.0, 0.0)

    robot, _ = make("clock.broadcast_period_s=0.003", law=Keeper())
    drive_in_random_order(robot, every=3, ticks=7, seed=0)
    assert seen[0] is seen[1] is seen[2]
    assert seen[2] != seen[3]


@pytest.mark.parametrize("tick", [-(10**6), 10**15, 10**18, 2**63 - 8])
def test_a_sense_of_an_impossible_tick_is_refused(make, tick):
    """Its time in nanoseconds is no 64-bit number: no broadcast can have it as its stamp."""
    robot, _ = make()
    state = state_of(ME, 0)
    assert robot.on_sense(decode(encode(Sense(tick, state)))) == (None, None)
    assert robot.take_rejections() == [Rejected(ME, PLANT, "a sense of an impossible tick", 1)]
    outgoing, _ = robot.on_sense(Sense(0, state))
    assert outgoing is not None


def test_robot_without_neighbours_answers_at_once(make):
    robot, law = make("formation.edges=[[2, 3]]")
    for tick in range(3):
        assert sense(robot, tick) == Drive(ME, tick, float(tick), -1.0)
    assert law.heard == {}


# --- lockstep -------------------------------------------------------------------------


def test_robot_waits_for_both_neighbours_and_names_them(make):
    robot, law = make()
    assert robot.awaited() == []
    assert robot.pending_tick is None
    assert sense(robot, 0) is None
    assert (robot.awaited(), robot.pending_tick) == ([LEFT, RIGHT], 0)
    assert hear(robot, RIGHT, tick=0) is None
    assert robot.awaited() == [LEFT]
    assert law.calls == []
    assert hear(robot, LEFT, tick=0) == Drive(ME, 0, 0.0, -1.0)
    assert (robot.awaited(), robot.pending_tick) == ([], None)
    assert len(law.calls) == 1


def test_robot_waits_though_the_link_delays_or_loses_what_it_waits_for(make):
    """What is awaited is the runtime's word that a message was sent, not its delivery."""
    robot, law = make(links((LEFT, constant(50 * MS)), (RIGHT, "loss={probability=1.0}")))
    assert sense(robot, 0) is None
    assert robot.awaited() == [LEFT, RIGHT]
    hear(robot, LEFT, tick=0)
    assert hear(robot, RIGHT, tick=0) is not None
    assert law.calls[0][2] == ()


def test_robot_waits_at_broadcast_ticks_only(make):
    robot, _ = make("clock.broadcast_period_s=0.004")
    hear(robot, LEFT, RIGHT, tick=0)
    for tick in range(4):
        assert sense(robot, tick) is not None
    assert sense(robot, 4) is None
    assert robot.awaited() == [LEFT, RIGHT]
    hear(robot, LEFT, tick=4)
    assert robot.awaited() == [RIGHT]
    assert hear(robot, RIGHT, tick=4).tick == 4


def test_robot_that_joins_between_broadcasts_waits_for_the_latest(make):
    robot, _ = make("clock.broadcast_period_s=0.004")
    hear(robot, LEFT, RIGHT, tick=0)
    assert sense(robot, 6) is None
    assert robot.awaited() == [LEFT, RIGHT]
    assert hear(robot, LEFT, RIGHT, tick=4).tick == 6


@given(st.integers(1, 5), st.integers(0, 2**32))
def test_robot_answers_every_tick_once_and_never_before_it_holds_what_it_must(make, every, seed):
    robot, law = make(f"clock.broadcast_period_s={every * MS / 1e9!r}")
    asked = Counter()

    class Watched:
        """The robot, checked at every broadcast; a compiled one cannot be patched."""

        def __getattr__(self, name):
            return getattr(robot, name)

        def on_broadcast(self, source, payload, envelope):
            answer = robot.on_broadcast(source, payload, envelope)
            asked[source] = max(asked[source], Envelope.unpack(envelope).tick)
            if answer is not None:
                assert min(asked[LEFT], asked[RIGHT]) >= answer.tick // every * every
            return answer

    answers = drive_in_random_order(Watched(), every=every, ticks=20, seed=seed)
    assert [answer.tick for answer in answers] == list(range(20))
    assert len(law.calls) == 20


def test_broadcast_says_who_when_and_what(make):
    robot, _ = make("clock.broadcast_period_s=0.003")
    for tick in range(6):
        if tick % 3 == 0:
            hear(robot, LEFT, RIGHT, tick=tick)
        outgoing, drive = robot.on_sense(Sense(tick, state_of(ME, tick)))
        assert type(drive) is Drive
        if tick % 3:
            assert outgoing is None
            continue
        sequence = tick // 3
        assert type(outgoing) is Outgoing
        assert outgoing.envelope == Envelope(ME, sequence, tick)
        assert Broadcast.unpack(outgoing.payload) == Broadcast(
            run_tag(RUN), ME, sequence, tick * MS, state_of(ME, tick)
        )


def test_broadcast_goes_out_while_the_robot_waits(make):
    """Or two neighbours would wait for each other for ever."""
    robot, _ = make()
    outgoing, drive = robot.on_sense(Sense(0, state_of(ME, 0)))
    assert type(outgoing) is Outgoing
    assert drive is None


def test_link_rows_are_handed_over_once(make):
    robot, _ = make(links((LEFT, constant(3 * MS)), (RIGHT, "loss={probability=1.0}")))
    steps(robot, 4)
    assert len(robot.take_link_rows()) == 1 + 4
    step(robot, 4)
    assert robot.unreported == 2
    assert [tuple(row) for row in robot.take_link_rows()] == [
        (4 * MS, None, RIGHT, ME, 4, LOST_RANDOM),
        (1 * MS, 4 * MS, LEFT, ME, 1, DELIVERED),
    ]
    assert robot.unreported == 0
    assert robot.take_link_rows() == []
    assert [tuple(row) for row in robot.take_last_link_rows()] == [
        (sent * MS, None, LEFT, ME, sent, IN_FLIGHT) for sent in (2, 3, 4)
    ]


# --- what is refused ------------------------------------------------------------------


def broadcast(**changes):
    """A good payload of the left neighbour at tick 3, with changes."""
    good = Broadcast(run_tag(RUN), LEFT, 3, 3 * MS, state_of(LEFT, 3))
    return good._replace(**changes).pack()


GOOD_NOTE = Envelope(LEFT, 3, 3).pack()
NAN_STATE = State(0.0, math.nan, 0.0, 0.0, 0.0)

PAYLOADS = [
    (b"", "malformed"),
    (b"\xff\x00garbage", "malformed"),
    (broadcast()[:-1], "malformed"),
    (broadcast() + b"\x00", "malformed"),
    (sealed(broadcast()), "malformed"),
    (bytes(len(broadcast())), "damaged"),
    (broadcast()[1:] + broadcast()[:1], "damaged"),
    (broadcast(state=NAN_STATE), "not finite"),
    (broadcast(state=NAN_STATE._replace(y_m=math.inf)), "not finite"),
    (broadcast(tag=run_tag("another")), "another run"),
    (broadcast(robot=RIGHT), "claims to be another robot"),
    (broadcast(robot=ME), "claims to be another robot"),
    (broadcast(robot=99), "claims to be another robot"),
    (broadcast(stamp_ns=3 * MS + 1), "stamped at another time than it was sent"),
    (broadcast(stamp_ns=2**63 - 1), "stamped at another time than it was sent"),
]


def numbered(cases):
    return [f"{i}: {case[-1]}" for i, case in enumerate(cases)]


@pytest.mark.parametrize(("payload", "reason"), PAYLOADS, ids=numbered(PAYLOADS))
def test_payload_is_refused_counted_and_not_shown_to_the_law(make, payload, reason):
    """The robot goes on: the lockstep has its word that the message was sent."""
    robot, law = make()
    steps(robot, 3)
    robot.on_broadcast(LEFT, payload, GOOD_NOTE)
    hear(robot, RIGHT, tick=3)
    assert sense(robot, 3) == Drive(ME, 3, 3.0, -1.0)
    assert law.heard == {LEFT: 2.0, RIGHT: 3.0}
    (rejected,) = robot.take_rejections()
    assert type(rejected) is Rejected
    assert (rejected.robot, rejected.source, rejected.times) == (ME, LEFT, 1)
    assert reason in rejected.reason
    step(robot, 4)
    assert law.heard == {LEFT: 4.0, RIGHT: 4.0}  # nothing is held against the sender


def test_message_lost_on_the_link_is_not_examined(make):
    robot, _ = make("network.default.loss={probability=1.0}")
    steps(robot, 3)
    robot.on_broadcast(LEFT, b"garbage", GOOD_NOTE)
    hear(robot, RIGHT, tick=3)
    sense(robot, 3)
    assert robot.take_rejections() == []


def test_delayed_payload_is_refused_when_it_is_delivered(make):
    robot, _ = make(links((LEFT, constant(2 * MS))))
    steps(robot, 3)
    robot.on_broadcast(LEFT, b"garbage", GOOD_NOTE)
    hear(robot, RIGHT, tick=3)
    sense(robot, 3)
    assert robot.take_rejections() == []
    for tick in (4, 5):
        step(robot, tick)
    assert [rejected.times for rejected in robot.take_rejections()] == [1]


ENVELOPES = [
    (LEFT, None, "malformed"),
    (LEFT, b"", "malformed"),
    (LEFT, b"\xc1", "malformed"),
    (LEFT, msgpack.packb([LEFT, 3]), "malformed"),
    (LEFT, msgpack.packb([LEFT, 3, 3.0]), "malformed"),
    (LEFT, msgpack.packb([LEFT, True, 3]), "malformed"),
    (LEFT, Envelope(RIGHT, 3, 3).pack(), "another robot"),
    (LEFT, Envelope(LEFT, 2, 3).pack(), "replayed"),
    (LEFT, Envelope(LEFT, 3, 2).pack(), "replayed"),
    (LEFT, Envelope(LEFT, 1, 1).pack(), "replayed"),
    (LEFT, Envelope(LEFT, 3, -7).pack(), "replayed"),
    (3, Envelope(3, 3, 3).pack(), "not a neighbour"),
    (ME, Envelope(ME, 3, 3).pack(), "not a neighbour"),
    (99, Envelope(99, 3, 3).pack(), "not a neighbour"),
    (3, b"garbage", "not a neighbour"),
    (99, Envelope(99, 0, HELLO).pack(), "not a neighbour"),
]


@pytest.mark.parametrize(("source", "envelope", "reason"), ENVELOPES, ids=numbered(ENVELOPES))
def test_envelope_is_refused_and_what_it_promised_is_still_awaited(make, source, envelope, reason):
    robot, law = make()
    steps(robot, 3)
    robot.take_link_rows()
    assert sense(robot, 3) is None
    hear(robot, RIGHT, tick=3)
    assert robot.on_broadcast(source, broadcast(), envelope) is None
    assert robot.awaited() == [LEFT]
    (rejected,) = robot.take_rejections()
    assert (rejected.robot, rejected.source, rejected.times) == (ME, source, 1)
    assert reason in rejected.reason
    assert hear(robot, LEFT, tick=3) is not None
    assert [row.source for row in robot.take_link_rows()] == [LEFT, RIGHT]
    assert law.heard == {LEFT: 3.0, RIGHT: 3.0}


def test_message_delivered_twice_by_the_bus_enters_the_link_once(make):
    robot, _ = make()
    for _ in range(3):
        hear(robot, LEFT, tick=0)
    assert len(robot.take_last_link_rows()) == 1
    assert robot.take_rejections() == [
        Rejected(ME, LEFT, "replayed: sequence or tick is not newer", 2)
    ]


def test_counts_grow_and_only_changes_are_reported(make):
    robot, _ = make()
    for count in (1, 2):
        for source in (99, 3, 99):
            robot.on_broadcast(source, b"", None)
        assert robot.unreported == 2
        assert robot.take_rejections() == [
            Rejected(ME, 3, "not a neighbour", count),
            Rejected(ME, 99, "not a neighbour", 2 * count),
        ]
        assert robot.take_rejections() == []
        assert robot.unreported == 0


def test_hello_is_neither_a_broadcast_nor_an_offence(make):
    robot, _ = make()
    sense(robot, 0)
    assert robot.on_broadcast(LEFT, b"", Envelope(LEFT, 0, HELLO).pack()) is None
    assert robot.awaited() == [LEFT, RIGHT]
    assert robot.take_rejections() == []
    assert robot.take_link_rows() == []
    hear(robot, LEFT, tick=0)
    assert hear(robot, RIGHT, tick=0) is not None


def test_envelope_from_the_far_future_does_not_silence_its_sender(make):
    robot, law = make()
    steps(robot, 3)
    robot.on_broadcast(LEFT, broadcast(), Envelope(LEFT, 1000, 1000).pack())
    assert [rejected.source for rejected in robot.take_rejections()] == [LEFT]
    steps_on = [step(robot, tick).tick for tick in (3, 4)]
    assert steps_on == [3, 4]
    assert law.heard == {LEFT: 4.0, RIGHT: 4.0}


small = st.integers(-2, 12)
words = st.integers(-(2**63), 2**63 - 1)
payloads = st.one_of(
    st.binary(max_size=40),
    st.builds(
        lambda robot, stamp, run, value: Broadcast(
            run_tag(run), robot, 0, stamp, State(value, 0.0, 0.0, 0.0, 0.0)
        ).pack(),
        st.integers(0, 12) | st.integers(0, 2**32 - 1),
        (small | words).map(lambda n: n * MS if -100 < n < 100 else n),
        st.sampled_from([RUN, RUN, RUN, "another"]),
        st.floats(),
    ),
)
envelopes = st.one_of(
    st.none(),
    st.binary(max_size=20),
    st.builds(lambda *fields: Envelope(*fields).pack(), small, small, small),
    st.builds(lambda *fields: Envelope(*fields).pack(), words, words, words),
)
arrivals = st.lists(
    st.tuples(st.sampled_from([LEFT, LEFT, RIGHT, RIGHT, ME, 99]), payloads, envelopes),
    max_size=12,
)
FAR = [(LEFT, broadcast(), Envelope(LEFT, 3, 2**63 - 1).pack())]


@settings(max_examples=100)
@given(arrivals, st.sampled_from([0, MS, 7 * MS]))
@example(FAR, 0)
def test_hostile_neighbours_never_stop_the_robot(make, messages, delay_ns):
    """Nothing raises, the law sees only what could be true, and all of it can be reported."""
    robot, law = make(f"network.default.{constant(delay_ns)}")
    tick = 0
    for source, payload, envelope in messages:
        if robot.pending_tick is None:
            sense(robot, tick)
            tick += 1
        robot.on_broadcast(source, payload, envelope)
        assert set(robot.awaited()) <= {LEFT, RIGHT}
    for now_ns, _, heard in law.calls:
        ids = [stamped.robot for stamped in heard]
        assert ids == sorted(set(ids))
        assert set(ids) <= {LEFT, RIGHT}
        for stamped in heard:
            assert stamped.stamp_ns <= now_ns
            assert all(map(math.isfinite, stamped.state))
    for rejected in robot.take_rejections():
        assert decode(encode(rejected)) == rejected
        assert rejected.times >= 1
    rows = robot.take_link_rows()
    assert len(rows) <= len(messages)
    assert decode(encode(Links(ME, rows))).rows == [list(row) for row in rows]


@settings(max_examples=30)
@given(st.integers(1, 20), st.integers(1, 20))
def test_state_stamped_later_than_it_was_sent_is_not_seen_before_stamp_plus_delay(
    make, delay_ticks, lead_ticks
):
    """A sender cannot shorten its link's delay by stamping ahead."""
    robot, law = make(links((LEFT, constant(delay_ticks * MS))))
    payload = Broadcast(run_tag(RUN), LEFT, 0, lead_ticks * MS, state_of(LEFT, 0)).pack()
    robot.on_broadcast(LEFT, payload, Envelope(LEFT, 0, 0).pack())
    hear(robot, RIGHT, tick=0)
    for tick in range(45):
        sense(robot, tick)
        hear(robot, LEFT, RIGHT, tick=tick + 1)
    for now_ns, _, heard in law.calls:
        for stamped in heard:
            if stamped.robot == LEFT:
                assert stamped.stamp_ns + delay_ticks * MS <= now_ns


# --- laws that fail -------------------------------------------------------------------


class Does:
    """A law that calls a function."""

    def __init__(self, what):
        self.what = what

    def command(self, now_ns, own, heard):
        return self.what()


def raiser(error):
    def fail():
        raise error

    return fail


class Odd(Exception):
    """An exception of a plug-in's own."""


def answer_of(make, what):
    robot, _ = make(law=Does(what))
    hear(robot, LEFT, RIGHT, tick=0)
    return sense(robot, 0)


@pytest.mark.parametrize(
    "error",
    [
        ValueError("no root"),
        ZeroDivisionError(),
        KeyError(3),
        StopIteration(),
        MemoryError(),
        RecursionError("deep"),
        AssertionError("mine"),
        np.linalg.LinAlgError("singular"),
        Odd("x y"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_exception_of_a_law_is_wrapped_with_robot_and_reason(make, error):
    with pytest.raises(LawFailed) as caught:
        answer_of(make, raiser(error))
    assert caught.value.robot == ME
    assert str(caught.value).startswith(type(error).__name__)
    assert str(error) in str(caught.value)
    assert caught.value.__cause__ is error


@pytest.mark.parametrize(
    "value",
    [
        None,
        1.0,
        (),
        (1.0,),
        (1.0, 2.0, 3.0),
        ("a", "b"),
        (None, 1.0),
        (1.0, 2j),
        object(),
        ([1.0], 2.0),
        Command("fast", 0.0),
        (10**400, 0.0),
        np.zeros((2, 2)),
        np.zeros(3),
        {},
        "",
        b"xyz",
    ],
    ids=lambda value: repr(value)[:20],
)
def test_what_is_no_pair_of_numbers_fails_the_law(make, value):
    with pytest.raises(LawFailed) as caught:
        answer_of(make, lambda: value)
    assert caught.value.robot == ME
    words = str(caught.value)
    assert "the law must return two numbers, not " in words or words.startswith("OverflowError")


@pytest.mark.parametrize("value", ["12", ("1", "2"), b"ab", {1.0: None, 2.0: None}], ids=repr)
def test_what_could_be_read_as_two_numbers_but_is_none_fails_the_law(make, value):
    with pytest.raises(LawFailed):
        answer_of(make, lambda: value)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ((1, -2), (1.0, -2.0)),
        ([0.5, 0.25], (0.5, 0.25)),
        (np.array([1.5, -1.5]), (1.5, -1.5)),
        ((np.float32(0.5), np.int64(3)), (0.5, 3.0)),
        (Command(-0.0, 5e-324), (-0.0, 5e-324)),
        ((math.inf, -math.inf), (math.inf, -math.inf)),
    ],
)
def test_any_pair_of_numbers_is_an_answer_of_plain_floats(make, value, expected):
    """Also when it is not finite: that ends the run as diverged, and the plant decides it."""
    drive = answer_of(make, lambda: value)
    assert (drive.right, drive.left) == expected
    assert [type(drive.right), type(drive.left)] == [float, float]
    assert math.copysign(1, drive.right) == math.copysign(1, expected[0])
    assert decode(encode(drive)) == drive


def test_nan_is_passed_on(make):
    drive = answer_of(make, lambda: (math.nan, 0.0))
    assert math.isnan(drive.right)


def test_law_may_also_fail_when_a_broadcast_completes_the_tick(make):
    robot, _ = make(law=Does(raiser(Odd("late"))))
    assert sense(robot, 0) is None
    hear(robot, LEFT, tick=0)
    with pytest.raises(LawFailed, match="Odd: late"):
        hear(robot, RIGHT, tick=0)
    assert robot.pending_tick is None
