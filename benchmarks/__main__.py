"""``python -m benchmarks``: measure, and print one table of ratios."""

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from benchmarks import (
    bridging,
    exchange,
    inline_speed,
    lateness,
    losses,
    pacing,
    scaling,
    throughput,
    watching,
)
from benchmarks.helics_fed import CORE
from benchmarks.plan import LEAST_TICKS, Plan
from benchmarks.table import BenchmarkError, Report, Row

GROUPS = ("a", "b", "c", "d", "e", "f", "g", "h", "i")


def main() -> int:
    """Run what was asked for; 0, or 3 if something could not be measured."""
    asked = _arguments()
    console = Console(stderr=True)
    plan = Plan(asked.ticks, asked.rounds, asked.skip_helics, asked.helics_core, console)
    report = Report(
        {
            "ticks": asked.ticks,
            "rounds": asked.rounds,
            "only": asked.only,
            "skip_helics": asked.skip_helics,
            "helics_core": asked.helics_core,
        }
    )
    failed = False
    with tempfile.TemporaryDirectory(prefix="formnet-benchmarks-") as folder:
        for group in asked.only:
            try:
                report.rows += _measure(group, plan, Path(folder))
            except BenchmarkError as error:
                failed = True
                report.rows.append(Row(group, "could not be measured", [], note=str(error)))
    report.show(Console(width=None if sys.stdout.isatty() else 150))
    if asked.json is not None:
        try:
            report.save(asked.json)
        except OSError as error:
            console.print(f"[red]--json:[/] {asked.json} cannot be written: {error.strerror}")
            return 3
    return 3 if failed else 0


def _measure(group: str, plan: Plan, folder: Path) -> list[Row]:
    if group == "a":
        return exchange.measure(plan, folder)
    if group == "b":
        return inline_speed.measure(plan)
    if group == "c":
        return scaling.measure(plan, folder)
    if group == "d":
        return throughput.measure(plan)
    if group == "e":
        return lateness.measure(plan)
    if group == "f":
        return bridging.measure(plan, folder)
    if group == "g":
        return losses.measure(plan, folder)
    if group == "h":
        return pacing.measure(plan, folder)
    return watching.measure(plan, folder)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Cost of formnet's lockstep against the bare Zenoh exchange and HELICS (a), "
        "inline speed (b), growth with the robots (c), a link's throughput (d) and its lateness "
        "on the wall clock (e), a bridge between Zenoh programs (f), how long the others stand "
        "still when a robot is lost (g), real time (h), what watching costs (i); one table.",
    )
    parser.add_argument(
        "--ticks",
        type=_at_least(LEAST_TICKS),
        default=2000,
        help="ticks a round (default %(default)s); the other lengths follow",
    )
    parser.add_argument(
        "--rounds", type=_at_least(1), default=5, help="rounds (default %(default)s; c at most 3)"
    )
    parser.add_argument("--skip-helics", action="store_true", help="leave HELICS out of a and g")
    parser.add_argument(
        "--helics-core", default=CORE, help="HELICS's core type (default %(default)s)"
    )
    parser.add_argument(
        "--only", type=_groups, default=list(GROUPS), metavar="a,b,...", help="only these"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every round here, too")
    return parser.parse_args()


def _at_least(least: int) -> Callable[[str], int]:
    def integer(text: str) -> int:
        value = int(text)
        if value < least:
            raise argparse.ArgumentTypeError(f"{value} is less than {least}")
        return value

    return integer


def _groups(text: str) -> list[str]:
    asked = [part.strip() for part in text.split(",") if part.strip()]
    unknown = [part for part in asked if part not in GROUPS]
    if unknown or not asked:
        raise argparse.ArgumentTypeError(f"{text!r}: give some of {', '.join(GROUPS)}")
    return [group for group in GROUPS if group in asked]


if __name__ == "__main__":
    sys.exit(main())
