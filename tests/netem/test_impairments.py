"""Impairments against closed forms, and the promises every one of them keeps.

A statistical test states its confidence: with the seeds written here the p-value
must exceed ALPHA, which a correct link with a fresh seed would fail once in 1000.
"""

import gc
import itertools
import math
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from formnet.netem import (
    CORRUPTED,
    DELIVERED,
    DUPLICATED,
    LOST_BURST,
    LOST_CUT,
    LOST_LATE,
    LOST_QUEUE,
    LOST_RANDOM,
    LOST_TRACE,
    ConstantDelay,
    Corrupt,
    Duplicate,
    EveryNthLoss,
    FourState,
    GilbertElliott,
    KeepOrder,
    Link,
    LinkSettings,
    Playout,
    PredicateLoss,
    QueueEntry,
    QueueExit,
    QueueLimit,
    RandomDelay,
    RandomLoss,
    Rate,
    Reorder,
    Slots,
    TraceDelay,
    TraceLoss,
    UniformDelay,
)
from formnet.netem.delays import distributions as d

ALPHA = 0.001
SEED = 20260
MANY = 100_000
MS = 1_000_000


def link(*impairments, seed=SEED, duplicate=None):
    return Link(impairments, seed=seed, source=1, destination=2, duplicate=duplicate)


def sent(a_link, count, period_ns=10 * MS, payload=b"\0" * 8):
    """What becomes of ``count`` messages, one each ``period_ns``.

    A message is in no circle, and looking for circles among all of them takes most of the time.
    """
    gc.disable()
    try:
        return [copy for k in range(count) for copy in a_link.send(k * period_ns, k, payload)]
    finally:
        gc.enable()


def delays_s(copies):
    return np.array([copy.due_ns - copy.sent_ns for copy in copies]) / 1e9


class Jitter:
    """Makes messages arrive unevenly before whatever stands behind it."""

    name = "jitter"

    def twin(self):
        return self

    def inherit(self, before):
        pass

    def apply(self, copy, random):
        copy.due_ns += int(random.random() * 50 * MS)


def runs(flags):
    """The lengths of the stretches of true."""
    return np.array([len(list(group)) for value, group in itertools.groupby(flags) if value])


# --- distributions of delay -----------------------------------------------------------

LAWS = {
    "normal": (d.Normal(0.05, 0.01), stats.truncnorm(-5, np.inf, 0.05, 0.01)),
    "normal, half of it cut off": (d.Normal(0.01, 0.01), stats.truncnorm(-1, np.inf, 0.01, 0.01)),
    "lognormal": (
        d.LogNormal(0.05, 0.03),
        stats.lognorm(math.sqrt(math.log1p(0.36)), scale=0.05 / math.sqrt(1.36)),
    ),
    "gamma": (d.Gamma(0.05, 0.02), stats.gamma(6.25, scale=0.008)),
    "weibull": (d.Weibull(0.05, 1.5), stats.weibull_min(1.5, scale=0.05)),
    "pareto": (d.Pareto(0.02, 5.0), stats.pareto(5.0, scale=0.02)),
    "exponential": (d.Exponential(0.05), stats.expon(scale=0.05)),
}


@pytest.mark.parametrize("name", LAWS)
@given(u=st.floats(1e-12, 1 - 1e-12))
def test_quantile_function_is_scipys(name, u):
    law, reference = LAWS[name]
    # SciPy's truncnorm.ppf loses digits in the upper tail, its isf does not.
    expected = float(reference.ppf(u) if u < 0.5 else reference.isf(1 - u))
    assert law.quantile(u) == pytest.approx(expected, rel=1e-9, abs=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("correlation", [0.0, 0.5])
@pytest.mark.parametrize("name", LAWS)
def test_delays_have_the_distribution(name, correlation):
    """Mean, standard deviation, quantiles and KS; correlated, the marginal is the same.

    Uncorrelated: KS on all, confidence 1 - ALPHA, the mean within 4.4 standard errors,
    quantiles within the binomial interval of 1 - ALPHA. Correlated: on every 25th, by
    which time an AR(1) of 0.5 has forgotten (0.5^25 = 3e-8).
    """
    law, reference = LAWS[name]
    found = delays_s(sent(link(RandomDelay(law, correlation=correlation)), MANY))
    found = found[:: 25 if correlation else 1]
    assert stats.kstest(found, reference.cdf).pvalue > ALPHA, f"seed {SEED}"
    n = len(found)
    assert abs(found.mean() - reference.mean()) < 4.4 * reference.std() / math.sqrt(n)
    kurtosis = float(reference.stats("k"))
    error = reference.std() * math.sqrt((kurtosis + 2) / (4 * n))  # delta method
    assert abs(found.std() - reference.std()) < 6 * error
    for q in (0.05, 0.5, 0.95, 0.99):
        below = int((found <= reference.ppf(q)).sum())
        assert stats.binomtest(below, n, q).pvalue > ALPHA, f"quantile {q}, seed {SEED}"
    # That the test has teeth: more delay is seen, 5 % in all, 20 % in every 25th.
    assert stats.kstest(found * (1.2 if correlation else 1.05), reference.cdf).pvalue < ALPHA


@pytest.mark.long
@pytest.mark.parametrize("wanted", [0.25, 0.5, 0.75])
@pytest.mark.parametrize("name", [*LAWS, "uniform", "empirical"])
def test_lag_1_correlation_of_delays(name, wanted):
    """Within 0.02, at 200,000 messages."""
    if name == "uniform":
        delay = UniformDelay(10 * MS, 90 * MS, correlation=wanted)
    elif name == "empirical":
        samples = d.Empirical([0.001, 0.002, 0.01, 0.05])
        delay = RandomDelay(samples, correlation=wanted)
    else:
        delay = RandomDelay(LAWS[name][0], correlation=wanted)
    found = delays_s(sent(link(delay), 200_000))
    assert np.corrcoef(found[:-1], found[1:])[0, 1] == pytest.approx(wanted, abs=0.02), SEED


def test_empirical_delays_are_the_samples_equally_often():
    samples = [0.003, 0.001, 0.01, 0.001]
    found = delays_s(sent(link(RandomDelay(d.Empirical(samples))), MANY))
    counts = [int((found == value).sum()) for value in (0.001, 0.003, 0.01)]
    assert sum(counts) == MANY
    assert stats.chisquare(counts, [MANY / 2, MANY / 4, MANY / 4]).pvalue > ALPHA


def test_offset_is_added_to_every_delay():
    plain = delays_s(sent(link(RandomDelay(d.Exponential(0.01))), 100))
    moved = delays_s(sent(link(RandomDelay(d.Exponential(0.01), offset_s=0.5)), 100))
    np.testing.assert_allclose(moved, plain + 0.5, atol=2e-9)


def test_delay_trace_is_replayed_and_loops():
    a_link = link(TraceDelay([0, 10, 25], [3, 7, 1], 40))
    found = {t: a_link.send(t, t, b"")[0].due_ns - t for t in (0, 9, 10, 24, 25, 39, 40, 50, 65)}
    assert found == {0: 3, 9: 3, 10: 7, 24: 7, 25: 1, 39: 1, 40: 3, 50: 7, 65: 1}


# --- loss -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("p", "r", "in_bad", "in_good"),
    [(0.01, 0.2, 1.0, 0.0), (0.05, 0.5, 0.8, 0.01), (0.3, None, 1.0, 0.0)],
)
def test_gilbert_elliott_loses_at_its_rate(p, r, in_bad, in_good):
    """Mean loss within 4.4 standard errors; the variance of the mean is that of the chain.

    With a_k the autocovariance of the loss indicator, n var = a_0 + 2 Σ a_k, and
    a_k = π (1 − π) (h − g)² (1 − p − r)^k for k ≥ 1.
    """
    n = 400_000
    copies = sent(link(GilbertElliott(p, r, in_bad, in_good)), n)
    r = 1 - p if r is None else r
    pi, memory = p / (p + r), 1 - p - r
    mean = (1 - pi) * in_good + pi * in_bad
    assert mean == pytest.approx((r * in_good + p * in_bad) / (p + r))
    spread = pi * (1 - pi) * (in_bad - in_good) ** 2
    variance = mean * (1 - mean) + 2 * spread * memory / (1 - memory)
    lost = np.mean([c.lost for c in copies])
    assert abs(lost - mean) < 4.4 * math.sqrt(variance / n), f"seed {SEED}"


def geometric(lengths, stop):
    """Chi-square of burst lengths against the geometric law of ending with ``stop``."""
    most = 1 + max(1, int(math.log(5 / len(lengths) / stop) / math.log(1 - stop)))
    seen = [int((lengths == k).sum()) for k in range(1, most)] + [int((lengths >= most).sum())]
    share = [stop * (1 - stop) ** (k - 1) for k in range(1, most)] + [(1 - stop) ** (most - 1)]
    return stats.chisquare(seen, np.array(share) * len(lengths)).pvalue


def test_gilbert_bursts_are_geometric():
    """In the Gilbert model a burst ends with r."""
    copies = sent(link(GilbertElliott(0.02, 0.25)), 400_000)
    assert {c.fate for c in copies} == {DELIVERED, LOST_BURST}
    lengths = runs(c.lost for c in copies)
    assert geometric(lengths, 0.25) > ALPHA, f"seed {SEED}"
    assert geometric(lengths, 0.27) < ALPHA  # it has teeth


def test_four_state_loses_at_its_rate_in_geometric_bursts():
    """With p32 = 0 a burst ends with p31; single losses come beside it."""
    p13, p31, p32, p23, p14 = 0.02, 0.3, 0.1, 0.5, 0.005
    n = 400_000
    copies = sent(link(FourState(p13, p31, p32, p23, p14)), n)
    a = p13 / p31
    mean = (a + p14) / (1 + p14 + a * (1 + p32 / p23))
    # Batch means: 400 batches are independent but for their edges.
    batches = np.array([c.lost for c in copies]).reshape(400, -1).mean(axis=1)
    error = batches.std(ddof=1) / math.sqrt(len(batches))
    assert abs(batches.mean() - mean) < 4.4 * error, f"seed {SEED}"
    assert error < 0.03 * mean  # it says something
    fates = [c.fate for c in copies]
    assert set(fates) == {DELIVERED, LOST_BURST, LOST_RANDOM}
    lengths = runs(fate == LOST_BURST for fate in fates)
    assert geometric(lengths, p31 + p32) > ALPHA, f"seed {SEED}"


def test_four_state_defaults_are_independent_losses():
    lost = [c.lost for c in sent(link(FourState(0.1)), MANY)]
    assert stats.binomtest(sum(lost), MANY, 0.1).pvalue > ALPHA
    after = [now for before, now in itertools.pairwise(lost) if before]
    assert stats.binomtest(sum(after), len(after), 0.1).pvalue > ALPHA


@pytest.mark.long
@pytest.mark.parametrize(("probability", "correlation"), [(0.003, 0.25), (0.2, 0.75), (0.5, 0.5)])
def test_correlated_loss_hits_its_rate_and_its_correlation(probability, correlation):
    """tc-netem's man page has "0.3% 25%"; its formula then drops nothing, and 0.11 % at 20 %, 75 %.

    The indicator is an AR(1)-like chain: n var = p (1 − p) (1 + c) / (1 − c).
    """
    n = 500_000
    lost = np.array([c.lost for c in sent(link(RandomLoss(probability, correlation)), n)])
    variance = probability * (1 - probability) * (1 + correlation) / (1 - correlation)
    assert abs(lost.mean() - probability) < 4.4 * math.sqrt(variance / n), f"seed {SEED}"
    found = np.corrcoef(lost[:-1], lost[1:])[0, 1]
    assert found == pytest.approx(correlation, abs=0.06 if probability < 0.01 else 0.02), SEED


def test_loss_by_count_trace_and_rule():
    every = [c.lost for c in sent(link(EveryNthLoss(3)), 7)]
    assert every == [False, False, True, False, False, True, False]
    trace = sent(link(TraceLoss([True, False, False])), 5)
    assert [c.fate for c in trace] == [LOST_TRACE, DELIVERED, DELIVERED, LOST_TRACE, DELIVERED]
    odd = sent(link(PredicateLoss(lambda copy: copy.sequence % 2 == 1)), 4)
    assert [c.lost for c in odd] == [False, True, False, True]


# --- duplicates, corruption, order ----------------------------------------------------


def test_duplicates_come_at_their_rate_and_take_their_own_way():
    copies = sent(link(UniformDelay(0, 10**9), duplicate=Duplicate(0.1)), MANY)
    extra = [c for c in copies if c.fate == DUPLICATED]
    assert len(copies) == MANY + len(extra)
    assert stats.binomtest(len(extra), MANY, 0.1).pvalue > ALPHA
    assert stats.kstest(delays_s(extra), "uniform").pvalue > ALPHA
    first = {c.sequence: c.due_ns for c in copies if c.fate == DELIVERED}
    both = np.array([(first[c.sequence] - c.sent_ns, c.due_ns - c.sent_ns) for c in extra])
    assert stats.pearsonr(both[:, 0], both[:, 1]).pvalue > ALPHA


def test_corruption_flips_one_bit_anywhere():
    copies = sent(link(Corrupt(0.25)), 40_000, payload=b"\xa5" * 4)
    damaged = [c for c in copies if c.fate == CORRUPTED]
    assert stats.binomtest(len(damaged), len(copies), 0.25).pvalue > ALPHA
    flipped = [int.from_bytes(c.payload) ^ 0xA5A5A5A5 for c in damaged]
    assert all(bits.bit_count() == 1 for bits in flipped)
    counts = [flipped.count(1 << bit) for bit in range(32)]
    assert stats.chisquare(counts).pvalue > ALPHA
    assert all(c.payload == b"\xa5" * 4 for c in copies if c.fate == DELIVERED)
    assert sent(link(Corrupt(1.0)), 1, payload=b"")[0].fate == DELIVERED


def test_every_gap_th_message_is_hurried():
    copies = sent(link(Reorder(1.0, gap=5), ConstantDelay(30 * MS)), 20)
    assert [c.sequence for c in copies if c.due_ns == c.sent_ns] == [4, 9, 14, 19]
    half = sent(link(Reorder(0.5), ConstantDelay(1)), MANY)
    assert stats.binomtest(sum(c.hurried for c in half), MANY, 0.5).pvalue > ALPHA


def test_order_is_kept_when_asked():
    a_link = link(UniformDelay(0, 100 * MS), KeepOrder())
    sent(a_link, 2000)
    arrived = a_link.deliver(10**18)
    assert [c.sequence for c in arrived] == list(range(2000))
    assert [c.due_ns for c in arrived] == sorted(c.due_ns for c in arrived)


# --- rate, queue, slots, playout, cuts ------------------------------------------------


@given(
    st.lists(st.tuples(st.integers(0, 3_000_000), st.integers(0, 2000)), min_size=1, max_size=40),
    st.integers(1, 10**9),
    st.integers(0, 100),
    st.sampled_from([(0, 0), (48, 5), (1, 0)]),
)
def test_rate_is_exceeded_over_no_window(script, rate, overhead, cells):
    """Between any two departures no more bits leave than the rate allows."""
    stage = Rate(rate, overhead, *cells)
    a_link = link(stage)
    now, log = 0, []
    for k, (gap, size) in enumerate(script):
        now += gap
        (copy,) = a_link.send(now, k, b"x" * size)
        length = size + overhead
        if cells[0]:
            length = math.ceil(length / cells[0]) * sum(cells)
        log.append((copy.due_ns, 8 * length))
        assert copy.due_ns >= now + 8 * length * 10**9 / rate * (1 - 1e-15)
    for first, last in itertools.combinations(range(len(log)), 2):
        bits = sum(length for _, length in log[first + 1 : last + 1])
        assert bits * 10**9 <= rate * (log[last][0] - log[first][0])


def test_queue_counts_what_is_under_way():
    limit = QueueLimit(messages=2)
    a_link = link(QueueEntry(limit), ConstantDelay(25), QueueExit(limit))
    fates = [a_link.send(t, k, b"abc")[0].fate for k, t in enumerate((0, 10, 20, 25, 26, 35))]
    assert fates == [DELIVERED, DELIVERED, LOST_QUEUE, DELIVERED, LOST_QUEUE, DELIVERED]


@given(
    st.lists(st.tuples(st.integers(0, 50), st.integers(0, 30)), max_size=60),
    st.integers(0, 5),
    st.integers(0, 60),
)
def test_queue_never_holds_more_than_its_limits(script, messages, size_limit):
    limit = QueueLimit(messages, size_limit)
    a_link = link(QueueEntry(limit), UniformDelay(0, 200), QueueExit(limit))
    now, kept = 0, []
    for k, (gap, size) in enumerate(script):
        now += gap
        (copy,) = a_link.send(now, k, b"x" * size)
        held = [size for due, size in kept if due > now]
        fits = (not messages or len(held) < messages) and (
            not size_limit or sum(held) + size <= size_limit
        )
        assert copy.fate == (DELIVERED if fits else LOST_QUEUE)
        if fits:
            kept.append((copy.due_ns, size))


def test_slots_open_in_their_range_and_hold_what_they_hold():
    a_link = link(Slots(5 * MS, 9 * MS, messages=3, bytes_=100))
    copies = sent(a_link, 3000, period_ns=2 * MS, payload=b"x" * 40)
    opened = {}
    for c in copies:
        assert c.due_ns >= c.sent_ns
        opened[c.due_ns] = opened.get(c.due_ns, 0) + 1
    assert max(opened.values()) == 2  # three would be 120 bytes
    gaps = np.diff(sorted(opened))
    assert gaps.min() >= 5 * MS
    assert gaps.max() <= 9 * MS  # a message waits in every slot at this load
    assert [c.due_ns for c in copies] == sorted(c.due_ns for c in copies)


def test_a_message_larger_than_a_slot_has_one_to_itself():
    copies = sent(link(Slots(10, 10, bytes_=5)), 3, period_ns=0, payload=b"x" * 8)
    assert [c.due_ns for c in copies] == [0, 10, 20]


def test_playout_makes_random_delay_constant_and_the_rest_late():
    copies = sent(link(UniformDelay(0, 100 * MS), Playout(80 * MS)), MANY)
    late = [c for c in copies if c.fate == LOST_LATE]
    assert stats.binomtest(len(late), MANY, 0.2).pvalue > ALPHA
    assert {c.due_ns - c.sent_ns for c in copies if not c.lost} == {80 * MS}


def test_cut_loses_what_is_sent_and_in_flight_only_if_asked():
    a_link = link(ConstantDelay(100))
    a_link.send(0, 0, b"")
    assert a_link.cut(10, lose_in_flight=False) == []
    assert a_link.send(10, 1, b"")[0].fate == LOST_CUT
    a_link.heal()
    a_link.send(20, 2, b"")
    assert [c.sequence for c in a_link.deliver(1000)] == [0, 2]
    a_link.send(1900, 3, b"")
    a_link.send(1901, 4, b"")
    (lost,) = a_link.cut(2000, lose_in_flight=True)  # what is due at that instant has arrived
    assert (lost.sequence, lost.fate) == (4, LOST_CUT)
    assert [c.sequence for c in a_link.in_flight] == [3]
    assert [c.sequence for c in a_link.deliver(10**9)] == [3]


# --- what every link promises ---------------------------------------------------------

shares = st.floats(0.0, 1.0)
any_settings = st.fixed_dictionaries(
    {},
    optional={
        "loss": st.one_of(
            st.builds(lambda p, c: {"probability": p, "correlation": c}, shares, st.floats(0, 0.9)),
            st.builds(lambda p, r: {"model": "gilbert_elliott", "p": p, "r": r}, shares, shares),
            st.builds(lambda p: {"model": "four_state", "p13": p}, shares),
        ),
        "delay": st.one_of(
            st.just({"distribution": "constant", "mean_s": 0.02}),
            st.just({"distribution": "uniform", "low_s": 0.0, "high_s": 0.1, "correlation": 0.3}),
            st.just({"distribution": "exponential", "mean_s": 0.02, "offset_s": 0.001}),
        ),
        "duplicate": st.builds(lambda p: {"probability": p}, shares),
        "corrupt": st.builds(lambda p: {"probability": p}, shares),
        "reorder": st.builds(lambda p, g: {"probability": p, "gap": g}, shares, st.integers(1, 4)),
        "rate": st.just({"bits_per_s": 100_000, "overhead_bytes": 10}),
        "queue": st.just({"messages": 3}),
        "slots": st.just({"min_s": 0.002, "max_s": 0.02, "messages": 2}),
        "keep_order": st.booleans(),
        "playout_s": st.sampled_from([0.0, 0.05]),
    },
)


def made(table, seed=1):
    settings = LinkSettings.model_validate(table)
    return settings.link(seed=seed, source=1, destination=2)


@settings(max_examples=200)
@given(any_settings, st.integers(0, 2**32))
def test_nothing_is_lost_that_is_not_recorded_as_lost(table, seed):
    """Every copy is delivered exactly once, at its due time, unless its fate says lost."""
    a_link = made(table, seed)
    copies = sent(a_link, 40)
    assert sorted({c.sequence for c in copies}) == list(range(40))
    delivered, now = [], 0
    while (due := a_link.next_due_ns) is not None:
        assert due >= now
        now = due
        assert a_link.deliver(due - 1) == []
        delivered += a_link.deliver(due)
    assert sorted(map(id, delivered)) == sorted(id(c) for c in copies if not c.lost)
    assert all(c.due_ns >= c.sent_ns for c in copies)
    if table.get("keep_order") and not table.get("playout_s"):
        order = [c.sequence for c in delivered if c.fate != DUPLICATED]
        assert order == sorted(order)


def draws(a_link, count=60):
    """What the originals met, message by message."""
    return [a_link.send(k * 10 * MS, k, b"\0" * 8)[0] for k in range(count)]


@given(any_settings, st.sampled_from(["loss", "delay", "duplicate", "corrupt", "reorder"]))
def test_adding_an_impairment_changes_no_other_draw(table, added):
    """Loss decides alike, and delay adds alike, whatever else is there."""
    extra = {
        "loss": {"probability": 0.3},
        "delay": {"distribution": "uniform", "low_s": 0.0, "high_s": 0.05},
        "duplicate": {"probability": 0.5},
        "corrupt": {"probability": 0.5},
        "reorder": {"probability": 0.5},
    }
    only = {key: table[key] for key in ("loss", "delay") if key in table and key != added}
    before, after = draws(made(only)), draws(made(only | {added: extra[added]}))
    for one, other in zip(before, after, strict=True):
        if added != "loss":
            assert one.lost == other.lost
        if added not in ("delay", "reorder"):
            assert one.due_ns == other.due_ns


def test_a_changed_impairment_leaves_the_others_where_they_are():
    delay, loss = UniformDelay(0, 10**9), GilbertElliott(0.1, 0.3)
    plain = [c.due_ns for c in draws(link(GilbertElliott(0.1, 0.3), UniformDelay(0, 10**9)), 40)]
    a_link = link(loss, delay)
    found = [a_link.send(k * 10 * MS, k, b"")[0].due_ns for k in range(20)]
    a_link.change([RandomLoss(1.0), delay])
    changed = [a_link.send(k * 10 * MS, k, b"")[0] for k in range(20, 40)]
    assert found + [c.due_ns for c in changed] == plain
    assert all(c.lost for c in changed)


@pytest.mark.parametrize(
    ("make", "payload"),
    [
        (lambda: RandomLoss(0.3, 0.8), b""),
        (lambda: GilbertElliott(0.1, 0.3), b""),
        (lambda: FourState(0.1, 0.3), b""),
        (lambda: EveryNthLoss(3), b""),
        (lambda: TraceLoss([True, False, False]), b""),
        (lambda: UniformDelay(0, 10**9, 0.9), b""),
        (lambda: RandomDelay(d.Exponential(0.01), 0.001, 0.9), b""),
        (lambda: TraceDelay([0, 30 * MS], [5, 7], 50 * MS), b""),
        (lambda: Rate(1000), b"abc"),
        (lambda: Reorder(1.0, 5), b""),
        (lambda: Slots(3 * MS, 30 * MS, 2), b""),
        (KeepOrder, b""),
        (lambda: Corrupt(0.5), b"abc"),
        (lambda: Playout(60 * MS), b""),
    ],
)
def test_a_replacement_goes_on_from_the_state_of_what_it_replaces(make, payload):
    """So a change or a ramp of one number ends no burst and empties no line."""

    def fates(impairments_at):
        jitter = Jitter()
        a_link = link(jitter, *impairments_at(0))
        found = []
        for k in range(60):
            if k:
                a_link.change([jitter, *impairments_at(k)])
            found += a_link.send(k * 10 * MS, k, payload)
        return found

    one = make()
    assert fates(lambda k: [make()]) == fates(lambda k: [one])


def test_a_replaced_queue_keeps_its_backlog():
    def admitted(limit_at):
        a_link, found = link(QueueEntry(limit_at(0))), []
        for k in range(20):
            limit = limit_at(k)
            a_link.change([QueueEntry(limit), ConstantDelay(35), QueueExit(limit)])
            found.append(a_link.send(10 * k, k, b"")[0].lost)
        return found

    one = QueueLimit(2)
    assert admitted(lambda k: QueueLimit(2)) == admitted(lambda k: one)
    assert any(admitted(lambda k: one))


@given(any_settings, st.lists(st.booleans(), max_size=40))
def test_another_kind_of_message_changes_no_draw(table, others):
    """Loss, duplicates, damage and delays of one kind, with and without others on the link."""
    shared = (
        "rate",
        "queue",
        "slots",
        "keep_order",
    )  # one line for all: room and time are not draws
    memoryless = {
        "loss": {"probability": 0.3},
        "delay": {"distribution": "uniform", "low_s": 0.0, "high_s": 0.1},
    }
    table = {key: value for key, value in table.items() if key not in shared} | memoryless
    table.pop("reorder", None)  # counts all messages

    def met(kinds):
        a_link, found = made(table), []
        for k, kind in enumerate(kinds):
            copies = a_link.send(k * 10 * MS, k, b"\0" * 8, kind=kind)
            if kind == "pose":
                found.append([(c.fate, c.payload, c.due_ns - c.sent_ns) for c in copies])
        return found

    mixed = [kind for other in others for kind in (["camera"] * other + ["pose"])]
    assert met(mixed) == met(["pose"] * len(others))


@pytest.mark.processes
def test_the_same_seed_gives_the_same_bytes_in_any_process():
    """PYTHONHASHSEED scrambles sets and dictionaries of strings; the links must not notice."""
    program = (
        "from formnet.netem import LinkSettings\n"
        "from formnet.netem.settings.presets import PRESETS\n"
        "for name in PRESETS:\n"
        "    a = LinkSettings(preset=name, duplicate={'probability': 0.1}, "
        "corrupt={'probability': 0.1}).link(seed=5, source='a', destination='b')\n"
        "    for k in range(300):\n"
        "        for c in a.send(k * 1_000_000, k, bytes(20)):\n"
        "            print(name, c)\n"
    )
    outputs = {
        subprocess.run(
            [sys.executable, "-c", program],
            check=True,
            capture_output=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    }
    assert len(outputs) == 1
    assert len(outputs.pop()) > 100_000


# --- bad arguments, and the documentation -----------------------------------------------


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: d.Normal(0.0, 1.0), "mean"),
        (lambda: d.Gamma(1.0, math.inf), "stddev"),
        (lambda: d.Empirical([0.1, math.nan]), "samples[1]"),
        (lambda: RandomDelay(d.Exponential(1.0), offset_s=-1.0), "offset_s"),
        (lambda: RandomDelay(d.Pareto(1.0, 1.5), correlation=0.5), "variance"),
        (lambda: UniformDelay(0, 1, correlation=1.0), "correlation"),
        (lambda: TraceDelay([1], [1], 5), "time 0"),
        (lambda: TraceDelay([0, 2], [1, 1], 2), "ascend"),
        (lambda: TraceDelay([0], [-1], 2), "-1"),
        (lambda: FourState(0.5, p31=0.7, p32=0.7), "p31 + p32"),
        (lambda: EveryNthLoss(0), "n must"),
        (lambda: TraceLoss([]), "losses"),
        (lambda: Rate(0), "bits_per_s"),
        (lambda: Rate(1, -1), "overhead_bytes"),
        (lambda: QueueLimit(-1), "messages"),
        (lambda: Slots(0, 5), "min_ns=0"),
        (lambda: Slots(1, 5, -1), "messages"),
        (lambda: Playout(-1), "playout_ns"),
        (lambda: Reorder(0.5, 0), "gap"),
        (lambda: Duplicate(2.0), "probability"),
    ],
)
def test_bad_arguments_are_refused_and_shown(make, words):
    with pytest.raises(ValueError, match=words.replace("[", r"\[").replace("+", r"\+")):
        make()


def test_the_examples_in_the_documentation_run(root, capsys):
    text = (root / "docs" / "netem.md").read_text(encoding="utf-8")
    virtual, timeline, wall = (part.split("```")[0] for part in text.split("```python\n")[1:])
    exec(virtual, {})
    printed = capsys.readouterr().out.splitlines()
    assert sum(line.endswith(" delivered") for line in printed) > 900
    assert any(line.endswith(LOST_BURST) for line in printed)
    exec(timeline, {})
    printed = capsys.readouterr().out.splitlines()
    assert printed == [f"{k} {LOST_CUT}" for k in range(390, 500)]
    exec(wall, {})
    assert capsys.readouterr().out.count("b'hello' for rover") >= 9
