"""(h) Real time on this machine: rings of robots at 100 Hz, every link delayed by 50 ms.

A robot misses a period for which it woke too late, or whose answer came after its end. Sense to
drive is from the plant's measurement to the command that it led to, in the plant.
"""

import secrets
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.plan import Plan
from benchmarks.scenarios import ring_toml
from benchmarks.table import BenchmarkError, Row, Target
from formnet.formation.briefing.resolving import resolve
from formnet.formation.records.events import Timing
from formnet.formation.records.rows import LinkRows
from formnet.formation.records.stream import Record
from formnet.formation.scenario.loading import loads
from formnet.formation.wire import bus
from formnet.lab.launch.launch import Launch

SIZES = (5, 10, 20, 40)
DELAY_S = 0.05
JUNK_PER_S, VICTIM = 10_000, 3
_SETTINGS = (
    "clock.mode=realtime",
    "clock.control_period_s=0.01",
    "clock.broadcast_period_s=0.05",
    "law.beta=2.0",
    "law.feedback_gain=3.0",
    "law.boundary_layer=1e4",
    "law.length_scale_m=4.0",
    f"network.default.delay.mean_s={DELAY_S}",
)


def measure(plan: Plan, folder: Path) -> list[Row]:
    """One run per size and round, as many seconds long as ``ticks`` has hundreds.

    Raises:
        BenchmarkError: a run did not complete.
    """
    rows: list[Row] = []
    for robots in SIZES:
        found: list[_Timing] = []
        for number in range(1, plan.paced_rounds + 1):
            plan.say(f"h: {robots} robots, round {number} of {plan.paced_rounds}")
            timing = _Timing()
            _run(robots, plan.paced_s, timing, folder / f"h-{robots}-{number}")
            found.append(timing)
        few = robots == SIZES[0]
        rows += [
            Row(
                "h",
                f"{robots} robots at 100 Hz, missed periods",
                [t.missed for t in found],
                "%",
                Target("<=", 0.5) if few else None,
            ),
            Row(
                "h",
                "… sense to drive, p50",
                [t.robots("sense_to_drive_s", "p50") for t in found],
                "ms",
            ),
            Row("h", "… p99", [t.robots("sense_to_drive_s", "p99") for t in found], "ms"),
            Row(
                "h",
                "… a broadcast on the real network, p99",
                [t.robots("transit_s", "p99") for t in found],
                "ms",
            ),
            Row("h", "… the plant woke late, p99", [t.plant_ms for t in found], "ms"),
        ]
        if few:
            rows += [
                Row(
                    "h",
                    "… a delay of 50 ms on top of it: off by, p99",
                    [t.off_ms for t in found],
                    "ms",
                    Target("<=", 0.3),
                ),
                _flooded(plan, folder),
            ]
    return rows


def _flooded(plan: Plan, folder: Path) -> Row:
    """Junk on all keys of one robot; what it does to the others."""
    missed = []
    for number in range(1, plan.paced_rounds + 1):
        plan.say(f"h: a flood, round {number} of {plan.paced_rounds}")
        timing = _Timing()
        _run(SIZES[0], plan.paced_s, timing, folder / f"h-flood-{number}", flood=True)
        missed.append(timing.missed_but(VICTIM))
    what = f"… {JUNK_PER_S:,} junk messages a second at one robot: the others miss"
    return Row("h", what, missed, "%", Target("<=", 1.0))


class _Timing:
    """A sink that keeps what a run says about its time."""

    def __init__(self) -> None:
        self._details: dict[str, Any] = {}
        self._delays_ns: list[int] = []

    def __call__(self, record: Record) -> None:
        if isinstance(record, Timing):
            self._details = record.details
        elif isinstance(record, LinkRows):
            self._delays_ns += [
                row.t_usable_ns - row.t_sent_ns for row in record.rows if row.t_usable_ns
            ]

    @property
    def missed(self) -> float:
        """Percent of all robots' periods."""
        return self.missed_but(None)

    def missed_but(self, robot: int | None) -> float:
        """The same without those of ``robot``."""
        robots = [own for name, own in self._details["robots"].items() if name != str(robot)]
        missed, periods = (sum(int(own[what]) for own in robots) for what in ("missed", "periods"))
        return 100.0 * missed / periods

    @property
    def plant_ms(self) -> float:
        """By how much the plant woke late for a sample, 99th percentile."""
        return 1e3 * float(self._details["plant"]["woke_late_s"]["p99"])

    @property
    def off_ms(self) -> float:
        """By how much links' delays differ from what was asked for, 99th percentile."""
        off_ns = np.abs(np.array(self._delays_ns) - round(DELAY_S * 1e9))
        return float(np.percentile(off_ns, 99)) / 1e6

    def robots(self, figure: str, quantile: str) -> float:
        """The median over the robots, in milliseconds."""
        values = [own[figure][quantile] for own in self._details["robots"].values()]
        return 1e3 * float(np.median(values))


def _run(robots: int, seconds: int, timing: _Timing, folder: Path, *, flood: bool = False) -> None:
    scenario = loads(
        ring_toml(robots, 1000 * seconds), f"ring-{robots}", [*_SETTINGS, f"duration_s={seconds}"]
    )
    folder.mkdir(parents=True)
    name = f"pacing-{secrets.token_hex(3)}"
    launch = Launch(resolve(scenario), name, timing, folder / "logs")
    done = threading.Event()
    flooding = threading.Thread(target=_flood, args=(launch.endpoint, bus.Keys(name), done))
    if flood:
        flooding.start()
    outcome = launch.wait(lambda: False)
    done.set()
    if flood:
        flooding.join()
    if outcome.kind != "completed":
        raise BenchmarkError(f"{robots} robots in real time: {outcome.kind}, {outcome.reason}")


def _flood(endpoint: str, keys: bus.Keys, done: threading.Event) -> None:
    """What is no message, in equal parts as from the plant, from the robot and to neighbours."""
    burst = JUNK_PER_S // 100
    with bus.session(connect=endpoint) as session:
        places = [keys.to_robot(VICTIM), keys.from_robot(VICTIM), keys.broadcast(VICTIM)]
        publishers = [bus.publisher(session, key, blocking=False) for key in places]
        while not done.is_set():
            began_s = time.monotonic()
            for number in range(burst):
                publishers[number % len(publishers)].put(b"\xc1 junk")
            time.sleep(max(0.0, began_s + 0.01 - time.monotonic()))
