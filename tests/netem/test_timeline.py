"""What happens to links, and when: one link by hand, shapes of partitions, a whole scenario."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from formnet.formation.briefing.resolving import resolve
from formnet.formation.plan.partition import PartitionAction
from formnet.formation.records.rows import LinkRows
from formnet.formation.scenario.loading import ScenarioError, dumps, load, loads
from formnet.lab.launch.inline import Inline
from formnet.netem import Change, Cut, Heal, LinkOverrides, LinkSettings, Ramp, Timeline
from formnet.netem.settings.links import SettingError
from formnet.netem.settings.ramp import checked_parameter, ramped
from formnet.netem.settings.timeline import NEVER

MS = 1_000_000
S = 1_000_000_000


def change(**named):
    return Change(LinkOverrides.model_validate(named).values())


def constant(mean_s):
    return {"delay": {"distribution": "constant", "mean_s": mean_s}}


def on_a_link(settings, *actions):
    settings = LinkSettings.model_validate(settings)
    link = settings.link(seed=1, source=1, destination=2)
    return link, Timeline(settings, actions, link)


def send(link, timeline, sent_ns):
    """The way a receiver does it: the timeline first, then the message."""
    timeline.advance(sent_ns)
    (copy,) = link.send(sent_ns, sent_ns, b"12345678")
    return copy


# --- one link ---------------------------------------------------------------------------


def test_a_change_is_met_by_what_is_sent_from_its_instant_on():
    link, timeline = on_a_link(constant(0.02), (S, change(delay={"mean_s": 0.05})))
    assert timeline.next_ns == S
    assert send(link, timeline, S - 1).due_ns == S - 1 + 20 * MS
    assert send(link, timeline, S).due_ns == S + 50 * MS
    assert timeline.next_ns == NEVER


def test_a_change_replaces_exactly_what_it_names():
    """Key by key, but a delay or loss of a named kind as a whole."""
    base = {
        "delay": {"distribution": "gamma", "mean_s": 0.1, "stddev_s": 0.01, "correlation": 0.5},
        "loss": {"model": "gilbert_elliott", "p": 0.1, "r": 0.2},
        "rate": {"bits_per_s": 1000, "overhead_bytes": 7},
        "queue": {"messages": 5},
        "keep_order": True,
    }
    settings = LinkSettings.model_validate(base)

    def changed(**named):
        return settings.changed(LinkOverrides.model_validate(named).values()).model_dump()

    before = settings.model_dump()
    parts = [
        ("delay", "mean_s", 0.2),
        ("loss", "r", 0.9),
        ("rate", "bits_per_s", 5),
        ("queue", "bytes", 9),
        ("slots", "messages", 3),
    ]
    for table, key, value in parts:
        after = changed(**{table: {key: value}})
        assert after == before | {table: before[table] | {key: value}}
    assert changed(keep_order=False) == before | {"keep_order": False}
    whole = {"distribution": "gamma", "mean_s": 0.3, "stddev_s": 0.02}
    after = changed(delay=whole)
    assert after == before | {"delay": before["delay"] | whole | {"correlation": 0.0}}
    assert changed(preset="ideal") == LinkSettings().model_dump()
    assert settings.model_dump() == before


@pytest.mark.parametrize(
    ("named", "words"),
    [
        ({"delay": {"low_s": 0.1}}, "delay.low_s = 0.1: unknown key"),
        ({"loss": {"p": 0.1}}, "loss.p = 0.1: unknown key"),
        ({"slots": {"min_s": 0.5}, "rate": {"bits_per_s": 1}}, None),
        ({"slots": {"max_s": 0.5}}, "slots = .*need 1e-9 <= min_s <= max_s, got 0.0 and 0.5"),
    ],
)
def test_a_change_that_the_settings_do_not_admit_is_named_and_changes_nothing(named, words):
    link, timeline = on_a_link(constant(0.02))
    action = change(**named)
    if words is None:
        timeline.do(0, action)
        return
    with pytest.raises(SettingError, match=words) as raised:
        timeline.do(0, action)
    assert raised.value.cause is action
    assert timeline.settings == LinkSettings.model_validate(constant(0.02))
    assert send(link, timeline, 10).due_ns == 10 + 20 * MS


@given(st.integers(0, 3 * S), st.integers(0, 200), st.integers(0, 200), st.integers(1, 2 * S))
def test_a_ramp_is_a_straight_line_in_the_time_of_sending(sent_ns, start, end, duration_ns):
    ramp = Ramp("delay.mean_s", start / 1000, end / 1000, duration_ns)
    link, timeline = on_a_link(constant(0.25), (S, ramp))
    delay_ns = send(link, timeline, sent_ns).due_ns - sent_ns
    if sent_ns < S:
        assert delay_ns == 250 * MS
    else:
        share = min(1.0, (sent_ns - S) / duration_ns)
        assert abs(delay_ns - (start + (end - start) * share) * MS) <= 1
    if sent_ns >= S + duration_ns:
        assert delay_ns == end * MS
        assert not timeline.ramping


def test_a_ramp_of_a_whole_number_stays_whole():
    _, timeline = on_a_link({"rate": {"bits_per_s": 1000}}, (0, Ramp("rate.bits_per_s", 1, 2, 9)))
    for now in range(12):
        timeline.advance(now)
        assert timeline.settings.rate.bits_per_s == (1 if now < 5 else 2)
    assert type(timeline.settings.rate.bits_per_s) is int


def test_a_change_ends_the_ramp_of_what_it_names_and_no_other():
    _, timeline = on_a_link(
        constant(0.0),
        (0, Ramp("delay.mean_s", 0.0, 0.1, 10 * S)),
        (0, Ramp("loss.probability", 0.0, 1.0, 10 * S)),
        (2 * S, change(loss={"probability": 0.0})),
    )
    timeline.advance(5 * S)
    assert timeline.settings.loss.probability == 0.0
    assert timeline.settings.delay.mean_s == pytest.approx(0.05)
    timeline.do(6 * S, change(delay={"distribution": "uniform", "low_s": 0.0, "high_s": 1.0}))
    assert not timeline.ramping
    assert timeline.next_ns == NEVER


def test_a_later_ramp_of_the_same_number_takes_over():
    _, timeline = on_a_link(
        constant(0.0),
        (0, Ramp("delay.mean_s", 0.0, 1.0, 10 * S)),
        (5 * S, Ramp("delay.mean_s", 0.2, 0.3, S)),
    )
    for at_s, mean_s in [(4, 0.4), (5, 0.2), (6, 0.3), (9, 0.3)]:
        timeline.advance(at_s * S)
        assert timeline.settings.delay.mean_s == pytest.approx(mean_s)


def test_a_ramp_keeps_the_backlog_of_a_slow_line():
    """8 bytes at 64 bit/s are on the line for 1 s; from then on each for a little less."""
    link, timeline = on_a_link(
        {"rate": {"bits_per_s": 64}}, (0, Ramp("rate.bits_per_s", 64, 128, 4))
    )
    due = [send(link, timeline, k).due_ns / S for k in range(5)]
    lengths = [1.0, 64 / 80, 64 / 96, 64 / 112, 0.5]
    assert due == [pytest.approx(sum(lengths[: k + 1])) for k in range(5)]


@pytest.mark.parametrize("lose", [False, True])
def test_a_cut_loses_what_is_sent_and_what_is_in_flight_if_asked(lose):
    link, timeline = on_a_link(constant(0.02), (S, Cut(lose_in_flight=lose)), (2 * S, Heal()))
    early, at_once, late = (send(link, timeline, S - k * MS) for k in (30, 20, 10))
    lost = timeline.advance(S)
    assert lost == ([late] if lose else [])
    assert send(link, timeline, S).fate == "lost: cut"
    assert send(link, timeline, 2 * S - 1).fate == "lost: cut"
    after = send(link, timeline, 2 * S)
    arrived = link.deliver(3 * S)
    assert arrived == ([early, at_once, after] if lose else [early, at_once, late, after])


def test_actions_of_one_instant_come_in_the_order_given():
    link, timeline = on_a_link(
        constant(0.0),
        (S, Cut()),
        (S, Heal()),
        (S, change(**constant(0.1))),
        (S, change(**constant(0.2))),
    )
    assert send(link, timeline, S).due_ns == S + 200 * MS


def test_what_can_be_ramped_are_numbers_and_nothing_else():
    assert ramped()["delay.mean_s"] is False
    assert ramped()["rate.bits_per_s"] is True
    assert "playout_s" in ramped()
    for no_number in (
        "keep_order",
        "delay.distribution",
        "delay.samples_s",
        "loss.losses",
        "delay",
    ):
        assert no_number not in ramped()
    with pytest.raises(
        ValueError, match=r"'delay.meen_s' is not a number.*did you mean 'delay.mean_s'"
    ):
        checked_parameter("delay.meen_s")


# --- partitions ---------------------------------------------------------------------------

SHAPES = [
    ({"shape": "halves"}, 5, "12 345"),
    ({"shape": "halves"}, 6, "123 456"),
    ({"shape": "isolate", "robot": 2}, 5, "2 1345"),
    ({"shape": "bridge"}, 5, "123 345"),
    ({"shape": "bridge", "robot": 1}, 5, "123 145"),
    ({"shape": "bridge"}, 6, "124 3456"),
    ({"shape": "ring"}, 5, "12 23 34 45 51"),
    ({"shape": "ring"}, 3, "123"),
    ({"groups": [[1, 2], [3, 4, 5]]}, 5, "12 345"),
    ({"groups": [[1], [5]]}, 5, "1 5 234"),
]


@pytest.mark.parametrize(("how", "count", "cliques"), SHAPES)
def test_a_partition_leaves_exactly_these_in_touch(how, count, cliques):
    action = PartitionAction(action="partition", at_s=0.0, **how)
    robots = list(range(1, count + 1))
    reach = action.reach(robots)
    in_touch = {(a, b) for a in robots for b in robots if a != b and not reach.covers(a, b)}
    expected = {
        (int(a), int(b)) for clique in cliques.split() for a in clique for b in clique if a != b
    }
    assert in_touch == expected


# --- a scenario -----------------------------------------------------------------------------

ALL = {(a, b) for a in range(1, 6) for b in range(1, 6) if a != b}


def between(*groups):
    """The links from one group to another."""
    return {(a, b) for g in groups for h in groups if g is not h for a in g for b in h}


# Links, from (ms), to (ms), what becomes of messages sent then: a delay (ms) or a loss.
# Later rows win. What a cut catches in flight stands in LOST_WITH.
EXPECTED = [
    (ALL, 0, 12001, 20),
    ({(1, 2)}, 1000, 12001, 50),
    ({(3, b) for b in (1, 2, 4, 5)}, 2000, 2500, "lost: random"),
    *(({(4, 1), (4, 5)}, t, 12001, min(120, 20 + (t - 3000) / 10)) for t in range(3000, 4001, 10)),
    ({(1, 2)}, 4500, 5000, "lost: cut"),
    ({(2, 3), (3, 2)}, 5500, 5750, "lost: cut"),
    (between([1, 2], [3, 4, 5]), 6000, 6500, "lost: cut"),
    (between([1, 2], [3, 4, 5]), 7000, 7500, "lost: cut"),
    (between([5], [1, 2, 3, 4]), 8000, 8500, "lost: cut"),
    (between([1, 2], [4, 5]), 9000, 9500, "lost: cut"),
    (
        ALL - {p for a in range(5) for p in [(a + 1, (a + 1) % 5 + 1), ((a + 1) % 5 + 1, a + 1)]},
        10000,
        10500,
        "lost: cut",
    ),
    ({(5, b) for b in (1, 2, 3, 4)}, 11000, 12001, "lost: cut"),
]
LOST_WITH = [({(1, 2)}, 4500), (between([1, 2], [3, 4, 5]), 6000)]


def expected_fate(link, sent_ms):
    """(fate, arrival in ms or None) by the table."""
    outcome = [what for links, a, b, what in EXPECTED if link in links and a <= sent_ms < b][-1]
    if isinstance(outcome, str):
        return outcome, None
    due_ms = sent_ms + outcome
    if any(link in links and sent_ms < at < due_ms for links, at in LOST_WITH):
        return "lost: cut", None
    return ("delivered", due_ms) if due_ms <= 12000 else ("in flight", None)


def test_every_action_does_what_the_table_says_tick_by_tick(root):
    scenario = load(root / "configs" / "network" / "every-action.toml")
    rows = []

    def sink(record):
        if isinstance(record, LinkRows):
            rows.extend(record.rows)

    assert Inline().run(resolve(scenario), sink).kind == "completed"
    found = {}
    for row in rows:
        key = (row.source, row.destination), row.t_sent_ns // MS
        assert key not in found, "a message has one fate"
        arrived_ms = None if row.t_usable_ns is None else row.t_usable_ns / MS
        found[key] = row.fate, arrived_ms
    assert set(found) == {(link, t) for link in ALL for t in range(0, 12001, 10)}
    for (link, sent_ms), (fate, arrived_ms) in found.items():
        wanted, due_ms = expected_fate(link, sent_ms)
        assert (fate, arrived_ms) == (wanted, due_ms and pytest.approx(due_ms, abs=1e-5)), (
            link,
            sent_ms,
        )


def test_the_plan_is_in_order_and_says_what_each_action_touches(root):
    scenario = load(root / "configs" / "network" / "every-action.toml")
    times = [entry.at_s for entry in scenario.plan]
    assert times == sorted(times)
    ring = next(entry for entry in scenario.plan if "ring" in entry.what)
    assert ring.what == "partition ring, in flight kept; cuts 1↔3, 1↔4, 2↔4, 2↔5, 3↔5"
    assert len(ring.links) == 10


def test_a_timeline_survives_being_written_and_read(root):
    scenario = load(root / "configs" / "network" / "every-action.toml")
    again = loads(dumps(scenario))
    assert again == scenario
    assert again.plan == scenario.plan


BAD = [
    (
        'action = "explode"',
        r"timeline\[0\]\.action = 'explode': must be one of 'network', 'ramp', 'cut', 'heal', 'partition'",
    ),
    ('action = "cut"\nlinks = [[1, 9]]', r"timeline\[0\]: robot 9 does not exist"),
    ('action = "cut"\nlinks = [[1, 1]]', r"timeline\[0\]: applies to no link of formation.edges"),
    ('action = "cut"\nlinks = [[1]]', r"timeline\[0\].links\[0\]\[1\]: is required"),
    ('action = "cut"\nin_flight = "gone"', r"in_flight = 'gone': must be 'kept' or 'lost'"),
    ('action = "cut"\nheal_after_s = 0.0', r"heal_after_s = 0.0: must be at least 1e-09"),
    ('action = "heal"\nin_flight = "lost"', r"timeline\[0\].in_flight = 'lost': unknown key"),
    ('action = "partition"', r"timeline\[0\] = .*: needs either groups or shape"),
    (
        'action = "partition"\nshape = "thirds"',
        r"shape = 'thirds': must be 'halves', 'isolate', 'bridge' or 'ring'",
    ),
    ('action = "partition"\nshape = "isolate"', r"shape = 'isolate' needs robot"),
    (
        'action = "partition"\nshape = "halves"\nrobot = 1',
        r"robot belongs to the shapes 'isolate' and 'bridge'",
    ),
    ('action = "partition"\ngroups = [[1, 2], [2]]', r"robot 2 is in two groups"),
    ('action = "partition"\ngroups = [[1, 9], [2]]', r"timeline\[0\]: robot 9 does not exist"),
    (
        'action = "network"\ndelay.low_s = 0.1',
        r"timeline\[0\].delay.low_s = 0.1: unknown key.*\(on the link from 1 to 2\)",
    ),
    (
        'action = "network"\ndelay.mean_s = -0.1',
        r"timeline\[0\].delay.mean_s = -0.1: must be at least 0",
    ),
    (
        'action = "network"\nloss.model = "random"\nloss.probability = 1.5',
        r"timeline\[0\].loss.probability = 1.5: must be at most 1",
    ),
    ('action = "network"\npreset = "wlan"', r"preset = 'wlan': must be one of 'ideal'"),
    ('action = "network"\ndeley.mean_s = 1.0', r"timeline\[0\].deley = .*did you mean 'delay'"),
    (
        'action = "cut"\nfrom = 1',
        r"timeline\[0\].from = 1: unknown key; here it is links = \[\[from, to\]",
    ),
    (
        'action = "ramp"\nparameter = "loss.rate"\nfrom_value = 0.0\nto_value = 1.0\nduration_s = 1.0',
        r"timeline\[0\].parameter = 'loss.rate': 'loss.rate' is not a number",
    ),
    (
        'action = "ramp"\nparameter = "delay.low_s"\nfrom_value = 0.0\nto_value = 1.0\nduration_s = 1.0',
        r"timeline\[0\].delay.low_s = 1.0: unknown key",
    ),
    (
        'action = "ramp"\nparameter = "loss.probability"\nfrom_value = 0.0\nto_value = 1.5\nduration_s = 1.0',
        r"timeline\[0\].loss.probability = 1.5: must be at most 1",
    ),
    (
        'action = "ramp"\nparameter = "loss.probability"\nfrom_value = 0.0\nto_value = 0.5\nduration_s = 0.0',
        r"timeline\[0\].duration_s = 0.0: must be at least 1e-09",
    ),
    (
        'action = "ramp"\nparameter = "loss.probability"\nto_value = 0.5\nduration_s = 1.0',
        r"timeline\[0\].from_value: is required",
    ),
]


@pytest.mark.parametrize(("action", "words"), BAD)
def test_bad_action_is_named(root, action, words):
    text = (root / "configs" / "paper" / "theorem2.toml").read_text(encoding="utf-8")
    with pytest.raises(ScenarioError, match=words):
        loads(text + f"\n[[timeline]]\nat_s = 1.0\n{action}\n")


def test_a_part_that_a_link_rule_names_must_go_with_the_link(root):
    text = (root / "configs" / "paper" / "theorem2.toml").read_text(encoding="utf-8")
    rule = '\n[[network.links]]\nfrom = 2\nto = "*"\ndelay.high_s = 0.1\n'
    with pytest.raises(ScenarioError, match=r"network.links\[0\].delay.high_s = 0.1: unknown key"):
        loads(text + rule)
