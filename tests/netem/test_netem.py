"""Links: exact delivery times, streams that nothing else disturbs, and honest statistics.

A statistical test states its confidence: with the seeds written here the p-value
must exceed ALPHA, which a correct link with a fresh seed would fail once in 1000.
"""

import itertools
from fractions import Fraction
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from formnet.netem import (
    DELIVERED,
    LOST_RANDOM,
    ConstantDelay,
    LinkOverrides,
    LinkSettings,
    RandomLoss,
    Transit,
    UniformDelay,
    stream,
)
from formnet.netem.core.link import Link
from formnet.netem.files.tables import nanoseconds
from formnet.netem.settings.delays import ConstantDelaySettings, UniformDelaySettings
from formnet.netem.settings.losses import RandomLossSettings

ALPHA = 0.001
MS = 1_000_000

times = st.integers(0, 10**15)
delays = st.integers(0, 3600 * 10**9)


def link(*impairments, seed=7, source=1, destination=2):
    return Link(impairments, seed=seed, source=source, destination=destination)


def sent(a_link, count, period_ns=10 * MS):
    """The copies of ``count`` messages, one every period."""
    return [
        copy for k in range(count) for copy in a_link.send(k * period_ns, k, k.to_bytes(4, "big"))
    ]


def travel_times(copies):
    return [copy.due_ns - copy.sent_ns for copy in copies]


class Scripted:
    """An impairment with its delays written down, one for each message."""

    name = "scripted"

    def __init__(self, *delays_ns):
        self._delays = iter(delays_ns)

    def twin(self):
        return self

    def inherit(self, before):
        pass

    def apply(self, copy, random):
        copy.due_ns += next(self._delays)


# --- when a message is delivered ------------------------------------------------------


@given(times, delays)
def test_delivered_if_and_only_if_sent_plus_delay_is_past(sent_ns, delay_ns):
    a_link = link(ConstantDelay(delay_ns))
    a_link.send(sent_ns, 3, b"payload")
    assert a_link.next_due_ns == sent_ns + delay_ns
    assert a_link.deliver(sent_ns + delay_ns - 1) == []
    assert a_link.deliver(sent_ns + delay_ns) == [
        Transit(3, sent_ns, sent_ns + delay_ns, b"payload", DELIVERED)
    ]
    assert a_link.next_due_ns is None
    assert a_link.deliver(sent_ns + delay_ns + 1) == []


@given(st.integers(1, 10**9), st.integers(0, 12))
def test_on_grid_delay_is_neither_a_tick_early_nor_late(period_ns, ticks):
    a_link = link(ConstantDelay(ticks * period_ns))
    for k in range(30):
        a_link.send(k * period_ns, k, b"")
        arrived = [copy.sequence for copy in a_link.deliver(k * period_ns)]
        assert arrived == ([k - ticks] if k >= ticks else [])


@given(times)
def test_no_delay_delivers_at_the_same_instant(now_ns):
    for a_link in (link(), link(ConstantDelay(0)), link(UniformDelay(0, 0))):
        a_link.send(now_ns, 0, b"x")
        assert a_link.next_due_ns == now_ns
        assert [copy.due_ns for copy in a_link.deliver(now_ns)] == [now_ns]


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 6)), max_size=40))
def test_deliveries_come_by_due_time_and_ties_in_the_order_of_sending(script):
    a_link = link(Scripted(*(delay for _, delay in script)))
    sent_at = list(itertools.accumulate(gap for gap, _ in script))
    due = [s + delay for s, (_, delay) in zip(sent_at, script, strict=True)]
    for k, now in enumerate(sent_at):
        a_link.send(now, k, b"")
        assert a_link.next_due_ns == min(due[: k + 1])
    expected = sorted(range(len(due)), key=due.__getitem__)  # a stable sort
    delivered = []
    for now in range(max(due, default=0) + 1):
        batch = a_link.deliver(now)
        assert [copy.due_ns for copy in batch] == [now] * len(batch)
        delivered += [copy.sequence for copy in batch]
        assert a_link.next_due_ns == min((d for d in due if d > now), default=None)
    assert delivered == expected


def test_empty_link_has_nothing_due():
    a_link = link(ConstantDelay(5))
    assert a_link.next_due_ns is None
    assert a_link.deliver(10**18) == []


def test_lost_message_is_reported_and_never_delivered():
    a_link = link(RandomLoss(1.0), ConstantDelay(5))
    (copy,) = a_link.send(0, 0, b"x")
    assert copy.fate == LOST_RANDOM
    assert a_link.next_due_ns is None
    assert a_link.deliver(10**18) == []


def test_delays_of_two_impairments_add_up():
    a_link = link(ConstantDelay(3), Scripted(4))
    assert travel_times(a_link.send(10, 0, b"")) == [7]


# --- streams --------------------------------------------------------------------------


def test_stream_depends_on_each_of_its_four_names_and_on_nothing_else():
    base = (7, 1, 2, "delay")
    others = [
        (8, 1, 2, "delay"),
        (7, 3, 2, "delay"),
        (7, 1, 3, "delay"),
        (7, 1, 2, "loss"),
        (7, 2, 1, "delay"),
        (71, 2, 2, "delay"),
        (7, 12, 2, "delay"),
    ]
    draws = {names: stream(*names).random() for names in [base, *others]}
    assert len(set(draws.values())) == len(draws)
    a, b = stream(*base), stream(*base)
    assert [a.random() for _ in range(100)] == [b.random() for _ in range(100)]


def test_stream_is_the_one_that_recorded_runs_were_drawn_from():
    """A change of the derivation would silently change every seeded scenario."""
    by_hand = Random(0xAD50C766BB0ED5670A67B43B7B3315991950DBD804F3A9190CA7CC19A3E59150)
    assert stream(1, 1, 2, "delay").random() == by_hand.random()


def test_same_seed_repeats_and_another_seed_does_not():
    def run(seed):
        return sent(link(RandomLoss(0.3), UniformDelay(0, 10**9), seed=seed), 200)

    assert run(1) == run(1)
    assert travel_times(run(1)) != travel_times(run(2))
    assert [c.fate for c in run(1)] != [c.fate for c in run(2)]


@given(st.integers(0, 2**64), st.floats(0, 1))
def test_adding_loss_changes_no_delay(seed, probability):
    delay = UniformDelay(5 * MS, 300 * MS)
    alone = travel_times(sent(link(delay, seed=seed), 50))
    assert travel_times(sent(link(RandomLoss(probability), delay, seed=seed), 50)) == alone
    assert travel_times(sent(link(delay, RandomLoss(probability), seed=seed), 50)) == alone


def test_delay_changes_no_loss():
    alone = [c.fate for c in sent(link(RandomLoss(0.4)), 300)]
    both = sent(link(UniformDelay(0, MS), RandomLoss(0.4)), 300)
    assert [c.fate for c in both] == alone
    assert {DELIVERED, LOST_RANDOM} == set(alone)


def test_more_loss_loses_the_same_messages_and_more():
    """A message's draw is its own, so a higher probability only adds losses."""
    few, many = (
        {c.sequence for c in sent(link(RandomLoss(p)), 500) if c.fate == LOST_RANDOM}
        for p in (0.1, 0.3)
    )
    assert few < many


def test_adding_another_link_changes_nothing():
    def make(destination):
        return link(RandomLoss(0.2), UniformDelay(0, 10**9), destination=destination)

    alone = sent(make(2), 100)
    first, second = make(2), make(3)
    together, other = [], []
    for k in range(100):
        other += second.send(k * 10 * MS, k, b"other")
        together += first.send(k * 10 * MS, k, k.to_bytes(4, "big"))
    assert together == alone
    assert travel_times(other) != travel_times(alone)


def test_the_two_directions_of_a_link_draw_separately():
    there = sent(link(UniformDelay(0, 10**9), source=1, destination=2), 20)
    back = sent(link(UniformDelay(0, 10**9), source=2, destination=1), 20)
    assert travel_times(there) != travel_times(back)


# --- statistics -----------------------------------------------------------------------


@given(st.integers(0, 10**12), st.integers(0, 10**10), st.integers(0, 2**32))
def test_uniform_delay_stays_in_its_range(low_ns, width_ns, seed):
    copies = sent(link(UniformDelay(low_ns, low_ns + width_ns), seed=seed), 20)
    assert all(type(d) is int and low_ns <= d <= low_ns + width_ns for d in travel_times(copies))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_uniform_delay_reaches_every_nanosecond_equally(seed):
    """Both ends included. Chi-square against four equal cells, confidence 1 - ALPHA."""
    found = travel_times(sent(link(UniformDelay(10, 13), seed=seed), 4000))
    counts = [found.count(d) for d in (10, 11, 12, 13)]
    assert sum(counts) == 4000
    assert stats.chisquare(counts).pvalue > ALPHA


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_uniform_delay_is_uniform(seed):
    """Kolmogorov-Smirnov, confidence 1 - ALPHA."""
    low, high = 50 * MS, 300 * MS
    found = travel_times(sent(link(UniformDelay(low, high), seed=seed), 5000))
    assert stats.kstest(found, "uniform", args=(low, high - low)).pvalue > ALPHA
    # That the test has teeth: it rejects a range that is 5 % too wide.
    assert stats.kstest(found, "uniform", args=(low, 1.05 * (high - low))).pvalue < ALPHA


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_successive_delays_are_uncorrelated(seed):
    found = travel_times(sent(link(UniformDelay(0, 10**9), seed=seed), 3000))
    assert stats.pearsonr(found[:-1], found[1:]).pvalue > ALPHA


@pytest.mark.parametrize("probability", [0.01, 0.2, 0.75])
@pytest.mark.parametrize("seed", [1, 2])
def test_loss_rate(probability, seed):
    """The exact (Clopper-Pearson) binomial interval of confidence 1 - ALPHA holds the rate."""
    fates = [c.fate for c in sent(link(RandomLoss(probability), seed=seed), 10_000)]
    result = stats.binomtest(fates.count(LOST_RANDOM), len(fates))
    interval = result.proportion_ci(confidence_level=1 - ALPHA)
    assert interval.low <= probability <= interval.high
    assert interval.high - interval.low < 0.04  # it says something


@pytest.mark.parametrize("seed", [1, 2])
def test_losses_are_independent_of_the_loss_before(seed):
    lost = [c.fate == LOST_RANDOM for c in sent(link(RandomLoss(0.3), seed=seed), 10_000)]
    after_loss = [now for before, now in itertools.pairwise(lost) if before]
    assert stats.binomtest(sum(after_loss), len(after_loss), 0.3).pvalue > ALPHA


@pytest.mark.parametrize("seed", [1, 2])
def test_lost_messages_have_delays_like_the_others(seed):
    """Loss and delay are independent: two-sample KS, confidence 1 - ALPHA."""
    copies = sent(link(RandomLoss(0.5), UniformDelay(0, 10**9), seed=seed), 4000)
    lost = [c for c in copies if c.fate == LOST_RANDOM]
    arrived = [c for c in copies if c.fate == DELIVERED]
    assert stats.ks_2samp(travel_times(lost), travel_times(arrived)).pvalue > ALPHA


@pytest.mark.parametrize("probability", [0.0, 1.0])
def test_loss_of_none_and_of_all_is_exact(probability):
    fates = {c.fate for c in sent(link(RandomLoss(probability)), 1000)}
    assert fates == {LOST_RANDOM if probability else DELIVERED}


def test_uniform_delay_above_the_spacing_overtakes():
    """At 10 ms spacing and 0-100 ms, 100 messages all in order would be a 1e-40 event."""
    a_link = link(UniformDelay(0, 100 * MS))
    sent(a_link, 100)
    arrived = [copy.sequence for copy in a_link.deliver(10**18)]
    assert sorted(arrived) == list(range(100))
    assert arrived != sorted(arrived)


def test_uniform_delay_below_the_spacing_keeps_the_order():
    a_link = link(UniformDelay(0, 10 * MS - 1))
    sent(a_link, 100)
    assert [copy.sequence for copy in a_link.deliver(10**18)] == list(range(100))


# --- bad parameters -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ConstantDelay(-1), ["delay_ns", "-1"]),
        (lambda: UniformDelay(-5, 3), ["low_ns=-5", "high_ns=3"]),
        (lambda: UniformDelay(5, 3), ["low_ns=5", "high_ns=3"]),
        (lambda: RandomLoss(1.5), ["probability", "1.5"]),
        (lambda: RandomLoss(-0.25), ["probability", "-0.25"]),
        (lambda: RandomLoss(float("nan")), ["probability", "nan"]),
        (lambda: ConstantDelaySettings(mean_s=-0.125), ["mean_s", "-0.125"]),
        (lambda: ConstantDelaySettings(mean_s=3600.5), ["mean_s", "3600.5"]),
        (lambda: ConstantDelaySettings(mean_s=float("nan")), ["mean_s", "nan"]),
        (lambda: ConstantDelaySettings(mean_s="0.1"), ["mean_s", "0.1"]),
        (
            lambda: UniformDelaySettings(distribution="uniform", low_s=0.3, high_s=0.2),
            ["low_s = 0.3", "high_s = 0.2"],
        ),
        (lambda: RandomLossSettings(probability=1.25), ["probability", "1.25"]),
        (lambda: LinkSettings.model_validate({"dealy": {}}), ["dealy"]),
    ],
)
def test_bad_parameter_is_refused_and_shown(make, words):
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - the text is checked below
        make()
    for word in words:
        assert word in str(caught.value)


def test_impairments_of_a_link_need_distinct_names():
    with pytest.raises(ValueError, match=r"distinct names.*'delay', 'delay'"):
        link(ConstantDelay(1), UniformDelay(1, 2))


# --- settings -------------------------------------------------------------------------

CONSTANT = ConstantDelaySettings(mean_s=0.1)
UNIFORM = UniformDelaySettings(distribution="uniform", low_s=0.05, high_s=0.3)
LOSSY = RandomLossSettings(probability=0.25)


@pytest.mark.parametrize("base", [LinkSettings(), LinkSettings(delay=UNIFORM, loss=LOSSY)])
@pytest.mark.parametrize("delay", [None, CONSTANT, UNIFORM, ConstantDelaySettings()])
@pytest.mark.parametrize("loss", [None, LOSSY, RandomLossSettings()])
def test_change_replaces_exactly_what_it_names(base, delay, loss):
    """Naming a default (no delay, no loss) is naming it."""
    before = base.model_copy(deep=True)
    changed = base.changed(LinkOverrides(delay=delay, loss=loss).values())
    assert changed.delay == (base.delay if delay is None else delay)
    assert changed.loss == (base.loss if loss is None else loss)
    assert base == before


def test_default_settings_are_an_ideal_link():
    a_link = LinkSettings().link(seed=1, source=1, destination=2)
    copies = sent(a_link, 100)
    assert {c.fate for c in copies} == {DELIVERED}
    assert set(travel_times(copies)) == {0}


def test_settings_make_the_link_they_describe():
    by_settings = LinkSettings(delay=UNIFORM, loss=LOSSY).link(seed=7, source=1, destination=2)
    by_hand = link(RandomLoss(0.25), UniformDelay(50 * MS, 300 * MS))
    assert sent(by_settings, 200) == sent(by_hand, 200)


@given(st.integers(0, 3600 * 10**9))
def test_every_whole_nanosecond_survives_being_written_in_seconds(ns):
    assert nanoseconds(ns / 1e9) == ns
    assert nanoseconds(float(f"{ns // 10**9}.{ns % 10**9:09d}")) == ns
    a_link = link(ConstantDelaySettings(mean_s=ns / 1e9).impairment())
    assert travel_times(a_link.send(0, 0, b"")) == [ns]


@given(st.floats(0, 3600))
def test_seconds_are_rounded_to_the_nearest_nanosecond(seconds):
    exact = Fraction(seconds) * 10**9
    # The product is rounded once, by at most half an ulp of 3.6e12.
    assert abs(nanoseconds(seconds) - exact) <= Fraction(1, 2) + Fraction(1, 2**11)
