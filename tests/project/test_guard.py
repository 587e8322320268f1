"""What is started without its marker fails the test that starts it, with a sentence."""

import multiprocessing
import os
import subprocess
import sys
import threading
from contextlib import suppress

import pytest
import zenoh
from guard import marker_of


@pytest.fixture
def refused(request):
    """Call what is refused; gives the sentence, and lets this test pass all the same."""
    guard = request.config.pluginmanager.get_plugin("guard")

    def call(start):
        with pytest.raises(pytest.fail.Exception) as raised:
            start()
        assert str(raised.value) == guard.refused
        guard.refused = None
        return str(raised.value)

    return call


@pytest.mark.parametrize(
    "start",
    [
        lambda: subprocess.run([sys.executable, "-c", ""]),
        lambda: os.system("true"),
        lambda: os.posix_spawn(sys.executable, [sys.executable, "-c", ""], {}),
        lambda: multiprocessing.get_context("spawn").Process(target=int).start(),
        lambda: zenoh.open(zenoh.Config()),
    ],
)
def test_a_start_without_its_marker_is_refused(refused, start):
    assert refused(start).endswith("is started: mark this test with @pytest.mark.processes")


def test_a_refusal_that_the_code_under_test_catches_fails_the_test(request):
    guard = request.config.pluginmanager.get_plugin("guard")

    def swallowed():
        with suppress(BaseException):
            subprocess.run([sys.executable, "-c", ""])

    thread = threading.Thread(target=swallowed)
    thread.start()
    thread.join()
    after = guard.pytest_runtest_call()
    next(after)
    with pytest.raises(
        pytest.fail.Exception, match=r"mark this test with @pytest\.mark\.processes"
    ):
        after.send(None)
    guard.refused = None


@pytest.fixture
def ended_by_a_program():
    yield
    assert subprocess.run([sys.executable, "-c", ""]).returncode == 0


def test_a_fixture_may_start_what_ends_it(ended_by_a_program):
    """The fixture of a module is ended with its last test, whatever that one is marked with."""


@pytest.mark.processes
def test_what_a_test_says_it_starts_it_may_start():
    assert subprocess.run([sys.executable, "-c", ""]).returncode == 0


@pytest.mark.parametrize(
    ("command", "marker"),
    [
        (["/usr/sbin/ip", "netns", "add", "a"], "namespaces"),
        (["python", "tests/helpers/sshd.py"], "namespaces"),
        (["node", b"cli.js", "run-driver"], "browser"),
        (["python", "-m", "formnet"], "processes"),
        ("ls", "processes"),
    ],
)
def test_a_command_has_one_marker(command, marker):
    assert marker_of(command) == marker
