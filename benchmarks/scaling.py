"""(c) The cost of a lockstep tick as the ring grows: no faster than linear in the robots.

The sizes take turns in every round. Linear growth means that a tick of n robots
costs at most n/5 ticks of five, that is, that a robot-tick gets no dearer. The bare
exchange is measured beside it: its growth is the machine's and Zenoh's own.
"""

import statistics
from pathlib import Path

from benchmarks import bare, formnet_run
from benchmarks.plan import Plan
from benchmarks.scenarios import ring
from benchmarks.table import Row, Target

SIZES = (5, 10, 20, 40)


def measure(plan: Plan, folder: Path) -> list[Row]:
    """All rounds.

    Raises:
        BenchmarkError: a run did not complete.
    """
    kinds = ("formnet", "bare")
    costs: dict[tuple[str, int], list[float]] = {(k, n): [] for k in kinds for n in SIZES}
    for number in range(1, plan.scaling_rounds + 1):
        for robots in SIZES:
            plan.say(f"c: round {number} of {plan.scaling_rounds}, {robots} robots")
            scenario, here = ring(robots, plan.scaling_ticks), folder / f"c-{number}-{robots}"
            costs["formnet", robots].append(formnet_run.tick_ms(scenario, here))
            costs["bare", robots].append(bare.tick_ms(robots, plan.scaling_ticks, here / "bare"))
    return [row for kind in kinds for robots in SIZES for row in _rows(kind, robots, costs)]


def _rows(kind: str, robots: int, costs: dict[tuple[str, int], list[float]]) -> list[Row]:
    first = SIZES[0]
    rows = [Row("c", f"{kind} tick, ring of {robots}", costs[kind, robots], "ms")]
    if robots != first:
        pairs = zip(costs[kind, robots], costs[kind, first], strict=True)
        ratios = [a / b for a, b in pairs]
        share = statistics.median(ratios) * first / robots
        target = Target("<=", robots / first) if kind == "formnet" else None
        what, note = f"{kind}, {robots} / {first}", f"per robot-tick {share:.2f} ×"
        rows.append(Row("c", what, ratios, target=target, note=note))
    return rows
