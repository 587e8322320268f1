"""``formnet claims``: run every claim, print the table, write it down."""

from collections.abc import Sequence
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.table import Table

from formnet.formation.scenario.expect import ERRORS
from formnet.lab.claims import report
from formnet.lab.claims.catalogue import catalogue
from formnet.lab.claims.folder import write
from formnet.lab.claims.results import BROKEN, Result, Row, complete
from formnet.lab.claims.work import Work, cost, do
from formnet.lab.launch import pool
from formnet.lab.launch.engine import EngineName
from formnet.lab.launch.signals import stop_signals
from formnet.lab.runs import files
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT, INTERRUPTED, ONE_FAILS, in_words
from formnet.lab.runs.exits import BROKEN as RUN_BROKE
from formnet.lab.runs.exits import of as code_of
from formnet.lab.runs.folders import claimed, forget, fresh_folder
from formnet.lab.text.console import Console, escape
from formnet.lab.text.tables import output
from formnet.lab.verdict.model import FAILS, HOLDS, NOT_JUDGED, OBSERVED

_STYLES = {HOLDS: "green", FAILS: "red", NOT_JUDGED: "red", BROKEN: "red", OBSERVED: "dim"}


def run_claims(
    only: Sequence[str],
    out: Path | None,
    into: Path | None,
    jobs: int | None,
    engine: EngineName,
) -> int:
    """Run the claims whose keys match ``only`` (all, if empty); the exit code of the command."""
    console = Console(stderr=True)
    claims = catalogue()
    chosen = [c for c in claims if not only or any(fnmatchcase(c.key, some) for some in only)]
    unmatched = [some for some in only if not any(fnmatchcase(c.key, some) for c in claims)]
    if into is not None and only:
        console.print(
            "[red]--into:[/] needs all claims and excludes --only: it replaces the whole table"
        )
        return BAD_INPUT
    if unmatched:
        keys = ", ".join(claim.key for claim in claims)
        console.print(
            f"[red]--only:[/] {escape(unmatched[0])} matches no claim ({keys})", soft_wrap=True
        )
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
        Work(claim.key, case, folder / "cases" / claim.key / case.name, engine)
        for claim in chosen
        for case in claim.cases
    ]
    done: dict[tuple[str, str], Result] = {}
    failed = None
    with stop_signals() as stopped:
        try:
            _do_all(console, work, done, jobs, stopped.is_set, engine)
        except pool.WorkFailed as error:
            failed = str(error)
    rows = list(complete(chosen, done))
    problems = files.attempt(partial(write, folder, rows, mode=engine))
    output().print(_table(rows))
    if into is not None and len(done) == len(work):
        problems += files.attempt(partial(report.put_into, into, report.markdown(rows)))
    if problems:
        forget(folder, "claims.md")
    for problem in problems:
        console.print(f"[red]not written:[/] {escape(in_words(problem))}", soft_wrap=True)
    console.print(f"results are in {escape(str(folder))}", soft_wrap=True)
    if failed is not None:
        console.print(
            f"[red]broken after {len(done)} of {len(work)} runs:[/] {escape(failed, lines=True)}",
            soft_wrap=True,
        )
        return RUN_BROKE
    if len(done) < len(work):
        console.print(f"interrupted after {len(done)} of {len(work)} runs")
        return INTERRUPTED
    if problems:
        return RUN_BROKE
    verdicts = {row.verdict for row in rows}
    if BROKEN in verdicts:
        return RUN_BROKE
    return ONE_FAILS if verdicts & {FAILS, NOT_JUDGED} else ALL_HOLD


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
    console: Console,
    work: Sequence[Work],
    done: dict[tuple[str, str], Result],
    jobs: int | None,
    stopped: pool.Stopped,
    engine: EngineName,
) -> None:
    """Put the results of all runs into ``done``, by the keys of claim and case."""
    if engine == "inline":  # the longest first, so that no core is left with a long one at the end
        longest_first = sorted(work, key=lambda item: -cost(item.case))
        found = pool.at_once(do, longest_first, stopped, jobs)
    else:  # every run has all cores
        found = pool.in_turn(do, work, stopped)
    for item, result in pool.shown(console, found, len(work), _label):
        if result.verdict.outcome.kind == "interrupted":
            return
        done[item.claim, item.case.name] = result
        if not result.as_expected:
            outcome = result.verdict.outcome
            how = f"{outcome.kind} {outcome.reason}".strip()
            for lost in result.verdict.robots.lost:
                how += f"; robot {lost.robot} was lost: {lost.reason}"
            word = "not judged" if result.undecided else "not as predicted"
            console.print(
                f"[red]{word}:[/] {_label(item)} ({escape(how)}), see " + escape(str(item.folder)),
                soft_wrap=True,
            )


def _label(item: Work) -> str:
    return f"{item.claim}, {item.case.name}"


def _table(rows: Sequence[Row]) -> Table:
    """The short form: what is said and should happen stands in claims.md."""
    table = Table(box=SIMPLE_HEAD, title="the paper's claims", title_justify="left")
    for column in ("claim", "in the paper", "verdict"):
        table.add_column(column)
    for column in ("runs", *(f"{row.reference} ({row.unit})" for row in ERRORS.values())):
        table.add_column(column, justify="right", no_wrap=True)
    for row in rows:
        told = row.verdict if row.verdict == HOLDS else row.happened
        table.add_row(
            row.claim.key,
            row.claim.where,
            f"[{_STYLES[row.verdict]}]{escape(told)}[/]",
            str(len(row.results)),
            *(report.number(row, claim) for claim in ERRORS),
        )
    return table
