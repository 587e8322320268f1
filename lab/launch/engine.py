"""What runs a plan: in one process, or in one for each robot; later perhaps compiled.

An engine has a name, by which commands and verdicts call it, and gives the same bits as any other.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Literal, Protocol

from formnet.agent.law_file import LawFile
from formnet.formation.briefing.plan import Plan
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.stream import Sink
from formnet.netem.settings.timeline import NEVER

EngineName = Literal["inline", "distributed"]


def never() -> bool:
    """Nobody wants an end."""
    return False


class Engine(Protocol):
    """Runs plans."""

    @property
    def name(self) -> EngineName:
        """What it is called."""

    def run(
        self,
        plan: Plan,
        sink: Sink,
        stopped: Callable[[], bool] = never,
        until_ns: int = NEVER,
    ) -> Outcome:
        """Run ``plan`` from t = 0; all that happens goes to ``sink``, last the outcome.

        ``stopped`` is asked some ten times a second, and ends the run early; so does ``until_ns``,
        at which nothing is run any more.

        Raises:
            OSError: processes cannot be started, or not log.
        """


def engine(name: EngineName, logs: Path | None = None, law: LawFile | None = None) -> Engine:
    """The engine called ``name``, all processes on this machine, logging into ``logs``.

    ``law`` is a file whose law every robot has, instead of the one that the plan names.
    """
    if name == "inline":
        from formnet.agent.law import make
        from formnet.lab.launch.inline import Inline

        return Inline(logs, law or make)
    from formnet.lab.launch.distributed import Distributed

    return Distributed(logs, law=law)
