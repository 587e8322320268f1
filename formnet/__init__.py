"""Formation control over imperfect networks: run it, break it, get a verdict.

What this module names is the public API; nothing else is. It is imported when it is first used,
so ``import formnet`` costs nothing, and works with the base install of a robot. Running, opening
and checking need the install with ``[lab]``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from formnet.agent.law import Command as Command
    from formnet.agent.law import Law as Law
    from formnet.formation.briefing.resolving import resolve as resolve
    from formnet.formation.briefing.situation import BodyEstimate as BodyEstimate
    from formnet.formation.briefing.situation import Situation as Situation
    from formnet.formation.scenario.loading import ScenarioError as ScenarioError
    from formnet.formation.scenario.loading import load as load
    from formnet.formation.wire.state import Stamped as Stamped
    from formnet.formation.wire.state import State as State
    from formnet.lab.api import Check as Check
    from formnet.lab.api import Run as Run
    from formnet.lab.api import check as check
    from formnet.lab.api import open as open
    from formnet.lab.api import run as run
    from formnet.lab.verdict.files import Unreadable as Unreadable

_PLACES = {
    "run": ("lab.api", "run"),
    "open": ("lab.api", "open"),
    "check": ("lab.api", "check"),
    "Run": ("lab.api", "Run"),
    "Check": ("lab.api", "Check"),
    "Unreadable": ("lab.verdict.files", "Unreadable"),
    "load": ("formation.scenario.loading", "load"),
    "resolve": ("formation.briefing.resolving", "resolve"),
    "ScenarioError": ("formation.scenario.loading", "ScenarioError"),
    "Law": ("agent.law", "Law"),
    "Command": ("agent.law", "Command"),
    "Situation": ("formation.briefing.situation", "Situation"),
    "BodyEstimate": ("formation.briefing.situation", "BodyEstimate"),
    "State": ("formation.wire.state", "State"),
    "Stamped": ("formation.wire.state", "Stamped"),
}
"""Where each public name is."""

__all__ = [  # noqa: PLE0604, RUF022 (names that are imported when they are used)
    "BodyEstimate",
    "Check",
    "Command",
    "Law",
    "Run",
    "ScenarioError",
    "Situation",
    "Stamped",
    "State",
    "Unreadable",
    "check",
    "load",
    "open",
    "resolve",
    "run",
]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'formnet' has no attribute {name!r}")
    module, attribute = _PLACES[name]
    try:
        return getattr(import_module(f"formnet.{module}"), attribute)
    except ModuleNotFoundError as error:
        from formnet.lab.runs.build import remedy

        needed = remedy(error)
        if needed is None:
            raise
        raise ModuleNotFoundError(f"formnet.{name}: {needed}", name=error.name) from error


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
