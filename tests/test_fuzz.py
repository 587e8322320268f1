"""Broken messages at every decoder, with a new seed every time: see :mod:`fuzzing`."""

import secrets

from fuzzing import fuzz


def test_no_broken_message_escapes_a_decoder():
    seed = secrets.randbits(32)
    print(f"seed {seed}: python tests/fuzzing.py --messages 5000 --seed {seed}")
    found = fuzz(5000, seed)
    assert found.raised == []
    assert set(found.tried.values()) == {5000}
    refusing = ("lockstep", "broadcast", "envelope")
    assert all(100 < found.accepted[name] < 4900 for name in refusing)
