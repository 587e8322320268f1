"""The wall clock: nothing early, nothing lost, in order, and errors come out."""

import threading

import pytest

from formnet.netem import ConstantDelay, Link, RandomLoss, UniformDelay
from formnet.netem.core.wallclock import ClockClosed, WallClock

MS = 1_000_000


def links(count, *make):
    return [Link([m() for m in make], seed=1, source=k, destination="all") for k in range(count)]


def test_nothing_is_early_or_lost_and_each_link_keeps_its_due_order():
    arrived = []
    many = links(5, lambda: RandomLoss(0.2), lambda: UniformDelay(0, 30 * MS))
    copies = []
    with WallClock(lambda link, copy: arrived.append((clock.now_ns(), link, copy))) as clock:
        for k in range(400):
            copies += clock.send(many[k % 5], k // 5, b"x")
    assert sorted(id(copy) for _, _, copy in arrived) == sorted(id(c) for c in copies if not c.lost)
    assert any(copy.lost for copy in copies)
    # Its time begins with it, not with the machine's: slots and traces count from there.
    assert all(0 <= copy.sent_ns < 60 * 10**9 for copy in copies)
    assert all(at >= copy.due_ns for at, _, copy in arrived)
    for link in many:
        due = [copy.due_ns for _, there, copy in arrived if there is link]
        assert due == sorted(due)


def test_an_earlier_message_overtakes_one_that_is_waited_for():
    (slow,), (fast,) = links(1, lambda: ConstantDelay(300 * MS)), links(1)
    order, done = [], threading.Event()

    def deliver(link, copy):
        order.append(copy.payload)
        if len(order) == 2:
            done.set()

    with WallClock(deliver) as clock:
        clock.send(slow, 0, b"slow")
        clock.send(fast, 0, b"fast")
        assert done.wait(10)
    assert order == [b"fast", b"slow"]


def test_closing_at_once_drops_what_is_in_flight():
    (link,) = links(1, lambda: ConstantDelay(3600 * 10**9))
    clock = WallClock(lambda *_: pytest.fail("delivered"))
    clock.send(link, 0, b"x")
    clock.close(drain=False)
    with pytest.raises(ClockClosed):
        clock.send(link, 1, b"x")


def test_what_a_cut_has_lost_is_not_waited_for():
    lost, kept = links(2, lambda: ConstantDelay(3600 * 10**9))[0], links(1)[0]
    arrived = []
    clock = WallClock(lambda _, copy: arrived.append(copy.payload))
    clock.send(lost, 0, b"lost")
    with clock.lock:
        lost.cut(clock.now_ns(), lose_in_flight=True)
    clock.send(kept, 0, b"kept")
    closing = threading.Thread(target=clock.close, daemon=True)
    closing.start()
    closing.join(10)
    assert not closing.is_alive()
    assert arrived == [b"kept"]


def test_messages_due_in_the_far_future_break_nothing():
    (far,), (near,) = links(1, lambda: ConstantDelay(10**30)), links(1)
    arrived = threading.Event()
    clock = WallClock(lambda *_: arrived.set())
    clock.send(far, 0, b"")
    clock.send(near, 0, b"")
    assert arrived.wait(10)
    clock.close(drain=False)


def test_an_error_of_the_receiver_comes_out():
    (link,) = links(1)

    def deliver(link, copy):
        raise KeyError("mine")

    clock = WallClock(deliver)
    clock.send(link, 0, b"x")
    with pytest.raises(KeyError, match="mine"):
        clock.close()
