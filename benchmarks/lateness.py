"""(e) How late a message is on the wall clock, at 1,000 messages a second.

Beside netem's thread, in the same round, the two naive ways: a thread that
sleeps (time.sleep) until each message is due, and an asyncio timer for each.
"""

import asyncio
import time
from collections.abc import Callable

import numpy as np

from benchmarks.plan import Plan
from benchmarks.table import BenchmarkError, Row, Target
from formnet.netem import LinkSettings
from formnet.netem.core.wallclock import WallClock

now_ns = time.monotonic_ns
_SPACING_NS = 1_000_000
_DELAY_NS = 20_000_000
P50, P99 = Target("<=", 60.0), Target("<=", 300.0)


def measure(plan: Plan) -> list[Row]:
    """All rounds.

    Raises:
        BenchmarkError: a message came early, or not at all.
    """
    ways: dict[str, Callable[[int], list[int]]] = {
        "netem": _netem,
        "time.sleep": _sleep,
        "asyncio": _asyncio,
    }
    found: dict[tuple[str, int], list[float]] = {(way, q): [] for way in ways for q in (50, 99)}
    for number in range(1, plan.rounds + 1):
        plan.say(f"e: round {number} of {plan.rounds}")
        for way, run in ways.items():
            late_ns = run(plan.ticks)
            if len(late_ns) != plan.ticks or (way == "netem" and min(late_ns) < 0):
                earliest_ns = min(late_ns, default=0)
                raise BenchmarkError(f"{way}: {len(late_ns)} messages, earliest {earliest_ns} ns")
            for q in (50, 99):
                found[way, q].append(float(np.percentile(late_ns, q)) / 1e3)
    targets = {("netem", 50): P50, ("netem", 99): P99}
    return [
        Row("e", f"{way}, lateness p{q}", values, "µs", targets.get((way, q)))
        for (way, q), values in found.items()
    ]


def _netem(messages: int) -> list[int]:
    late_ns: list[int] = []
    settings = {"delay": {"distribution": "constant", "mean_s": _DELAY_NS / 1e9}}
    link = LinkSettings.model_validate(settings).link(seed=1, source=1, destination=2)
    with WallClock(lambda _, copy: late_ns.append(clock.now_ns() - copy.due_ns)) as clock:
        start_ns = now_ns()
        for number in range(messages):
            _sleep_until(start_ns + number * _SPACING_NS)
            clock.send(link, number, b"")
    return late_ns


def _sleep(messages: int) -> list[int]:
    start_ns, late_ns = now_ns() + _DELAY_NS, []
    for number in range(messages):
        due_ns = start_ns + number * _SPACING_NS
        _sleep_until(due_ns)
        late_ns.append(now_ns() - due_ns)
    return late_ns


def _asyncio(messages: int) -> list[int]:
    late_ns: list[int] = []

    async def run() -> None:
        loop = asyncio.get_running_loop()
        start_s, start_ns = loop.time(), now_ns()

        def arrive(due_ns: int) -> None:
            late_ns.append(now_ns() - due_ns)

        for number in range(messages):
            after_ns = _DELAY_NS + number * _SPACING_NS
            loop.call_at(start_s + after_ns / 1e9, arrive, start_ns + after_ns)
        await asyncio.sleep((_DELAY_NS + messages * _SPACING_NS) / 1e9 + 0.1)

    asyncio.run(run())
    return late_ns


def _sleep_until(due_ns: int) -> None:
    left_ns = due_ns - now_ns()
    if left_ns > 0:
        time.sleep(left_ns / 1e9)
