"""The engine with one process for each robot and one for the plant, over Zenoh."""

import secrets
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from formnet.agent.law_file import LawFile
from formnet.formation.briefing.plan import Plan
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.rows import Samples
from formnet.formation.records.stream import Record, Sink
from formnet.lab.launch.engine import EngineName, never
from formnet.lab.launch.launch import HERE, Begun, Launch, Place
from formnet.netem.settings.timeline import NEVER


class Distributed:
    """An :class:`~formnet.lab.launch.engine.Engine`.

    Processes log into ``logs`` (None: nowhere); ``place`` says where they are, and ``begun`` is
    told where they meet before the robots are started. ``law`` is the file whose law the robots'
    processes execute instead of the one that the plan names.
    """

    name: EngineName = "distributed"

    def __init__(
        self,
        logs: Path | None = None,
        place: Place = HERE,
        begun: Begun = lambda *_: None,
        law: LawFile | None = None,
    ) -> None:
        self._logs = logs
        self._place = place
        self._begun = begun
        self._law = law

    def run(
        self,
        plan: Plan,
        sink: Sink,
        stopped: Callable[[], bool] = never,
        until_ns: int = NEVER,
    ) -> Outcome:
        """See :class:`~formnet.lab.launch.engine.Engine`.

        Raises:
            HostUnreachable: a robot's host cannot be reached.
            OSError: processes cannot be started, or not log.
        """
        reached_ns = 0

        def take(record: Record) -> None:
            nonlocal reached_ns
            if isinstance(record, Samples) and record.rows:
                reached_ns = record.rows[-1].t_ns
            sink(record)

        name = f"{plan.name}-{secrets.token_hex(6)}"  # unique on the bus
        with TemporaryDirectory(prefix="formnet-logs-") as scratch:
            logs = self._logs or Path(scratch)
            launch = Launch(plan, name, take, logs, self._place, self._begun, self._law)
            return launch.wait(lambda: stopped() or reached_ns >= until_ns)
