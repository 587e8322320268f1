"""``python -m benchmarks.kill_trials``: robots killed and stopped from outside, at any moment.

Each trial is a ``formnet run`` in which one robot's process gets a signal at a random instant,
from before it has joined to after the last tick. Whatever the instant, the run must end
within its bound, with an exit code that says how, a verdict, and tables that can be read; where
the robot was missed, the others must have run on to the end; no process may be left.
"""

import argparse
import json
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil

from benchmarks.scenarios import SECTION5
from formnet.lab.runs.tables import read_links, read_states
from formnet.plant.host import START_PATIENCE_S

PATIENCE_S = 1.0
"""``run.patience_s`` of these runs."""
BOUND_S = START_PATIENCE_S + PATIENCE_S + 30.0
"""How long a run may go on after the signal: longest if the robot had not joined yet."""
DURATION_S = 10.0
"""Of a run, in virtual time: some four seconds on the wall."""
SPAN_S = 4.5
"""The signal comes within this time from the start of the robot's process on."""


def main() -> int:
    """All trials; 0 if every one ended as it must, else 1."""
    parser = argparse.ArgumentParser(description="Robots lost at random instants of real runs.")
    parser.add_argument("--kills", type=int, default=50, help="trials with SIGKILL")
    parser.add_argument("--stops", type=int, default=20, help="trials with SIGSTOP")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    draw = random.Random(asked.seed)
    bad, longest_s, ways = 0, 0.0, Counter[str]()
    for number, name in [(signal.SIGKILL, "SIGKILL")] * asked.kills + [
        (signal.SIGSTOP, "SIGSTOP")
    ] * asked.stops:
        robot, after_s = draw.randint(1, 5), draw.uniform(0.0, SPAN_S)
        took_s, how, problems = trial(number, robot, after_s)
        bad += bool(problems)
        longest_s = max(longest_s, took_s)
        ways[f"{name}: {how}"] += 1
        print(
            f"{name} robot {robot} after {after_s:.3f} s: ended {took_s:.2f} s later, {how}"
            + "".join(f"\n  PROBLEM: {problem}" for problem in problems),
            flush=True,
        )
    print(
        f"seed {asked.seed}: {asked.kills + asked.stops} trials, {bad} with a problem; the "
        f"longest ended {longest_s:.2f} s after the signal (bound {BOUND_S:g} s)"
    )
    for way, count in sorted(ways.items()):
        print(f"  {count:3} {way}")
    return 1 if bad else 0


def trial(number: signal.Signals, robot: int, after_s: float) -> tuple[float, str, list[str]]:
    """One run: seconds from the signal to its end, how it ended, and what is wrong with that."""
    with tempfile.TemporaryDirectory(prefix="formnet-trial-") as scratch:
        out = Path(scratch) / "run"
        overrides = (f"duration_s={DURATION_S}", f"run.patience_s={PATIENCE_S}")
        command = [sys.executable, "-m", "formnet", "run", str(SECTION5), "--out", str(out)]
        for override in overrides:
            command += ["--set", override]
        launcher = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        children: list[psutil.Process] = []
        victim = None
        while victim is None and launcher.poll() is None:
            children = _children(launcher.pid)
            victim = next((c for c in children if _is_robot(c, robot)), None)
            time.sleep(0.005)
        time.sleep(after_s)
        children = _children(launcher.pid) or children
        sent = victim is not None and victim.is_running()
        if sent and victim is not None:
            with suppress(psutil.NoSuchProcess):
                victim.send_signal(number)
        began_s = time.monotonic()
        try:
            code = launcher.wait(BOUND_S)
        except subprocess.TimeoutExpired:
            launcher.kill()
            launcher.wait()
            return BOUND_S, "not at all", [f"still running {BOUND_S:g} s after the signal"]
        took_s = time.monotonic() - began_s
        _, children = psutil.wait_procs(children, timeout=2.0)
        how, problems = _ending(out, code, robot)
        problems += [f"left behind: {child.pid}" for child in children]
    return took_s, how if sent else f"{how} (it was over already)", problems


def _ending(out: Path, code: int, robot: int) -> tuple[str, list[str]]:
    """How a run ended, and what is wrong with what it left."""
    try:
        verdict: dict[str, Any] = json.loads((out / "verdict.json").read_text(encoding="utf-8"))
        samples, links = read_states(out), read_links(out)
    except (OSError, ValueError, KeyError) as error:
        return f"exit code {code}", [f"no verdict or no tables: {error}"]
    kind = verdict["outcome"]["kind"]
    lost = [item["robot"] for item in verdict["robots"]["lost"]]
    how = f"exit code {code}, {kind}" + (", without it" if lost else "")
    return how, list(_wrong(code, kind, verdict, lost, robot, len(samples), len(links)))


def _wrong(
    code: int,
    kind: str,
    verdict: dict[str, Any],
    lost: list[int],
    robot: int,
    samples: int,
    links: int,
) -> Iterator[str]:
    if code not in ((0, 1) if kind == "completed" else (3,)):
        yield f"exit code {code} of a run that is {kind}"
    if kind == "completed" and (
        verdict["simulated_s"],
        samples,
    ) != (DURATION_S, 5 * (round(100 * DURATION_S) + 1)):
        yield f"completed with {samples} samples up to {verdict['simulated_s']} s"
    if kind == "completed" and not links:
        yield "no messages"
    if lost not in ([], [robot]):
        yield f"lost {lost} instead of {robot}"
    if kind != "completed" and verdict["outcome"]["robot"] not in (robot, None):
        yield f"robot {verdict['outcome']['robot']} is named instead of {robot}"


def _children(pid: int) -> list[psutil.Process]:
    try:
        return list(psutil.Process(pid).children(recursive=True))
    except psutil.NoSuchProcess:
        return []


def _is_robot(process: psutil.Process, robot: int) -> bool:
    try:
        words = process.cmdline()
    except psutil.NoSuchProcess:
        return False
    return "agent" in words and words[words.index("--robot") + 1] == str(robot)


if __name__ == "__main__":
    sys.exit(main())
