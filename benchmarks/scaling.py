"""(c) The cost of a lockstep tick as the ring grows: no faster than linear in the robots.

The sizes take turns in every round, each for about as long. Linear growth is an
exponent of one in the power law that fits the four sizes best. Measured beside it:
the bare exchange (messages and processes alone), the inline run (formnet's own work), and
processes that only wake and touch memory (the machine, see :mod:`benchmarks.machine`).
"""

import statistics
from collections.abc import Sequence
from math import log
from pathlib import Path

from benchmarks import bare, formnet_run, inline_speed, machine
from benchmarks.plan import Plan
from benchmarks.scenarios import ring
from benchmarks.table import Row, Target

SIZES = (5, 10, 20, 40)


def measure(plan: Plan, folder: Path) -> list[Row]:
    """All rounds.

    Raises:
        BenchmarkError: a run did not complete.
    """
    machines = {f"pipes, {kb} KB touched:": kb for kb in machine.TOUCHED_KB}
    kinds = ("formnet", "bare", "inline", *machines)
    costs: dict[tuple[str, int], list[float]] = {(k, n): [] for k in kinds for n in SIZES}
    for number in range(1, plan.scaling_rounds + 1):
        for robots in SIZES:
            plan.say(f"c: round {number} of {plan.scaling_rounds}, {robots} robots")
            ticks = plan.scaling_ticks(robots)
            scenario, here = ring(robots, ticks), folder / f"c-{number}-{robots}"
            costs["formnet", robots].append(formnet_run.tick_ms(scenario, here))
            costs["bare", robots].append(bare.tick_ms(robots, ticks, here / "bare"))
            costs["inline", robots].append(inline_speed.tick_ms(scenario))
            for kind, touched_kb in machines.items():
                costs[kind, robots].append(machine.tick_ms(robots, ticks, touched_kb))
    return [row for kind in kinds for row in _rows(kind, costs)]


def _rows(kind: str, costs: dict[tuple[str, int], list[float]]) -> list[Row]:
    rows = [Row("c", f"{kind} tick, ring of {n}", costs[kind, n], "ms") for n in SIZES]
    rounds = zip(*(costs[kind, n] for n in SIZES), strict=True)
    exponents = [_exponent(ticks_ms) for ticks_ms in rounds]
    target = Target("<=", 1.0) if kind in ("formnet", "inline") else None
    note = "p of a tick ~ robots^p, fitted"
    return [*rows, Row("c", f"{kind} growth exponent", exponents, "", target, note)]


def _exponent(ticks_ms: Sequence[float]) -> float:
    """The slope of log cost over log robots, by least squares."""
    fit = statistics.linear_regression([log(n) for n in SIZES], [log(ms) for ms in ticks_ms])
    return fit.slope
