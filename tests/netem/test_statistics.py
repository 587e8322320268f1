"""Statistics of links: by hand, and against a second way to count."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from formnet.netem.core.statistics import Fate, Tally, next_jitter, summarise
from formnet.netem.core.transit import (
    CORRUPTED,
    DELIVERED,
    DUPLICATED,
    IN_FLIGHT,
    LOST_BURST,
    LOST_LATE,
)

MS = 1_000_000


def test_a_link_by_hand():
    found = summarise(
        [
            Fate(0, 0, 20 * MS, DELIVERED),
            Fate(1, 10 * MS, None, LOST_BURST),
            Fate(2, 20 * MS, 50 * MS, CORRUPTED),
            Fate(2, 20 * MS, 60 * MS, DUPLICATED),
            Fate(3, 30 * MS, None, LOST_LATE),
            Fate(3, 30 * MS, None, LOST_BURST),  # a second copy, lost as well
            Fate(4, 40 * MS, 200 * MS, DELIVERED),
            Fate(5, 50 * MS, None, IN_FLIGHT),
        ],
        end_ns=100 * MS,
    )
    assert (found.sent, found.delivered, found.duplicated, found.corrupted) == (6, 3, 1, 1)
    assert (found.in_flight, found.lost) == (2, {"burst": 2, "late": 1})
    assert found.delay_s["min"] == 0.02
    assert found.delay_s["mean"] == pytest.approx(0.03)
    assert (found.delay_s["p50"], found.delay_s["max"]) == (0.03, 0.04)
    # |D| is 10 ms twice: J = 10/16, then 10/16 + (10 - 10/16)/16 ms.
    assert found.jitter_s == pytest.approx((10 / 16 + (10 - 10 / 16) / 16) / 1e3)
    assert found.longest_silence_s == 0.04  # from the last arrival to the end


def test_a_link_that_carries_nothing():
    silent = summarise([], 5 * MS)
    assert (silent.sent, silent.delivered, silent.delay_s, silent.jitter_s) == (0, 0, None, 0.0)
    dead = summarise([Fate(0, MS, None, LOST_BURST)], 5 * MS)
    assert dead.longest_silence_s == 0.004
    assert dead.delay_s is None


@given(st.floats(0, 1e9), st.integers(1, 200))
def test_jitter_of_an_alternating_delay_has_a_closed_form(swing, count):
    """With |D| constant, J = |D| (1 - (15/16)^n) after n differences."""
    jitter = 0.0
    for k in range(count):
        jitter = next_jitter(jitter, swing * (-1) ** k)
    expected = swing * (1 - (15 / 16) ** count)
    assert math.isclose(jitter, expected, rel_tol=1e-9, abs_tol=1e-12)


@given(
    st.lists(
        st.tuples(st.integers(0, 100), st.one_of(st.none(), st.integers(0, 100))), max_size=40
    ),
    st.integers(0, 250),
)
def test_every_message_is_counted_once(script, end_ns):
    fates = [
        Fate(
            number,
            sent,
            None if delay is None else sent + delay,
            LOST_BURST if delay is None else DELIVERED,
        )
        for number, (sent, delay) in enumerate(script)
    ]
    found = summarise(fates, end_ns)
    assert found.sent == found.delivered + found.in_flight + sum(found.lost.values())
    assert found.longest_silence_s >= 0.0


def test_a_tally_that_forgets_still_counts_everything():
    """Only the quantiles go by a window; the delays here rise by 1 ms from 0."""
    tally = Tally(window=10)
    for k in range(1000):
        tally.sent(k * 10 * MS)
        tally.arrived(k * 10 * MS, k * 10 * MS + k * MS, DELIVERED)
    found = tally.at(11_000 * MS)
    assert (found.sent, found.delivered, found.in_flight) == (1000, 1000, 0)
    assert (found.delay_s["min"], found.delay_s["max"]) == (0.0, 0.999)
    assert found.delay_s["mean"] == pytest.approx(0.4995)
    assert found.delay_s["p50"] == pytest.approx(0.9945)
    assert found.longest_silence_s == pytest.approx(0.011)
