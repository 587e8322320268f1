"""(b) How much faster than real time a whole run goes in one process, on one thread.

:func:`lab.launch.inline.run` of Section 5 with delays, records dropped; building the
world and the robots is included, reading the scenario is not.
"""

import time

from benchmarks.plan import Plan
from benchmarks.scenarios import section5
from benchmarks.table import BenchmarkError, Row, Target
from formnet.formation.briefing.resolving import resolve
from formnet.formation.records.stream import Record
from formnet.formation.scenario.model import Scenario
from formnet.lab.launch.inline import Inline

REAL_TIME = Target(">=", 10.0)


def measure(plan: Plan) -> list[Row]:
    """All rounds.

    Raises:
        BenchmarkError: a run did not complete.
    """
    scenario = section5(plan.inline_ticks)
    speeds = []
    for number in range(1, plan.rounds + 1):
        plan.say(f"b: round {number} of {plan.rounds}")
        speeds.append(scenario.clock.control_period_s * 1e3 / tick_ms(scenario))
    note = f"{scenario.duration_s:g} s simulated a round"
    return [Row("b", "inline speed / real time, n = 5", speeds, target=REAL_TIME, note=note)]


def tick_ms(scenario: Scenario) -> float:
    """Run ``scenario`` once in this process; wall-clock milliseconds per tick.

    Raises:
        BenchmarkError: the run did not complete.
    """
    started_s = time.perf_counter()
    outcome = Inline().run(resolve(scenario), _drop)
    if outcome.kind != "completed":
        raise BenchmarkError(f"the inline run ended as {outcome.kind}: {outcome.reason}")
    return (time.perf_counter() - started_s) / (scenario.ticks + 1) * 1e3


def _drop(_record: Record) -> None:
    pass
