"""What a test starts, it says by a marker: processes and Zenoh sessions, browsers, namespaces.

A test that starts something without the marker fails with a sentence that names it, even where
the code under test catches what the start raised. ``make quick`` leaves tests with these
markers out, so a forgotten one would make it slow, and a test of it fragile.
"""

import functools
import multiprocessing.process
import os
import sys
from collections.abc import Callable, Generator
from typing import Any

import pytest
import zenoh

STARTS = {"subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn", "os.exec", "os.system"}
"""Audit events of a process that starts another one, or becomes it."""
ALLOWED = (["uname", "-p"],)
"""What Python's own :mod:`platform` asks once, for a verdict."""
PROGRAMS = {"ip": "namespaces", "sshd.py": "namespaces", "run-driver": "browser"}
"""Words of commands that need a marker of their own (Playwright's driver starts the browser)."""


def marker_of(command: object) -> str:
    """Which marker a test needs to start ``command``, a line or a list of words."""
    words = [command] if isinstance(command, str | bytes | os.PathLike) else command
    names = {os.path.basename(os.fsdecode(word)) for word in words}  # type: ignore[attr-defined]
    return next((PROGRAMS[name] for name in sorted(names & PROGRAMS.keys())), "processes")


class Guard:
    """A pytest plugin; one for each test process."""

    def __init__(self) -> None:
        self.test: pytest.Item | None = None
        self.refused: str | None = None

    def check(self, marker: str, what: str) -> None:
        """Raise pytest's Failed if the test that runs now has not got ``marker``."""
        if self.test is None or self.test.get_closest_marker(marker) is not None:
            return
        self.refused = f"{what} is started: mark this test with @pytest.mark.{marker}"
        pytest.fail(self.refused, pytrace=False)

    def audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        """An audit hook, which sees every process that is started but multiprocessing's."""
        if event in STARTS and self.test is not None:
            command = arguments[1] if event == "subprocess.Popen" else event
            if command not in ALLOWED:
                self.check(marker_of(command), f"{command!r}")

    def before(self, start: Callable[..., Any], what: str) -> Callable[..., Any]:
        """``start``, allowed to tests with the marker ``processes`` alone."""

        @functools.wraps(start)
        def checked(*arguments: Any, **options: Any) -> Any:
            self.check("processes", what)
            return start(*arguments, **options)

        return checked

    def install(self) -> None:
        """Watch from now on. It cannot be undone: an audit hook stays."""
        sys.addaudithook(self.audit)
        process = multiprocessing.process.BaseProcess
        process.start = self.before(process.start, "a process")  # type: ignore[method-assign]
        zenoh.open = self.before(zenoh.open, "a Zenoh session")

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, Any, Any]:
        """Remember whose turn it is: its fixtures' starts are its own."""
        self.test, self.refused = item, None
        try:
            return (yield)
        finally:
            self.test = None

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_teardown(self) -> Generator[None, Any, Any]:
        """Let fixtures end what they began: the last test of a module ends that of all others."""
        test, self.test = self.test, None
        try:
            return (yield)
        finally:
            self.test = test

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self) -> Generator[None, Any, Any]:
        """Fail a test that has caught the refusal, or met it in a thread."""
        result = yield
        if self.refused is not None:
            pytest.fail(self.refused, pytrace=False)
        return result
