"""(g) How long the others stand still when a robot's process is lost, unplanned.

A client of the run's bus listens to the broadcasts, one a tick, while the run goes on. The
time is from the signal to the first broadcast, by another robot, of a tick after the last that
the lost one took part in. HELICS beside it: from the same signal until the federate that
is the plant ends, by itself.
"""

import random
import secrets
import signal
import time
from collections.abc import Callable
from pathlib import Path

import zenoh

from benchmarks import helics_fed
from benchmarks.plan import LEAST_TICKS, Plan
from benchmarks.scenarios import SECTION5
from benchmarks.table import BenchmarkError, Row
from formnet.formation.briefing.resolving import resolve
from formnet.formation.records.events import Lost
from formnet.formation.records.stream import Record
from formnet.formation.scenario.loading import load
from formnet.formation.wire import bus
from formnet.formation.wire.broadcast import HELLO, Envelope
from formnet.lab.launch.launch import Launch
from formnet.netem.settings.timeline import NEVER

PATIENCE_S = 1.0
"""``run.patience_s`` of these runs."""
LIMIT_S = 60.0
"""A run that has not begun, or gone on, within this time has failed."""


def measure(plan: Plan, folder: Path) -> list[Row]:
    """Every round kills one robot and stops another one, each in a run of its own.

    Raises:
        BenchmarkError: a run did not start, or did not go on.
    """
    draw = random.Random(1)
    killed, stopped, helics = [], [], []
    note = "" if helics_fed.installed() else "not installed: pip install -e .[benchmark]"
    if plan.skip_helics:
        note = "skipped"
    for number in range(1, plan.rounds + 1):
        plan.say(f"g: round {number} of {plan.rounds}")
        place = folder / f"g-{number}"
        killed.append(1e3 * stall_s(signal.SIGKILL, draw, place / "killed"))
        stopped.append(stall_s(signal.SIGSTOP, draw, place / "stopped"))
    if not note:
        plan.say("g: HELICS, one round")
        try:
            helics.append(helics_fed.abort_s(5, place / "helics", core=plan.helics_core))
        except BenchmarkError as error:
            note = str(error)
    return [
        Row("g", "a robot is killed: the others go on after", killed, "ms"),
        Row("g", f"a robot is stopped, patience_s = {PATIENCE_S:g}: likewise", stopped, "s"),
        Row(
            "g",
            f"HELICS ({plan.helics_core}), one is killed: all are aborted after",
            helics,
            "s",
            note=note,
        ),
    ]


def stall_s(number: signal.Signals, draw: random.Random, folder: Path) -> float:
    """Send signal ``number`` to one robot of a run; seconds until the others go on."""
    scenario = load(
        SECTION5,
        ["duration_s=600", "clock.broadcast_period_s=0.001", f"run.patience_s={PATIENCE_S}"],
    )
    folder.mkdir(parents=True)
    name = f"losses-{secrets.token_hex(3)}"
    seen = _Seen()
    launch = Launch(resolve(scenario), name, seen.take, folder / "logs")
    try:
        with bus.session(connect=launch.endpoint) as session:
            subscription = session.declare_subscriber(bus.Keys(name).broadcasts, seen.hear)
            _until(lambda: len(seen.first_s) > LEAST_TICKS, "the run did not begin")
            time.sleep(draw.random())  # anywhere within a tick
            robot = draw.choice(scenario.ids)
            began_s = time.perf_counter()
            launch.robots[robot].send_signal(number)
            _until(lambda: seen.gone_tick < NEVER, f"robot {robot} was not missed")
            _until(lambda: seen.gone_tick + 1 in seen.first_s, "the others did not go on")
            del subscription
    finally:
        launch.wait(lambda: True)
    return seen.first_s[seen.gone_tick + 1] - began_s


class _Seen:
    """What a run does, from outside."""

    def __init__(self) -> None:
        self.first_s: dict[int, float] = {}  # when the first broadcast of a tick was heard
        self.gone_tick = NEVER

    def take(self, record: Record) -> None:
        """A sink."""
        if isinstance(record, Lost):
            self.gone_tick = record.tick

    def hear(self, sample: zenoh.Sample) -> None:
        """A subscriber's callback."""
        now_s = time.perf_counter()
        if sample.attachment is not None:
            tick = Envelope.unpack(sample.attachment.to_bytes()).tick
            if tick != HELLO:
                self.first_s.setdefault(tick, now_s)


def _until(condition: Callable[[], bool], failure: str) -> None:
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        if time.monotonic() > deadline:
            raise BenchmarkError(failure)
        time.sleep(0.001)
