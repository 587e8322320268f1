"""(c) The cost of a lockstep tick as the ring grows: no faster than linear in the robots.

The sizes take turns in every round. Linear growth means that a tick of n robots
costs at most n/5 ticks of five, that is, that a robot-tick gets no dearer.
"""

import statistics
from pathlib import Path

from benchmarks import formnet_run
from benchmarks.plan import Plan
from benchmarks.scenarios import ring
from benchmarks.table import Row, Target

SIZES = (5, 10, 20, 40)


def measure(plan: Plan, folder: Path) -> list[Row]:
    """All rounds.

    Raises:
        BenchmarkError: a run did not complete.
    """
    costs: dict[int, list[float]] = {robots: [] for robots in SIZES}
    for number in range(1, plan.scaling_rounds + 1):
        for robots in SIZES:
            plan.say(f"c: round {number} of {plan.scaling_rounds}, {robots} robots")
            scenario = ring(robots, plan.scaling_ticks)
            costs[robots].append(formnet_run.tick_ms(scenario, folder / f"c-{number}-{robots}"))
    return [row for robots in SIZES for row in _rows(robots, costs)]


def _rows(robots: int, costs: dict[int, list[float]]) -> list[Row]:
    first = SIZES[0]
    rows = [Row("c", f"formnet tick, ring of {robots}", costs[robots], "ms")]
    if robots != first:
        ratios = [a / b for a, b in zip(costs[robots], costs[first], strict=True)]
        share = statistics.median(ratios) * first / robots
        target = Target("<=", robots / first)
        what, note = f"tick of {robots} / tick of {first}", f"per robot-tick {share:.2f} ×"
        rows.append(Row("c", what, ratios, target=target, note=note))
    return rows
