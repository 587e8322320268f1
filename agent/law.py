"""The interface of control laws, and how a law is found by name.

A law is a class (or any callable) that takes a :class:`Situation` and returns
an object with one method, ``command``. To add one, register it in a package's
entry points and name it in a scenario::

    [project.entry-points."formnet.laws"]
    my_law = "my_package:MyLaw"

    [law]
    kind = "my_law"
    parameters = { gain = 2.0 }

The built-in law is registered in the same way.
"""

import importlib
import traceback
from collections.abc import Callable
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import NamedTuple, Protocol

from formnet.formation.briefing.plan import Plan
from formnet.formation.briefing.situation import Situation
from formnet.formation.wire.state import Stamped, State
from formnet.netem.files.problems import nearest

_CALLERS = {
    *(Path(__file__).resolve().parents[1] / name for name in ("agent", "lab")),
    Path(importlib.__file__).parent,
}
"""Where laws are called from."""

GROUP = "formnet.laws"


class Command(NamedTuple):
    """What a robot does until its next control tick.

    At the dynamic level: torques (N m) of the right and the left wheel. At the
    kinematic level: forward speed (m/s) and turn rate (rad/s).
    """

    first: float
    second: float


class Law(Protocol):
    """A control law: a function of time, own state and what was heard."""

    def command(self, now_ns: int, own: State, heard: tuple[Stamped, ...]) -> Command:
        """The command to hold from ``now_ns`` until the next control tick.

        ``own`` is this robot's state at ``now_ns``. ``heard`` holds, for each
        neighbour heard so far and in ascending order of ids, the newest
        broadcast that its link has delivered, with the time stamp of its
        sender; a neighbour not heard yet is missing.

        Must be a pure function of its three arguments (memoising is fine): no
        clock, no randomness, no input or output. It is called once per control
        period. A result that is not finite ends the run as diverged; an
        exception ends it as failed, and the robot and the error are named.
        """
        ...


class LawFailed(RuntimeError):
    """The law of ``robot`` raised, or returned no pair of numbers; the text says what."""

    def __init__(self, robot: int, error: str) -> None:
        super().__init__(error)
        self.robot = robot


RAISED = (Exception, SystemExit, KeyboardInterrupt)
"""What a law may raise. Ctrl-C is none of its business: where laws run, it raises none of these."""


def failure(robot: int, error: BaseException, law: object = None) -> LawFailed:
    """``error``, which came of a law, with the law's own line, or where ``law`` is defined."""
    return LawFailed(robot, f"{in_words(error)}{place(error) or _begins(law)}")


def in_words(error: BaseException) -> str:
    """What an exception is, and what it says."""
    kind, text = type(error).__name__, str(error)
    return f"{kind}: {text}" if text else kind


def place(error: BaseException) -> str:
    """Where ``error`` left what somebody else has written, to follow other words."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if Path(frame.filename).is_absolute()  # those of compiled modules are relative
        and _CALLERS.isdisjoint(Path(frame.filename).resolve().parents)  # formnet/ has links
    ]
    own = [frame for frame in frames if frame.filename == frames[0].filename]
    return f" ({Path(own[-1].filename).name}:{own[-1].lineno})" if own else ""


def _begins(law: object) -> str:
    """Where ``command`` of ``law`` begins, as :func:`place` does; empty if it is compiled."""
    code = getattr(getattr(law, "command", None), "__code__", None)
    return f" ({Path(code.co_filename).name}:{code.co_firstlineno})" if code else ""


LawFactory = Callable[[Situation], Law]


class UnknownLaw(LookupError):
    """No law of that name is installed, or it cannot be imported."""


@cache
def installed() -> dict[str, EntryPoint]:
    """Every law that can be named in ``law.kind``, by name, ascending."""
    return {entry.name: entry for entry in sorted(entry_points(group=GROUP))}


def foreign(kind: str) -> bool:
    """Whether the law called ``kind`` is installed and not formnet's own."""
    entry = installed().get(kind)
    return entry is not None and not entry.module.startswith(f"{__package__}.")


def load(kind: str) -> LawFactory:
    """The law called ``kind``.

    Raises:
        UnknownLaw: there is none, or importing it failed.
    """
    entries = installed()
    if ":" in kind:
        raise UnknownLaw(f"law {kind!r} is code in a file, which was not given to this process")
    if kind not in entries:
        hint = nearest(kind, entries)
        raise UnknownLaw(f"no law {kind!r} is installed (installed: {', '.join(entries)}){hint}")
    try:
        factory: LawFactory = entries[kind].load()
    except RAISED as error:
        raise UnknownLaw(
            f"law {kind!r} ({entries[kind].value}) cannot be imported: "
            f"{in_words(error)}{place(error)}"
        ) from error
    return factory


def make(situation: Situation) -> Law:
    """The law that ``situation`` names, ready to run. Raises UnknownLaw."""
    return load(situation.settings.kind)(situation)


def accepts(plan: Plan, factory: LawFactory = make) -> str | None:
    """Why the law of a run cannot be had, or None. Builds the law of every robot."""
    kind = plan.law.kind
    for robot in plan.ids:
        try:
            factory(plan.situation(robot))
        except UnknownLaw as error:
            return str(error)
        except ValueError as error:
            return f"law {kind!r} refuses robot {robot}: {error}{place(error)}"
        except RAISED as error:
            return f"law {kind!r} fails for robot {robot}: {failure(robot, error)}"
    return None
