"""What is under way counts for impairments that are turned on, and what a cut lost does not."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from formnet.netem import (
    CORRUPTED,
    DELIVERED,
    DUPLICATED,
    LOST_CUT,
    LOST_LATE,
    LOST_QUEUE,
    LOST_RANDOM,
    Change,
    ConstantDelay,
    Cut,
    Heal,
    KeepOrder,
    Link,
    LinkOverrides,
    LinkSettings,
    Ramp,
    Rate,
    Shared,
    Slots,
    Timeline,
    Transit,
)
from formnet.netem.bridge.lanes import ChangeRequest, LaneFile, Lanes

MS = 1_000_000
S = 1_000_000_000
SIZE = 10  # bytes of a message


def change(**named):
    return Change(LinkOverrides.model_validate(named).values())


def constant(mean_s):
    return {"distribution": "constant", "mean_s": mean_s}


class Run:
    """A link of ``table`` with a timeline; ``send`` is a message at a time in milliseconds."""

    def __init__(self, table, *actions, seed=1):
        settings = LinkSettings.model_validate(table)
        self.link = settings.link(seed=seed, source=1, destination=2)
        self.timeline = Timeline(settings, [(at_ms * MS, do) for at_ms, do in actions], self.link)
        self._sequence = 0

    def send(self, at_ms, size=SIZE):
        self.timeline.advance(round(at_ms * MS))
        self._sequence += 1
        return self.link.send(round(at_ms * MS), self._sequence, bytes(size))

    def one(self, at_ms, size=SIZE):
        (copy,) = self.send(at_ms, size)
        return copy

    def ms(self, at_ms, size=SIZE):
        """When a message sent then arrives (ms), or its fate if it does not."""
        copy = self.one(at_ms, size)
        return copy.fate if copy.lost else copy.due_ns / MS


# --- turned on during a run ---------------------------------------------------------------

# What is set 1 s after the beginning, with a message under way until 1.2 s; then when one
# that is sent at 1.01 s without delay arrives (ms): not before, and on a line, after its own time.
TURNED_ON = {
    "keep_order": (change(delay=constant(0.0), keep_order=True), 1200),
    "rate": (change(delay=constant(0.0), rate={"bits_per_s": 8000}), 1200 + SIZE),
    "slots": (change(delay=constant(0.0), slots={"min_s": 0.007, "max_s": 0.007}), 1204),
    "preset": (
        change(preset="robot-link", loss={"model": "random", "probability": 0.0}),
        1200 + 8 * SIZE / 60_000,
    ),
    "ramped rate": (Ramp("rate.bits_per_s", 0, 8000, MS), 1200 + SIZE),
    "ramped slots": (Ramp("slots.max_s", 0.0, 0.007, MS), 1204),
}


@pytest.mark.parametrize("name", TURNED_ON)
def test_what_is_turned_on_lets_nothing_pass_what_is_under_way(name):
    action, wanted_ms = TURNED_ON[name]
    table = {"delay": constant(0.3), "slots": {"min_s": 1e-9}}
    shorter = change(delay=constant(0.0))
    if name == "ramped slots":
        steady = change(slots={"min_s": 0.007})
        run = Run(table, (1000, action), (1000, shorter), (1005, steady))
    elif name == "ramped rate":
        run = Run(table, (1000, action), (1000, shorter))
    else:
        run = Run(table, (1000, action))
    assert run.ms(900) == 1200
    assert run.ms(1010) == pytest.approx(wanted_ms, abs=2e-6)  # a rate rounds up to whole ns


def test_each_of_those_is_free_when_nothing_is_under_way():
    """Beside the test before: the link is idle, so the message waits for nothing but itself."""
    run = Run({"delay": constant(0.0)}, (1000, TURNED_ON["rate"][0]))
    assert [run.ms(900), run.ms(1010)] == [900, 1010 + SIZE]


def test_order_and_queue_set_at_once_count_the_nine_under_way():
    """Every 50 ms at 0.5 s of delay; both set at 2 s, with a limit of three and less delay."""
    run = Run(
        {"delay": constant(0.5)},
        (2000, change(delay=constant(0.01), keep_order=True, queue={"messages": 3})),
    )
    found = [run.ms(50 * k) for k in range(52)]
    assert found[:40] == [50 * k + 500 for k in range(40)]
    # Nine are under way at 2.0 s; until 2.35 s, when two are left, there is no room.
    assert found[40:47] == [LOST_QUEUE] * 7
    assert found[47:] == [2450, 2450, 2460, 2510, 2560]  # the first two wait for the last of them


@pytest.mark.parametrize(
    ("limit", "action"),
    [
        ("messages", change(queue={"messages": 2})),
        ("messages", Ramp("queue.messages", 0, 2, MS)),
        ("bytes", change(queue={"bytes": 2 * SIZE})),
        ("bytes", Ramp("queue.bytes", 0, 2 * SIZE, MS)),
    ],
)
def test_a_queue_that_is_turned_on_holds_what_is_under_way(limit, action):
    run = Run({"delay": constant(0.1)}, (1000, action))
    assert [run.ms(t) for t in (950, 960, 970)] == [1050, 1060, 1070]
    assert [run.ms(t) for t in (1005, 1055, 1060)] == [LOST_QUEUE, LOST_QUEUE, 1160]


def test_a_smaller_limit_than_what_is_under_way_loses_until_there_is_room():
    run = Run(
        {"delay": constant(0.1), "queue": {"messages": 5}},
        (50, change(queue={"messages": 2})),
    )
    assert [run.ms(10 * k) for k in range(5)] == [100, 110, 120, 130, 140]
    assert [run.ms(t) for t in (60, 129, 130)] == [LOST_QUEUE, LOST_QUEUE, 230]


def test_turned_off_and_on_again_what_came_between_counts():
    run = Run(
        {"delay": constant(0.3), "keep_order": True, "queue": {"messages": 1}},
        (100, change(keep_order=False, queue={"messages": 0})),
        (200, change(delay=constant(0.0), keep_order=True, queue={"messages": 2})),
    )
    assert [run.ms(0), run.ms(50), run.ms(150)] == [300, LOST_QUEUE, 450]
    assert run.ms(299) == LOST_QUEUE
    assert run.ms(300) == 450


def test_duplicates_and_damaged_messages_under_way_count():
    run = Run(
        {
            "delay": constant(0.1),
            "duplicate": {"probability": 1.0},
            "corrupt": {"probability": 1.0},
        },
        (50, change(queue={"messages": 4}, duplicate={"probability": 0.0})),
    )
    assert [c.fate for c in run.send(0) + run.send(10)] == [CORRUPTED] * 4
    assert [run.one(t).fate for t in (60, 99, 100)] == [LOST_QUEUE, LOST_QUEUE, CORRUPTED]


def test_the_duplicates_of_what_comes_after_share_room_and_order():
    """Duplication turned on together with the rest: the second copy comes after the first."""
    run = Run(
        {"delay": constant(0.1)},
        (
            50,
            change(
                duplicate={"probability": 1.0}, rate={"bits_per_s": 8000}, queue={"messages": 3}
            ),
        ),
    )
    assert [run.ms(0), run.ms(10)] == [100, 110]
    first, second = run.send(60)
    assert (first.fate, first.due_ns) == (DELIVERED, (160 + SIZE) * MS)
    assert second.fate == LOST_QUEUE
    first, second = run.send(180)  # nothing is under way any more
    assert (first.fate, first.due_ns) == (DELIVERED, (280 + SIZE) * MS)
    assert (second.fate, second.due_ns) == (DUPLICATED, (280 + 2 * SIZE) * MS)


def test_what_the_receiver_holds_has_left_the_line():
    """A playout buffer hands over at 500 ms what has left at 100 ms: it holds up nothing."""
    run = Run(
        {"delay": constant(0.1), "playout_s": 0.5},
        (150, change(delay=constant(0.0), playout_s=0.0, keep_order=True, queue={"messages": 1})),
    )
    assert run.ms(0) == 500
    assert run.ms(90) == 590
    assert run.ms(160) == LOST_QUEUE  # the other leaves at 190 ms
    assert run.ms(190) == 190


def test_what_the_receiver_will_refuse_is_on_the_line_till_then():
    run = Run(
        {"delay": constant(0.5), "playout_s": 0.1},
        (100, change(delay=constant(0.0), playout_s=0.0, keep_order=True, queue={"messages": 2})),
    )
    assert [run.ms(0), run.ms(10)] == [LOST_LATE, LOST_LATE]
    assert [run.ms(400), run.ms(500), run.ms(510)] == [LOST_QUEUE, 510, 510]


def test_turning_slots_off_lets_nothing_pass_what_waits_for_one():
    run = Run(
        {"rate": {"bits_per_s": 8_000_000}, "slots": {"min_s": 0.1, "max_s": 0.1, "messages": 1}},
        (20, change(slots={"max_s": 0.0})),
    )
    assert [run.ms(10), run.ms(11)] == [100, 200]
    assert run.ms(30) == pytest.approx(200.01, abs=1e-6)
    assert run.ms(300) == pytest.approx(300.01, abs=1e-6)


def test_a_queue_that_is_turned_on_changes_nothing_for_line_and_slots():
    table = {"rate": {"bits_per_s": 80_000}, "slots": {"min_s": 0.02, "max_s": 0.03, "messages": 2}}
    plain = Run(table)
    other = Run(table, (50, change(queue={"messages": 1000})), (90, change(queue={"messages": 0})))
    times = [0, 1, 2, 40, 41, 60, 61, 62, 80, 95, 96, 99, 200]
    assert [plain.ms(t) for t in times] == [other.ms(t) for t in times]


def test_a_bridge_s_links_count_what_is_under_way():
    """POST /network is a :class:`ChangeRequest`."""
    lanes = Lanes(LaneFile.model_validate({"network": {"default": {"delay": constant(0.5)}}}))
    lane = lanes.of("forward", "a/key")
    (slow,) = lane.link.send(0, 1, b"x")
    request = {"delay": constant(0.0), "keep_order": True, "queue": {"messages": 2}}
    lanes.do(ChangeRequest.model_validate(request), 100 * MS)
    (second,) = lane.link.send(100 * MS, 2, b"x")
    (third,) = lane.link.send(200 * MS, 3, b"x")
    assert slow.due_ns == second.due_ns == 500 * MS
    assert third.fate == LOST_QUEUE


# --- cuts -----------------------------------------------------------------------------------

# A link, and when a message sent at 20 ms arrives (ms) if none that a cut lost before is in its way.
LINES = {
    "queue": ({"delay": constant(0.1), "queue": {"messages": 4}}, 120),
    "queue of bytes": ({"delay": constant(0.1), "queue": {"bytes": 4 * SIZE}}, 120),
    "order": ({"delay": constant(0.0), "keep_order": True}, 20),
    "rate": ({"rate": {"bits_per_s": 800}}, 120),
    "slots": ({"slots": {"min_s": 0.05, "max_s": 0.05, "messages": 1}}, 50),
}
SLOW = {"order": {"delay": constant(0.3)}}  # what differs until 10 ms


@pytest.mark.parametrize("name", LINES)
def test_what_a_cut_lost_in_flight_takes_no_room_and_no_time(name):
    table, wanted_ms = LINES[name]
    actions = (5, Cut(lose_in_flight=True)), (10, Heal()), (10, change(**table))
    run = Run(table | SLOW.get(name, {}), *actions)
    for k in range(4):
        assert not run.one(k).lost
    lost = run.timeline.advance(5 * MS)
    assert {copy.fate for copy in lost} == {LOST_CUT}
    assert run.ms(20) == wanted_ms


def test_after_a_cut_slots_open_that_were_passed_over_undrawn():
    """What is due in 10 s passes over nine thousand slots of 1 ms; those come, each in its time."""
    slots = {"slots": {"min_s": 0.001, "max_s": 0.001, "messages": 1}}
    run = Run(
        slots | {"delay": constant(10.0)},
        (5, Cut(lose_in_flight=True)),
        (10, Heal()),
        (10, change(delay=constant(0.0))),
    )
    assert run.ms(0.5) == 10001
    assert [run.ms(t) for t in (20.5, 20.6, 8000.5, 9999.5, 9999.6, 9999.7)] == [
        21,
        22,
        8001,
        10000,
        10001,
        10002,
    ]


@pytest.mark.parametrize("name", LINES)
@pytest.mark.parametrize("lose", [False, True])
def test_what_is_sent_during_a_cut_takes_no_room_and_no_time(name, lose):
    table, wanted_ms = LINES[name]
    actions = (0, Cut(lose_in_flight=lose)), (10, Heal()), (10, change(**table))
    run = Run(table | SLOW.get(name, {}), *actions)
    assert [run.one(k).fate for k in range(10)] == [LOST_CUT] * 10
    assert run.ms(20) == wanted_ms


def test_a_cut_that_keeps_what_is_in_flight_keeps_its_room():
    run = Run({"delay": constant(0.1), "queue": {"messages": 2}}, (5, Cut()), (10, Heal()))
    assert [run.ms(0), run.ms(1), run.ms(6), run.ms(20), run.ms(100)] == [
        100,
        101,
        LOST_CUT,
        LOST_QUEUE,
        200,
    ]


def test_what_the_receiver_would_have_refused_is_gone_with_a_cut_too():
    table = {"delay": constant(0.5), "playout_s": 0.1, "queue": {"messages": 1}}
    run = Run(table, (5, Cut(lose_in_flight=True)), (10, Heal()), (10, change(playout_s=0.0)))
    assert [run.ms(0), run.ms(20)] == [LOST_LATE, 520]


RANDOM = {
    "loss": {"probability": 0.3, "correlation": 0.5},
    "duplicate": {"probability": 0.3},
    "corrupt": {"probability": 0.3},
    "reorder": {"probability": 0.2, "gap": 2},
    "delay": {"distribution": "exponential", "mean_s": 0.05, "correlation": 0.6},
}


@pytest.mark.parametrize("lose", [False, True])
@pytest.mark.parametrize(
    "line",
    [
        {},
        {"playout_s": 0.05},
        {"slots": {"min_s": 0.0001, "max_s": 0.0002}},
        {"keep_order": True, "queue": {"messages": 50}},
    ],
)
def test_a_cut_changes_no_draw_after_it(line, lose):
    """The same fates, damage and delays as without it, once nothing from before is under way.

    The cut is 2 s long, and slots are drawn for no more than the last 0.2 s of an idle time.
    """
    actions = (1000, Cut(lose_in_flight=lose)), (3000, Heal())
    plain, cut = Run(RANDOM | line), Run(RANDOM | line, *actions)
    for at_ms in range(0, 5000, 10):
        without, copies = plain.send(at_ms), cut.send(at_ms)
        assert len(copies) == len(without)
        for copy, other in zip(copies, without, strict=True):
            if 1000 <= at_ms < 3000:
                kept = other.fate in (LOST_RANDOM, "lost: burst", LOST_LATE)
                assert copy.fate == (other.fate if kept else LOST_CUT)
            elif not 3000 <= at_ms < 3700:  # 14 mean delays: e^-14 is one in a million
                assert (copy.fate, copy.payload, copy.due_ns) == (
                    other.fate,
                    other.payload,
                    other.due_ns,
                )


# --- against a list of all messages -----------------------------------------------------------

tables = st.fixed_dictionaries(
    {},
    optional={
        "delay": st.sampled_from(
            [
                {"distribution": "uniform", "low_s": 0.0, "high_s": 0.1},
                {"distribution": "uniform", "low_s": 0.0, "high_s": 0.005},
                {"distribution": "exponential", "mean_s": 0.03},
            ]
        ),
        "duplicate": st.sampled_from([{"probability": 0.0}, {"probability": 0.3}]),
        "corrupt": st.sampled_from([{"probability": 0.0}, {"probability": 0.3}]),
        "rate": st.sampled_from([{"bits_per_s": n} for n in (0, 30_000, 1_000_000)]),
        "queue": st.sampled_from([{"messages": m, "bytes": b} for m in (0, 2, 5) for b in (0, 60)]),
        "slots": st.sampled_from(
            [
                {"min_s": 0.001, "max_s": 0.0, "messages": 0},
                {"min_s": 0.001, "max_s": 0.009, "messages": 2},
            ]
        ),
        "keep_order": st.booleans(),
        "playout_s": st.sampled_from([0.0, 0.05]),
    },
)
actions = st.one_of(
    tables.map(lambda table: change(**table)),
    st.builds(Cut, st.booleans()),
    st.just(Heal()),
    st.just(Heal()),
)


@settings(max_examples=300)
@given(
    tables,
    st.lists(st.tuples(st.integers(0, 400), actions), max_size=8),
    st.lists(st.tuples(st.integers(0, 15), st.integers(0, 30)), min_size=30, max_size=60),
    st.integers(0, 2**32),
)
def test_links_agree_with_a_list_of_all_messages(table, plan, script, seed):
    """What is under way is asked of a plain list: each message's size, sending and leaving."""
    run = Run(
        {"delay": {"distribution": "uniform", "low_s": 0.0, "high_s": 0.2}} | table, seed=seed
    )
    todo = sorted(plan, key=lambda item: item[0])
    on_the_line = []  # (leaves, size) of all that was ever sent and not lost on the way
    now_ms = 0
    for gap_ms, size in script:
        now_ms += gap_ms
        while todo and todo[0][0] <= now_ms:
            at_ms, action = todo.pop(0)
            run.timeline.do(at_ms * MS, action)
            if isinstance(action, Cut) and action.lose_in_flight:
                on_the_line = [(leaves, n) for leaves, n in on_the_line if leaves <= at_ms * MS]
        now = run.timeline.settings
        for copy in run.send(now_ms, size):
            if run.timeline.is_cut:
                assert copy.fate == LOST_CUT or (copy.fate == LOST_LATE and now.playout_s)
                continue
            there = [n for leaves, n in on_the_line if leaves > now_ms * MS]
            full = (now.queue.messages and len(there) >= now.queue.messages) or (
                now.queue.bytes and sum(there) + size > now.queue.bytes
            )
            assert (copy.fate == LOST_QUEUE) == bool(full)
            if full:
                continue
            leaves = copy.due_ns if copy.left_ns is None else copy.left_ns
            if now.keep_order or now.rate.bits_per_s or now.slots.max_s:
                assert all(leaves >= earlier for earlier, _ in on_the_line)
            if now.slots.max_s and now.slots.messages:
                together = [n for earlier, n in on_the_line if earlier == leaves]
                assert len(together) < now.slots.messages
            on_the_line.append((leaves, size))


# --- by hand ----------------------------------------------------------------------------------


def test_which_stages_messages_share():
    on = {
        "loss": {"probability": 0.1},
        "corrupt": {"probability": 0.1},
        "queue": {"messages": 1},
        "reorder": {"probability": 0.1},
        "delay": constant(1.0),
        "rate": {"bits_per_s": 1},
        "slots": {"min_s": 1.0, "max_s": 1.0},
        "keep_order": True,
        "playout_s": 1.0,
    }
    stages = LinkSettings.model_validate(on).impairments()
    shared = [stage.name for stage in stages if isinstance(stage, Shared)]
    assert shared == ["queue", "rate", "slots", "order"]
    assert len(stages) == 10
    assert all(stage.twin() is stage for stage in stages if isinstance(stage, Shared))


def test_an_impairment_of_your_own_in_the_place_of_another_hands_on_nothing():
    class Free:
        name = "order"

        def twin(self):
            return self

        def inherit(self, before):
            pass

        def apply(self, copy, random):
            pass

    a_link = Link([ConstantDelay(100), Free()], seed=1, source=1, destination=2)
    a_link.send(0, 0, b"")
    a_link.change([KeepOrder()])
    assert a_link.send(10, 1, b"")[0].due_ns == 100


class Least:
    """Draws the least there is."""

    def random(self):
        return 0.0


@pytest.mark.parametrize(
    ("make", "under_way", "due"),
    [
        (lambda: Rate(8 * 10**9), [], 6),
        (lambda: Rate(8 * 10**9), [3], 6),
        (lambda: Rate(8 * 10**9), [30, 20], 31),
        (lambda: Slots(10, 10, messages=1), [], 10),
        (lambda: Slots(10, 10, messages=1), [3, 10], 20),
        (lambda: Slots(10, 10, messages=2), [3, 10], 10),
        (lambda: Slots(10, 10, messages=1), [30, 20], 40),
        (lambda: Slots(10, 10, bytes_=2), [30, 30], 40),
        (KeepOrder, [], 5),
        (KeepOrder, [30, 20], 30),
    ],
)
def test_what_occupies_a_stage_is_exactly_what_it_is_told(make, under_way, due):
    """One byte, sent at 5 ns; at 8 Gbit/s it takes 1 ns. It was occupied otherwise before."""
    stage, copy = make(), Transit(9, 5, 5, b"x")
    stage.apply(Transit(0, 0, 100, b"x"), Least())
    stage.occupy([Transit(k, 0, leaves, b"x") for k, leaves in enumerate(under_way)])
    stage.apply(copy, Least())
    assert copy.due_ns == due
