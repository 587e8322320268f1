"""What is known of a run before it begins: whether its law can be had, and what is to be feared.

To find out, the law is called. One that somebody else has written may do anything then, such as
never come back or end its process; so that is tried in a process of its own, for a limited time.
"""

import multiprocessing
import signal
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import NamedTuple

from agent.law import accepts, foreign
from formation.process import die_with_parent
from formation.scenario import Scenario
from formation.theory import assess
from lab import stiffness, stuck

GET_S = 60.0
"""How long a law may take to be imported and built, in wall time."""
FOLLOW_S = stiffness.MOST_S + 7.0
"""How long the way in is followed with it, at most."""

Say = Callable[[str], None]


class Foresight(NamedTuple):
    """``problem``: why the law cannot be had, or None; ``warnings``: what is to be feared."""

    problem: str | None
    warnings: list[str]


def foresee(scenario: Scenario, say: Say = lambda _: None) -> Foresight:
    """Try the law of a valid scenario; ``say`` takes where it is, if it takes long."""
    if foreign(scenario.law.kind):
        return _Trial(scenario, say).outcome()
    problem = accepts(scenario)
    return Foresight(problem, [] if problem else stiffness.warnings(scenario))


class _Trial:
    """One process that gets a law and then follows the way in with it."""

    def __init__(self, scenario: Scenario, say: Say) -> None:
        self._scenario, self._say = scenario, say
        self._where = ""

    def outcome(self) -> Foresight:
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe(duplex=False)
        child = context.Process(target=_try, args=(self._scenario, there))
        child.start()
        there.close()
        name = f"law {self._scenario.law.kind!r}"
        try:
            try:
                problem = self._next(here, GET_S)
            except TimeoutError:
                return Foresight(f"{name} was not there after {GET_S:g} s{self._where}", [])
            except EOFError:
                child.join()
                how = _ended(child.exitcode)
                return Foresight(f"{name} {how} when it was imported and built", [])
            if problem:
                return Foresight(problem[0], [])
            try:
                return Foresight(None, self._next(here, FOLLOW_S))
            except TimeoutError:
                fear = f"had not answered after {FOLLOW_S:g} s{self._where}"
            except EOFError:
                child.join()
                fear = _ended(child.exitcode)
            fears = [f"{name} {fear} when it was tried before the run"]
            return Foresight(None, [*assess(self._scenario).warnings, *fears])
        finally:
            child.kill()
            child.join()
            here.close()

    def _next(self, connection: Connection, limit_s: float) -> list[str]:
        """What the process has found out next. Raises TimeoutError, or EOFError if it is gone."""
        until_s = time.monotonic() + limit_s
        while connection.poll(max(0.0, until_s - time.monotonic())):
            found = connection.recv()
            if isinstance(found, list):
                return found
            self._where = f" (it is at {found})"
            self._say(f"the law takes its time; it is at {found}")
        raise TimeoutError


def _ended(code: int | None) -> str:
    if code is not None and code < 0:
        return f"brought its process down (signal {-code})"
    return f"ended its process (exit code {code})"


def _try(scenario: Scenario, found: Connection) -> None:
    """In the process: send the problem, if there is one, as a list; then the warnings."""
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    with stuck.told(found.send):
        problem = accepts(scenario)
        found.send([] if problem is None else [problem])
        if problem is None:
            found.send(stiffness.warnings(scenario))
