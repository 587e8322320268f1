"""(f) What carrying messages over ``formnet netem-bridge`` costs, all impairments off.

Two plain Zenoh programs, a publisher and a subscriber, with the bridge between
them and, in the same round, connected directly.
"""

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.plan import Plan
from benchmarks.table import BenchmarkError, Row, Target
from formnet.lab.launch.launch import free_port

PER_SECOND = Target(">=", 10_000.0)
_KEY = "robot/1/pose"
_LIMIT_S = 120.0


def measure(plan: Plan, folder: Path) -> list[Row]:
    """All rounds.

    Raises:
        BenchmarkError: a program failed, or a message was lost.
    """
    folder.mkdir(parents=True, exist_ok=True)
    network = folder / "ideal.toml"
    network.write_text('[network.default]\npreset = "ideal"\n', encoding="utf-8")
    rate: dict[bool, list[float]] = {True: [], False: []}
    delays: dict[tuple[bool, int], list[float]] = {(b, q): [] for b in rate for q in (50, 99)}
    for number in range(1, plan.rounds + 1):
        plan.say(f"f: round {number} of {plan.rounds}")
        for bridged in rate:
            bulk = _received(network if bridged else None, 20 * plan.ticks, 0.0)
            took_s = (max(bulk[:, 1]) - min(bulk[:, 0])) / 1e9
            rate[bridged].append(len(bulk) / took_s)
            calm = _received(network if bridged else None, plan.ticks, 0.001)
            for q in (50, 99):
                late_us = (calm[:, 1] - calm[:, 0]) / 1e3
                delays[bridged, q].append(float(np.percentile(late_us, q)))
    rows = [
        Row("f", "bridge, messages of 100 bytes a second", rate[True], "/s", PER_SECOND),
        Row("f", "without it", rate[False], "/s"),
    ]
    for q in (50, 99):
        through, direct = delays[True, q], delays[False, q]
        added = [a - b for a, b in zip(through, direct, strict=True)]
        rows.append(Row("f", f"added latency at 1,000 messages a second, p{q}", added, "µs"))
        rows.append(Row("f", f"latency without it, p{q}", direct, "µs"))
    return rows


def _received(network: Path | None, count: int, period_s: float) -> NDArray[np.int64]:
    """When each message was sent and arrived (ns), shape (count, 2); ``network``: by a bridge."""
    here, there = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    ends = ("--listen", there) if network else ("--connect", here)
    with ExitStack() as stack:
        publisher = stack.enter_context(
            _program(
                "benchmarks.zenoh_ends",
                "publish",
                _KEY,
                "--listen",
                here,
                "--count",
                str(count),
                "--period",
                str(period_s),
            )
        )
        subscriber = stack.enter_context(
            _program(
                "benchmarks.zenoh_ends", "subscribe", "robot/**", *ends, "--count", str(count + 1)
            )
        )
        if network:
            stack.enter_context(
                _program(
                    "formnet",
                    "netem-bridge",
                    "--from",
                    here,
                    "--to",
                    there,
                    "--key",
                    "robot/**",
                    "--network",
                    str(network),
                )
            )
        assert publisher.stdin is not None
        assert subscriber.stdout is not None
        watchdog = threading.Timer(_LIMIT_S, subscriber.kill)
        watchdog.start()
        subscriber.stdout.readline()  # it has been greeted
        publisher.stdin.write(b"go\n")
        publisher.stdin.flush()
        text = subscriber.stdout.read()
        watchdog.cancel()
    if not text:
        raise BenchmarkError(f"the {count} messages did not all arrive within {_LIMIT_S:.0f} s")
    rows = [row for row in json.loads(text) if row["kind"] == "PUT"]
    if [row["number"] for row in rows] != list(range(count)):
        raise BenchmarkError(f"{len(rows)} messages of {count} arrived, or not in order")
    return np.array([(row["sent_ns"], row["arrived_ns"]) for row in rows], dtype=np.int64)


@contextmanager
def _program(*command: str) -> Iterator[subprocess.Popen[bytes]]:
    """``python -m command`` until the end of the block."""
    process = subprocess.Popen(
        [sys.executable, "-m", *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
