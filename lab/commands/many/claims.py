"""``formnet claims``: run every claim, print the table, write it down."""

import json
import sys
import time
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import NamedTuple

import click
from matplotlib.figure import Figure
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from formnet.formation.scenario.loading import load
from formnet.formation.scenario.model import Scenario
from formnet.lab.claims import figures, report
from formnet.lab.claims.catalogue import COMPARED, catalogue
from formnet.lab.claims.claim import Case, Claim
from formnet.lab.claims.results import BROKEN, FAILS, HOLDS, OBSERVED, Result, Row
from formnet.lab.commands.options import INLINE_RUNS, JOBS, Command, need_inline
from formnet.lab.figures.canvas import save
from formnet.lab.judge import verdict
from formnet.lab.judge.claim_words import EQUATIONS, UNITS
from formnet.lab.launch import inline as one_process
from formnet.lab.launch import pool
from formnet.lab.launch.execution import execute
from formnet.lab.launch.signals import stop_signals
from formnet.lab.runs import files
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT, INTERRUPTED, ONE_FAILS, in_words
from formnet.lab.runs.exits import BROKEN as RUN_BROKE
from formnet.lab.runs.exits import of as code_of
from formnet.lab.runs.folders import claimed, fresh_folder
from formnet.lab.runs.recording import Collected, Recording
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.lab.text.tables import output

_STYLES = {HOLDS: "green", FAILS: "red", BROKEN: "red", OBSERVED: "dim"}


class _Work(NamedTuple):
    """One run to do, into ``folder``."""

    claim: str
    case: Case
    folder: Path
    inline: bool


@click.command("claims", cls=Command)
@INLINE_RUNS
@click.option(
    "--only",
    multiple=True,
    metavar="PATTERN",
    help="Only claims whose key matches, e.g. theorem-* (--list shows the keys). Repeatable.",
)
@click.option("--list", "listed", is_flag=True, help="List the claims and end.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder of results  [default: runs/claims-<time>]",
)
@click.option(
    "--into",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    metavar="FILE",
    help="Put the table into FILE, between the comments that mark its place there.",
)
@JOBS
def command(
    inline: bool,
    only: tuple[str, ...],
    listed: bool,
    out: Path | None,
    into: Path | None,
    jobs: int | None,
) -> None:
    """Run every claim of the paper, judge each.

    Exit code 0: every one ends as predicted; 1: one does not; 2: bad usage; 3: a run broke;
    130: interrupted (what is complete is written).
    """
    need_inline(jobs, inline=inline)
    sys.exit(list_claims() if listed else run_claims(only, out, into, jobs, inline=inline))


def run_claims(
    only: Sequence[str], out: Path | None, into: Path | None, jobs: int | None, *, inline: bool
) -> int:
    """Run the claims whose keys match ``only`` (all, if empty); the exit code of the command."""
    console = Console(stderr=True)
    claims = catalogue()
    chosen = [c for c in claims if not only or any(fnmatchcase(c.key, some) for some in only)]
    unmatched = [some for some in only if not any(fnmatchcase(c.key, some) for c in claims)]
    if into is not None and only:
        console.print("[red]--into:[/] goes with all claims, not with --only: it takes the whole "
                      "table's place")  # fmt: skip
        return BAD_INPUT
    if unmatched:
        keys = ", ".join(claim.key for claim in claims)
        console.print(f"[red]--only:[/] {escape(unmatched[0])} matches no claim ({keys})")
        return BAD_INPUT
    try:
        if into is not None:
            report.around(into)  # before the work, not after it
        folder = claimed(out, "claims", partial(fresh_folder, first="claims.md"))
    except report.NoBlock as error:
        console.print(f"[red]--into:[/] {escape(str(error))}", soft_wrap=True)
        return BAD_INPUT
    except OSError as error:
        console.print(f"[red]error:[/] {escape(in_words(error))}", soft_wrap=True)
        return code_of(error)
    work = [
        _Work(claim.key, case, folder / "cases" / claim.key / case.name, inline)
        for claim in chosen
        for case in claim.cases
    ]
    done: dict[tuple[str, str], Result] = {}
    failed = None
    with stop_signals() as stopped:
        try:
            _do_all(console, work, done, jobs, stopped.is_set, inline=inline)
        except pool.WorkFailed as error:
            failed = str(error)
    rows = list(_rows(chosen, done))
    problems = files.attempt(
        partial(_write, folder, rows, mode="inline" if inline else "distributed")
    )
    output().print(_table(rows))
    if into is not None and len(done) == len(work):
        problems += files.attempt(partial(report.put_into, into, report.markdown(rows)))
    for problem in problems:
        console.print(f"[red]not written:[/] {escape(in_words(problem))}", soft_wrap=True)
    console.print(f"everything is in {escape(str(folder))}", soft_wrap=True)
    if failed is not None:
        console.print(f"[red]broken after {len(done)} of {len(work)} runs:[/] {escape(failed)}")
        return RUN_BROKE
    if len(done) < len(work):
        console.print(f"interrupted after {len(done)} of {len(work)} runs")
        return INTERRUPTED
    if problems:
        return RUN_BROKE
    verdicts = {row.verdict for row in rows}
    return RUN_BROKE if BROKEN in verdicts else ONE_FAILS if FAILS in verdicts else ALL_HOLD


def list_claims() -> int:
    """Print every claim's key, what it says and how many runs it takes."""
    table = Table(box=SIMPLE_HEAD)
    for column in ("key", "claim", "in the paper", "should happen", "runs"):
        table.add_column(column)
    for claim in catalogue():
        table.add_row(claim.key, claim.says, claim.where, claim.should, str(len(claim.cases)))
    output().print(table)
    return ALL_HOLD


def _do_all(
    console: Console, work: Sequence[_Work], done: dict[tuple[str, str], Result],
    jobs: int | None, stopped: pool.Stopped, *, inline: bool,
) -> None:  # fmt: skip
    """Put the results of all runs into ``done``, by the keys of claim and case."""
    if inline:  # the longest first, so that no core is left with a long one at the end
        longest_first = sorted(work, key=lambda item: -_cost(item.case))
        found = pool.at_once(_run, longest_first, stopped, jobs)
    else:  # every run has all cores
        found = pool.in_turn(_run, work, stopped)
    for item, result in pool.shown(console, found, len(work), _label):
        if result.verdict["outcome"]["kind"] == "interrupted":
            return
        done[item.claim, item.case.name] = result
        if not result.as_expected:
            outcome = result.verdict["outcome"]
            how = f"{outcome['kind']} {outcome['reason']}".strip()
            for lost in result.verdict["robots"]["lost"]:
                how += f"; robot {lost['robot']} was lost: {lost['reason']}"
            console.print(
                f"[red]not as predicted:[/] {_label(item)} ({escape(how)}), see "
                + escape(str(item.folder)), soft_wrap=True,
            )  # fmt: skip


def _label(item: _Work) -> str:
    return f"{item.claim}, {item.case.name}"


def _cost(case: Case) -> float:
    """How long a run takes, roughly: robots times virtual seconds."""
    scenario = _scenario(case)
    return len(scenario.ids) * scenario.duration_s


def _run(item: _Work, stopped: pool.Stopped) -> Result:
    """One run; what it recorded is kept if it did not end as it should."""
    recording = Recording(item.folder, _scenario(item.case))
    began = time.monotonic()
    execute(recording, recording, stopped, inline=item.inline)
    seconds = time.monotonic() - began
    mode = "inline" if item.inline else "distributed"
    judged = verdict.of(recording, mode=mode, wall_s=seconds)
    verdict.save(judged, item.folder)
    result = Result(item.case, judged, seconds)
    if result.as_expected:
        recording.close()
    elif problems := recording.save():
        raise problems[0]
    return result


def _scenario(case: Case) -> Scenario:
    return load(CONFIGS / case.scenario, case.all_overrides)


def _rows(claims: Sequence[Claim], done: dict[tuple[str, str], Result]) -> Iterator[Row]:
    """The rows of which every run is there."""
    for claim in claims:
        results = [done.get((claim.key, case.name)) for case in claim.cases]
        known = [result for result in results if result is not None]
        if len(known) == len(results):
            yield Row(claim, known)


def _write(folder: Path, rows: Sequence[Row], *, mode: str) -> None:
    files.replace(folder / "claims.md", report.markdown(rows))
    text = json.dumps(report.as_json(rows, mode=mode), indent=2, allow_nan=False,
                      ensure_ascii=False)  # fmt: skip
    files.write_new(folder / "claims.json", text + "\n")
    drawn = {"claims": figures.summary(rows)} if rows else {}
    following = next((row for row in rows if row.claim.key == "leader-follower"), None)
    if following is not None:
        drawn["remark-9"] = _remark_9(following)
    for name, figure in drawn.items():
        save(figure, folder, name)


def _remark_9(row: Row) -> Figure:
    """Both laws, run again in this process: the same bits."""
    runs = []
    for name in COMPARED:
        case = next(result.case for result in row.results if result.case.name == name)
        run = Collected(_scenario(case))
        one_process.run(run.scenario, name, run)
        runs.append(run)
    return figures.compared(*runs)


def _table(rows: Sequence[Row]) -> Table:
    """The short form: what is said and should happen stands in claims.md."""
    table = Table(box=SIMPLE_HEAD, title="the paper's claims", title_justify="left")
    for column in ("claim", "in the paper", "verdict"):
        table.add_column(column)
    for column in ("runs", *(f"{name} ({UNITS[claim]})" for claim, name in EQUATIONS.items())):
        table.add_column(column, justify="right", no_wrap=True)
    for row in rows:
        told = row.verdict if row.verdict == HOLDS else row.happened
        table.add_row(
            row.claim.key, row.claim.where, f"[{_STYLES[row.verdict]}]{escape(told)}[/]",
            str(len(row.results)), *(report.number(row, claim) for claim in EQUATIONS),
        )  # fmt: skip
    return table
