"""What a tick of a real distributed run costs.

The plant and the robots run as :mod:`lab.launch.launch` starts them. The clock of the
launching process runs from the arrival of the ``started`` event to that of
``ended``, so start-up and farewell are excluded and the record stream is
included, to formnet's disadvantage. Records are dropped as they come.
"""

import secrets
import time
from pathlib import Path

from benchmarks.table import BenchmarkError
from formnet.formation.briefing.resolving import resolve
from formnet.formation.records.events import LastTick, Started
from formnet.formation.records.stream import Record, Sink
from formnet.formation.scenario.model import Scenario
from formnet.lab.launch.launch import Begun, Launch

START_S, TICK_S = 60.0, 0.05
"""A run may take this long to start, and this long per tick, before it is given up."""


class _Clock:
    """A sink that only looks at the clock, and passes on."""

    def __init__(self, also: Sink) -> None:
        self._also = also
        self.started_s: float | None = None
        self.ended_s: float | None = None

    def __call__(self, record: Record) -> None:
        if isinstance(record, Started):
            self.started_s = time.perf_counter()
        elif isinstance(record, LastTick):
            self.ended_s = time.perf_counter()
        self._also(record)


def tick_ms(
    scenario: Scenario,
    folder: Path,
    *,
    also: Sink = lambda _: None,
    begun: Begun = lambda *_: None,
) -> float:
    """Run ``scenario`` once; wall-clock milliseconds per tick. Files go to ``folder``.

    ``also`` gets the records, ``begun`` is called as by ``lab.launch.launch``.

    Raises:
        BenchmarkError: the run did not complete.
    """
    folder.mkdir(parents=True, exist_ok=True)
    clock = _Clock(also)
    deadline = time.monotonic() + START_S + TICK_S * scenario.ticks
    name = f"{scenario.name}-{secrets.token_hex(3)}"

    def over() -> bool:
        return time.monotonic() > deadline

    launch = Launch(resolve(scenario), name, clock, folder / "logs", begun=begun)
    outcome = launch.wait(over)
    if outcome.kind != "completed" or clock.started_s is None or clock.ended_s is None:
        raise BenchmarkError(
            f"formnet's run of {scenario.name} ended as {outcome.kind} at "
            f"t = {outcome.t_ns / 1e9:.3f} s: {outcome.reason}"
        )
    exchanges = scenario.ticks + 1  # both the first and the last tick are sensed and answered
    return (clock.ended_s - clock.started_s) / exchanges * 1e3
