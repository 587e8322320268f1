"""``formnet verify``: does a recorded run, run again, give the same bits?"""

import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
from rich.console import Console
from rich.markup import escape

from formnet.formation.scenario.loading import ScenarioError
from formnet.formation.wire.record import Record, Sample
from formnet.lab.commands.options import RUNS, Command
from formnet.lab.forecast.foresight import obstacle
from formnet.lab.judge import verdict
from formnet.lab.launch.execution import execute
from formnet.lab.launch.signals import stop_signals
from formnet.lab.runs.difference import first_difference, other_extremes
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT, BROKEN, INTERRUPTED, ONE_FAILS
from formnet.lab.runs.recorded import Unreadable, read_whole
from formnet.lab.runs.recording import Recording, trajectory_sha256
from formnet.lab.text.problems import report_problems, say_slow
from formnet.lab.text.progress import Waits
from formnet.netem.settings.timeline import NEVER


@click.command("verify", cls=Command)
@RUNS
@click.option("--distributed", is_flag=True, help="Run again in many processes  [default: in one]")
def command(folders: tuple[Path, ...], distributed: bool) -> None:
    """Run recorded runs again; compare every bit.

    Each from its own scenario.toml. Exit code 0: identical; 1: the first difference is named;
    2: no run that could be repeated; 3: it could not be run again; 130: interrupted.
    """
    sys.exit(verify_runs(folders, inline=not distributed))


def verify_runs(folders: Sequence[Path], *, inline: bool) -> int:
    """Repeat every run and compare; the exit code of ``formnet verify``, the gravest of all."""
    console = Console(highlight=False)
    codes = []
    with stop_signals() as stopped:
        for folder in folders:
            if stopped.is_set():
                codes.append(INTERRUPTED)
                break
            try:
                codes.append(_verify(console, folder, stopped.is_set, inline=inline))
            except ScenarioError as error:
                report_problems(console, error)
                codes.append(BAD_INPUT)
            except Unreadable as error:
                console.print(f"[red]{escape(str(folder))}:[/] {escape(str(error))}",
                              soft_wrap=True)  # fmt: skip
                codes.append(BAD_INPUT)
    return max(codes)


def _verify(console: Console, folder: Path, stopped: Callable[[], bool], *, inline: bool) -> int:
    recorded = read_whole(folder)
    judged = recorded.verdict
    assert judged is not None
    problem = obstacle(recorded.scenario, partial(say_slow, console))
    if problem is not None:
        raise Unreadable(f"law.kind = {recorded.scenario.law.kind!r}: {problem}")
    if recorded.scenario.clock.mode == "realtime":
        raise Unreadable('clock.mode = "realtime": a run in real time does not repeat to the bit; '
                         "its virtual twin does (--set clock.mode=lockstep)")  # fmt: skip
    until_ns = _planned_until_ns(judged)
    samples = _before(recorded.samples, until_ns)
    if not samples:
        raise Unreadable("nothing to compare: no sample was recorded before something unplanned "
                         "happened")  # fmt: skip
    console.print(f"[dim]{escape(str(folder))}: {recorded.scenario.duration_s:g} s are run again "
                  "…[/]", soft_wrap=True)  # fmt: skip
    with TemporaryDirectory(prefix="formnet-verify-") as scratch:
        again = Recording(Path(scratch) / "run", recorded.scenario)

        waits = Waits(console)

        def take(record: Record) -> None:
            again(record)
            waits.take(record)

        outcome = execute(again, take, stopped, inline=inline, until_ns=until_ns)
        again.close()
    if stopped():
        return INTERRUPTED
    if again.now_ns() < samples[-1].t_ns:
        console.print(f"[red]{escape(str(folder))}:[/] could not be run again: {outcome.kind}, "
                      + escape(outcome.reason), soft_wrap=True)  # fmt: skip
        return BROKEN
    whole = until_ns == NEVER
    found = first_difference(
        samples, _before(again.samples, until_ns), recorded.scenario.clock.control_period_ns
    )
    if whole and found is None:  # what becomes of messages depends on what comes after
        found = first_difference(
            recorded.link_rows, again.sorted_link_rows, recorded.scenario.clock.control_period_ns
        )
    moved = other_extremes(judged.get("motion"), again.motion) if whole else None
    claimed = judged["trajectory_sha256"]
    sealed = trajectory_sha256(recorded.samples) == claimed
    name = escape(str(folder))
    if found is None and moved is None and sealed:
        extent = (
            f": {len(samples)} samples, {len(recorded.link_rows)} messages" if whole else
            f" up to t = {until_ns / 1e9:g} s, where {_what_happened(judged, until_ns)}: "
            f"{len(samples)} of {len(recorded.samples)} samples"
        )  # fmt: skip
        console.print(f"{name}: [green]identical[/]{extent}", soft_wrap=True)
        if whole:
            console.print(f"  sha256 {claimed}", soft_wrap=True)
        return ALL_HOLD
    console.print(f"{name}: [red]differs[/]", soft_wrap=True)
    if not sealed:
        console.print("  states.parquet is not what verdict.json has the SHA-256 of: it was "
                      "changed after the run", soft_wrap=True)  # fmt: skip
    if found is not None:
        console.print(f"  first at {escape(str(found))} (recorded, and again)", soft_wrap=True)
    if moved is not None:
        console.print(f"  motion, {escape(moved)} (recorded, and again)", soft_wrap=True)
    if found is not None or moved is not None:
        for line in _other_versions(judged):
            console.print(f"  {escape(line)}", soft_wrap=True)
    return ONE_FAILS


def _planned_until_ns(judged: Mapping[str, Any]) -> int:
    """Up to when nothing happened that the scenario does not say."""
    unplanned = [item["t_s"] for item in judged["robots"]["lost"]]
    if judged["outcome"]["kind"] not in ("completed", "diverged"):
        unplanned.append(judged["outcome"]["t_s"])
    return min((round(t_s * 1e9) for t_s in unplanned), default=NEVER)


def _what_happened(judged: Mapping[str, Any], at_ns: int) -> str:
    """What the scenario does not say, and is not compared."""
    outcome = judged["outcome"]
    if outcome["kind"] in ("completed", "diverged") or round(outcome["t_s"] * 1e9) > at_ns:
        return "something unplanned happened"
    return f"the recorded run ended ({outcome['kind']}; whether it does so again is not looked at)"


def _before(samples: Sequence[Sample], until_ns: int) -> list[Sample]:
    return [sample for sample in samples if sample.t_ns < until_ns]


def _other_versions(judged: Mapping[str, Any]) -> list[str]:
    """What the recorded run was made with that is another now."""
    before, now = judged.get("versions", {}), verdict.versions()
    return [
        f"{name}: recorded with {before.get(name)}, now {value}"
        for name, value in now.items()
        if before.get(name) != value
    ]
