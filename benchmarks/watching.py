"""(i) What watching costs the watched: a tick with nobody, with a viewer, with one that hangs.

Everybody takes turns in every round; a ratio is taken within its round. The viewer is what
``formnet run --web`` starts: a monitor and Rerun's server. A browser that draws is a program
of the user's own, which takes what it takes of the machine.
"""

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil

from benchmarks import formnet_run
from benchmarks.plan import Plan
from benchmarks.scenarios import section5
from benchmarks.table import BenchmarkError, Row, Target
from formnet.formation.scenario.loading import dumps
from formnet.formation.scenario.model import Scenario
from formnet.lab.launch.launch import LocalChild, end
from formnet.lab.launch.signals import GRACE_S
from formnet.lab.runs import files
from formnet.lab.runs.recording import SCENARIO
from formnet.lab.scene.writer import SceneWriter

BOUND = Target("<=", 1.1)


def measure(plan: Plan, folder: Path) -> list[Row]:
    """All rounds.

    Raises:
        BenchmarkError: a run failed, or there was nobody to watch it.
    """
    scenario = section5(plan.ticks)
    ways: dict[str, Callable[[Path], float]] = {
        "a tick that nobody watches": lambda place: formnet_run.tick_ms(scenario, place),
        "... and run.rrd is written": lambda place: _recorded(scenario, place),
        "... and a live viewer is fed": lambda place: _watched(scenario, place, _nothing),
        "... whose server is stopped": lambda place: _watched(scenario, place, _stop_server),
        "... whose monitor is stopped": lambda place: _watched(scenario, place, _stop_monitor),
    }
    found: dict[str, list[float]] = {way: [] for way in ways}
    for number in range(1, plan.rounds + 1):
        for k, (way, tick_ms) in enumerate(ways.items()):
            plan.say(f"i: round {number} of {plan.rounds}: {way}")
            found[way].append(tick_ms(folder / f"i-{number}-{k}"))
    first, *others = ways
    return [
        Row("i", first, found[first], "ms"),
        *(
            Row(
                "i",
                way,
                [a / b for a, b in zip(found[way], found[first], strict=True)],
                target=BOUND,
            )
            for way in others
        ),
    ]


def _recorded(scenario: Scenario, place: Path) -> float:
    place.mkdir(parents=True)
    files.write_new(place / SCENARIO, dumps(scenario))
    file = SceneWriter(place)
    found = formnet_run.tick_ms(scenario, place, also=file.take)
    file.close()
    return found


def _watched(
    scenario: Scenario, place: Path, treat: Callable[[subprocess.Popen[bytes]], None]
) -> float:
    monitors = []

    def begun(endpoint: str, run: str) -> None:
        with (place / "monitor.log").open("wb") as log:
            monitor = LocalChild(
                [
                    sys.executable,
                    "-m",
                    "formnet",
                    "monitor",
                    "--connect",
                    endpoint,
                    "--run",
                    run,
                    "--web",
                    "--leash",
                ],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                start_new_session=True,
            )
        monitors.append(monitor)
        assert monitor.stdout is not None
        if not monitor.stdout.readline().startswith(b"watching"):
            raise BenchmarkError(
                f"the monitor did not start: {(place / 'monitor.log').read_text()}"
            )
        treat(monitor)

    try:
        return formnet_run.tick_ms(scenario, place, begun=begun)
    finally:
        for monitor in monitors:
            for process in [monitor, *psutil.Process(monitor.pid).children()]:
                process.send_signal(signal.SIGCONT)
        end(monitors, time.monotonic() + 2 * GRACE_S)


def _nothing(_monitor: subprocess.Popen[bytes]) -> None:
    pass


def _stop_monitor(monitor: subprocess.Popen[bytes]) -> None:
    monitor.send_signal(signal.SIGSTOP)


def _stop_server(monitor: subprocess.Popen[bytes]) -> None:
    (server,) = psutil.Process(monitor.pid).children()
    server.suspend()
