"""Zenoh's threads are chosen before it is loaded, unless the user has."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.processes

LOOK = "import os; import formnet.formation.wire.bus; print(os.environ['ZENOH_RUNTIME'])"
MANY = "from formnet.formation.wire import threads; threads.many(); " + LOOK
MINE = "(app: (worker_threads: 3))"


def chosen(program, **set_by_user):
    return subprocess.run(
        [sys.executable, "-c", program], env=set_by_user, text=True, capture_output=True, check=True
    ).stdout.strip()


@pytest.mark.parametrize("program", [LOOK, MANY])
def test_what_the_user_set_stays(program):
    assert chosen(program, ZENOH_RUNTIME=MINE) == MINE


def test_the_one_thread_that_a_launcher_hands_on_becomes_many():
    one = chosen(LOOK)
    assert "app: (worker_threads: 1)" in one
    assert "worker_threads: 64" in chosen(MANY)
    assert chosen(MANY, ZENOH_RUNTIME=one) == chosen(MANY)
    assert chosen(LOOK, ZENOH_RUNTIME=chosen(MANY)) == chosen(MANY)
