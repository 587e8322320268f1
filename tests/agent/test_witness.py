"""Messages whose fate a killed robot has taken with it, in real time."""

from hypothesis import given
from hypothesis import strategies as st

from formnet.formation.records.rows import LinkRow
from formnet.netem.core.transit import LOST_DOWN
from formnet.plant.witness import Witness


def row(sequence, *, source=1, destination=2, fate="delivered"):
    return LinkRow(10 * sequence, 10 * sequence + 1, source, destination, sequence, fate)


def watching():
    witness = Witness()
    witness.watch(2, [1, 3])
    return witness


def test_what_was_not_told_is_lost_with_the_receiver_once():
    witness = watching()
    for sequence in range(4):
        witness.sent(1, sequence, 10 * sequence)
        witness.sent(3, sequence, 10 * sequence)
        witness.sent(4, sequence, 10 * sequence)  # no neighbour of anybody who is watched
    witness.told([row(0), row(1, fate="lost: random"), row(0, source=3), row(2, source=4)])
    assert witness.lost_with(2) == [
        LinkRow(20, None, 1, 2, 2, LOST_DOWN),
        LinkRow(30, None, 1, 2, 3, LOST_DOWN),
        *(LinkRow(10 * k, None, 3, 2, k, LOST_DOWN) for k in (1, 2, 3)),
    ]
    assert witness.lost_with(2) == []
    assert witness.lost_with(1) == []


@given(st.data(), st.integers(0, 20))
def test_in_whatever_order_it_is_seen_and_told(data, count):
    """The robot may tell of a message before the plant has seen it, and tell of its copies."""
    told = data.draw(st.lists(st.integers(0, count), max_size=30))
    steps = [("sent", k) for k in range(count)]
    for sequence in told:
        steps.insert(data.draw(st.integers(0, len(steps))), ("told", sequence))
    witness = watching()
    for what, sequence in steps:
        if what == "sent":
            witness.sent(1, sequence, 10 * sequence)
        else:
            witness.told([row(sequence)])
    assert {lost.sequence for lost in witness.lost_with(2)} == set(range(count)) - set(told)
