"""What is known of a run before it begins: whether its law can be had, and what is to be feared.

To find out, the law is called. One that somebody else has written may do anything then, such as
never come back or end its process; so that is tried in a process of its own, for a limited time.
"""

import multiprocessing
import os
import sys
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from formnet.agent.law import UnknownLaw, accepts, foreign, load, make
from formnet.agent.law_file import LawFile
from formnet.formation.briefing.resolving import resolve
from formnet.formation.paper.theory import assess
from formnet.formation.scenario.model import Scenario
from formnet.formation.wire.process import die_with_parent
from formnet.lab.forecast import stiffness
from formnet.lab.launch import stuck
from formnet.lab.launch.interpreter import safe_path
from formnet.lab.launch.signals import kept_from_children

GET_S = 60.0
"""How long a law may take to be imported and built, in wall time."""
IMPORT_S = 10.0
"""How long :func:`unusable` waits."""
FOLLOW_S = stiffness.MOST_S + 7.0
"""How long the way in is followed with it, at most."""

Say = Callable[[str], None]


class Foresight(NamedTuple):
    """``problem``: why the law cannot be had, or None; ``warnings``: what is to be feared."""

    problem: str | None
    warnings: list[str]


def foresee(scenario: Scenario, say: Say = lambda _: None, law: LawFile | None = None) -> Foresight:
    """Try the law of a valid scenario, or that of the file ``law``; ``say`` takes where it is, if
    it takes long."""
    kind = scenario.law.kind
    if _own(scenario, law):
        problem = accepts(resolve(scenario))
        return Foresight(problem, [] if problem else stiffness.warnings(scenario))
    with _Trial(_try, (scenario, law), say) as trial:
        problem = _first(trial, kind, GET_S)
        if problem is not None:
            return Foresight(problem, [])
        try:
            return Foresight(None, trial.next(FOLLOW_S))
        except TimeoutError:
            fear = f"did not return within {FOLLOW_S:g} s{trial.where}"
        except EOFError:
            fear = trial.ended()
    fears = [f"law {kind!r} {fear} in the trial before the run"]
    return Foresight(None, [*assess(scenario).warnings, *fears])


def taken_on_trust(
    scenario: Scenario, say: Say = lambda _: None, law: LawFile | None = None
) -> Foresight:
    """What :func:`foresee` finds without following the way in: the law is built, but not called."""
    problem = obstacle(scenario, say, law)
    return Foresight(problem, [] if problem else assess(scenario).warnings)


def obstacle(
    scenario: Scenario, say: Say = lambda _: None, law: LawFile | None = None
) -> str | None:
    """Why the law of a valid scenario cannot be had, or None; ``say``, ``law`` as for
    :func:`foresee`."""
    if _own(scenario, law):
        return accepts(resolve(scenario))
    with _Trial(_build, (scenario, law), say) as trial:
        return _first(trial, scenario.law.kind, GET_S)


def unusable(kind: str) -> str | None:
    """Why the law called ``kind``, which is installed, cannot be imported; None if it can."""
    if not foreign(kind):
        return None
    with _Trial(_import, kind) as trial:
        return _first(trial, kind, IMPORT_S)


def _own(scenario: Scenario, law: LawFile | None) -> bool:
    """Whether the law is formnet's own."""
    return law is None and not foreign(scenario.law.kind)


class _Trial:
    """A process in which ``work`` does something with ``subject`` and sends what it finds."""

    def __init__(
        self, work: Callable[[Any, Connection], Any], subject: object, say: Say = lambda _: None
    ) -> None:
        context = multiprocessing.get_context("spawn")
        self._here, there = context.Pipe(duplex=False)
        self._say = say
        self._child = context.Process(target=_alone, args=(work, subject, there))
        with kept_from_children(), safe_path():
            self._child.start()
        there.close()
        self.where = ""
        """Where the law is, in words that follow others, if that is known."""

    def __enter__(self) -> "_Trial":
        return self

    def __exit__(self, *_: object) -> None:
        self._child.kill()
        self._child.join()
        self._here.close()

    def next(self, limit_s: float) -> list[str]:
        """What it has found out next. Raises TimeoutError, or EOFError if it is gone."""
        until_s = time.monotonic() + limit_s
        while self._here.poll(max(0.0, until_s - time.monotonic())):
            found = self._here.recv()
            if isinstance(found, list):
                return found
            self.where = f" (it is at {found})"
            self._say(f"the law has not returned yet; it is at {found}")
        raise TimeoutError

    def ended(self) -> str:
        """How it has, in words about the law."""
        self._child.join()
        code = self._child.exitcode
        if code is not None and code < 0:
            return f"crashed its process (signal {-code})"
        return f"ended its process (exit code {code})"


def _first(trial: _Trial, kind: str, limit_s: float) -> str | None:
    """Why the law cannot be had, which is what a trial finds out first."""
    try:
        problem = trial.next(limit_s)
    except TimeoutError:
        return f"law {kind!r} was not ready within {limit_s:g} s{trial.where}"
    except EOFError:
        return f"law {kind!r} {trial.ended()} while it was imported and constructed"
    return problem[0] if problem else None


def _alone(work: Callable[[Any, Connection], Any], subject: object, found: Connection) -> None:
    """In the process: ``work``, and where it is stuck, if it is."""
    die_with_parent()
    sys.stdout = open(os.devnull, "w")  # noqa: SIM115 (laws may print; in the run, they are heard)
    with stuck.told(found.send):
        work(subject, found)


def _try(subject: tuple[Scenario, LawFile | None], found: Connection) -> None:
    """Send the problem, if there is one, as a list; then the warnings."""
    if _build(subject, found):
        scenario, law = subject
        found.send(stiffness.warnings(scenario, law or make))


def _build(subject: tuple[Scenario, LawFile | None], found: Connection) -> bool:
    scenario, law = subject
    problem = accepts(resolve(scenario), law or make)
    found.send([] if problem is None else [problem])
    return problem is None


def _import(kind: str, found: Connection) -> None:
    try:
        load(kind)
        found.send([])
    except UnknownLaw as error:
        found.send([str(error)])
