"""``formnet run``: load, launch, watch, judge, draw."""

import threading
import time
from contextlib import ExitStack
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Table

from formation.loading import ScenarioError, load
from formation.record import Event, Outcome, Record
from formation.scenario import Scenario
from lab import live, lyapunov, verdict
from lab.execution import execute
from lab.foresight import foresee
from lab.links_table import links_table, output
from lab.place import HERE, BadPlace, HostUnreachable, Where
from lab.recording import Recording, RunExists
from lab.signals import stop_signals
from lab.telling import named, told
from netem.problems import Problem

if TYPE_CHECKING:
    from lab.rrd import RunFile

ALL_HOLD, ONE_FAILS, BAD_INPUT, BROKEN, INTERRUPTED = 0, 1, 2, 3, 130

CLAIM_TITLES = {
    "formation": ("formation (Eq. 3)", "m"),
    "heading": ("heading (Eq. 4)", "rad"),
    "centroid": ("centroid (Eq. 5)", "m"),
    "lyapunov": ("V never rises", ""),  # by a share of V
}


def run_scenario(
    path: Path, overrides: tuple[str, ...], out: Path | None, *, inline: bool,
    where: Where = HERE, view: str | None = None, drawn: bool = True,
) -> int:  # fmt: skip
    """Run a scenario file into a run folder; returns the exit code of ``formnet run``.

    ``view``: let somebody watch, in a ``"window"`` or on the ``"web"``. ``drawn``: with figures.
    """
    console = Console(stderr=True)
    try:
        scenario, warnings = load_checked(path, overrides, console)
    except ScenarioError as error:
        report_problems(console, error)
        return BAD_INPUT
    if inline and scenario.clock.mode == "realtime":
        console.print(
            '[red]--inline:[/] is virtual time, and clock.mode = "realtime": add '
            "--set clock.mode=lockstep, or leave --inline out", soft_wrap=True,
        )  # fmt: skip
        return BAD_INPUT
    warn(console, warnings)
    try:
        hosts = None if inline else where.hosts(scenario)
    except BadPlace as error:
        console.print(f"[red]{escape(str(error))}[/]", soft_wrap=True)
        return BAD_INPUT
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    folder = out or Path("runs") / f"{scenario.name}-{stamp}"
    try:
        recording = Recording(folder, scenario)
    except (RunExists, OSError) as error:
        console.print(f"[red]--out:[/] {escape(str(error))}", soft_wrap=True)
        return BAD_INPUT
    mode = "inline" if inline else "distributed"
    from lab.rrd import RunFile  # loads Rerun, which other commands need not wait for
    from lab.watcher import Watcher

    with stop_signals() as stopped, ExitStack() as stack:
        scene = RunFile(folder, scenario)
        with (
            _Watch(console, recording, scene) as watch,
            where.place(hosts, watch.take, recording.now_ns) as place,
            ExitStack() as meanwhile,
        ):
            watcher = None
            if view is not None:
                watcher = Watcher(view, folder, where, watch.say)
                stack.callback(watcher.close)

            def begun(endpoint: str, run: str) -> None:
                meanwhile.enter_context(live.noted(folder, endpoint, run))
                if watcher is not None:
                    watcher.join(endpoint, run)

            try:
                outcome = execute(
                    recording, watch.take, stopped.is_set, watch.refresh, inline=inline,
                    place=place, begun=begun,
                )  # fmt: skip
            except HostUnreachable as error:
                outcome = Outcome("broken", 0, None, str(error))
                watch.take(outcome)
        how = {"mode": mode, "wall_s": watch.wall_s, "warnings": warnings}
        code = _conclude(console, recording, scene, outcome, how, drawn=drawn)
        if watcher is not None:
            watcher.stay(stopped.is_set)
        return code


def load_checked(
    path: Path, overrides: tuple[str, ...], console: Console
) -> tuple[Scenario, list[str]]:
    """Load a scenario, see that its law can be had, and what is to be feared.

    Raises:
        ScenarioError: with every problem found.
    """
    scenario = load(path, overrides)
    problem, warnings = foresee(scenario, partial(say_slow, console))
    if problem is not None:
        raise ScenarioError(str(path), [Problem("law.kind", repr(scenario.law.kind), problem)])
    return scenario, warnings


def say_slow(console: Console, text: str) -> None:
    """Print what takes long before a run."""
    console.print(f"[yellow]waiting:[/] {escape(text)}", soft_wrap=True)


class Waits:
    """Prints on whom a run waits: at the first complaint that is the same, and at each doubling."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._last: dict[str, Any] = {}
        self._times = 0

    def take(self, record: Record) -> None:
        """Print it, if ``record`` says so."""
        if not (isinstance(record, Event) and record.kind == "waiting"):
            return
        self._times = self._times + 1 if record.details == self._last else 1
        self._last = record.details
        if self._times & (self._times - 1) == 0:
            self._console.print(
                f"[yellow]waiting[/] at t = {record.t_ns / 1e9:.3f} s for "
                f"{named(record.details['robots'])} to "
                + escape(record.details["for"]), soft_wrap=True,
            )  # fmt: skip


def warn(console: Console, warnings: list[str]) -> None:
    """Print warnings, one a line."""
    for warning in warnings:
        console.print(f"[yellow]warning:[/] {escape(warning)}", soft_wrap=True)


def report_problems(console: Console, error: ScenarioError) -> None:
    """Print every problem of a scenario, one a line: file, key, value, rule."""
    for problem in error.problems:
        console.print(f"[red]{escape(error.file)}:[/] {escape(str(problem))}", soft_wrap=True)


def _conclude(
    console: Console, recording: Recording, scene: "RunFile", outcome: Outcome,
    how: dict[str, Any], *, drawn: bool,
) -> int:  # fmt: skip
    """Save, judge (``how``: see :func:`lab.verdict.of`), draw and print; returns the exit code."""
    recording.save()
    scene.close(lyapunov.curve(recording))
    judged = verdict.of(recording, **how)
    verdict.save(judged, recording.folder)
    rows = [(f"{link['source']}→{link['destination']}", link) for link in judged["links"]]
    page = output()
    page.print(links_table(rows, "all are in verdict.json"))
    page.print(_table(judged))
    _summarise(page, recording, judged)
    if drawn and outcome.kind != "interrupted":  # who interrupts does not want to wait for figures
        with console.status("drawing figures"):
            from lab import figures

            figures.draw(recording, recording.folder / "figures")
    from lab import report

    problem = report.leave(recording.folder)
    if problem is not None:
        console.print(f"[yellow]no page:[/] {escape(problem)}", soft_wrap=True)
    console.print(f"everything is in {escape(str(recording.folder))}", soft_wrap=True)
    if outcome.kind == "interrupted":
        return INTERRUPTED
    if outcome.kind not in ("completed", "diverged"):
        return BROKEN
    return ALL_HOLD if verdict.passed(judged) else ONE_FAILS


def _table(judged: dict[str, Any]) -> Table:
    table = Table(title=f"{judged['scenario']}: {escape(judged['why'])}", title_justify="left",
                  box=SIMPLE_HEAD, padding=(0, 1, 0, 0), caption_justify="left")  # fmt: skip
    if judged["claims"]["lyapunov"]["largest_in_window"] is not None:
        table.caption = "of V: the largest rise of the whole run, by its share of V"
    for column in ("claim", "expected", "observed", "largest at end", "tolerance", "verdict"):
        table.add_column(column, justify="left" if column == "claim" else "right", no_wrap=True)
    marks = {True: "[green]holds[/]", False: "[red]FAILS[/]", None: "[dim]not judged[/]"}
    words = {True: "yes", False: "no", None: "-"}
    for claim, entry in judged["claims"].items():
        title, unit = CLAIM_TITLES[claim]
        largest = entry["largest_in_window"]
        table.add_row(
            title,
            words[entry["expected"]],
            words[entry["observed"]],
            "-" if largest is None else f"{largest:.2e} {unit}",
            f"{entry['tolerance']:g} {unit}",
            "[dim]not claimed[/]" if entry["expected"] is None else marks[entry["holds"]],
        )
    return table


def timing_table(timing: dict[str, Any], sync_bound_s: float) -> Table:
    """How well a run in real time kept its time, by process."""
    table = Table(title="real time (p50, p99 in ms; all is in verdict.json)", title_justify="left",
                  box=SIMPLE_HEAD)  # fmt: skip
    for column in ("", "missed periods", "woke late", "sense→drive", "transit", "clock"):
        table.add_column(column, justify="right", no_wrap=True)

    def spread(found: dict[str, float] | None) -> str:
        return "-" if found is None else f"{1e3 * found['p50']:.2f} {1e3 * found['p99']:.2f}"

    table.add_row("plant", "", spread(timing["plant"]["woke_late_s"]))
    for robot, own in timing["robots"].items():
        bound_s = own["clock_uncertainty_s"]
        known = f"±{1e3 * bound_s:.2f}"
        table.add_row(
            f"robot {robot}", f"{own['missed']} of {own['periods']}", spread(own["woke_late_s"]),
            spread(own["sense_to_drive_s"]), spread(own["transit_s"]),
            known if bound_s <= sync_bound_s else f"[red]{known}[/]",
        )  # fmt: skip
    return table


def _summarise(console: Console, recording: Recording, judged: dict[str, Any]) -> None:
    outcome = judged["outcome"]
    if judged["motion"] is not None:
        console.print(told("extremes", judged["motion"]), soft_wrap=True)
    if outcome["kind"] != "completed":
        who = "" if outcome["robot"] is None else f" robot {outcome['robot']}:"
        console.print(
            f"[red]{outcome['kind']}[/] at t = {outcome['t_s']:.3f} s:{who} "
            + escape(outcome["reason"]), soft_wrap=True,
        )  # fmt: skip
    if outcome["kind"] == "diverged":
        for warning in judged["warnings"]:
            console.print(f"[yellow]it was warned:[/] {escape(warning)}", soft_wrap=True)
    if (rises := verdict.rises_in_words(judged)) is not None:
        console.print(escape(rises), soft_wrap=True)
    robots = judged["robots"]
    for lost in robots["lost"]:
        console.print(
            f"[red]lost[/] at t = {lost['t_s']:.3f} s: robot {lost['robot']}: "
            + escape(lost["reason"]), soft_wrap=True,
        )  # fmt: skip
    if not robots["judged"]:
        console.print("nobody is judged: every robot was down at the end")
    elif robots["down_at_the_end"]:
        console.print(f"judged without {named(robots['down_at_the_end'])}, down at the end")
    for item in judged["messages"]["rejected"]:
        console.print(
            f"[yellow]rejected:[/] robot {item['robot']} refused messages from "
            f"{item['source']}, {item['times']} ×: {escape(item['reason'])}"
        )
    for item in judged["messages"]["refused"]:
        console.print(
            f"[yellow]refused:[/] who has {item['who']}'s certificate was denied "
            f"{escape(item['key'])}, {item['times']} × or more", soft_wrap=True,
        )  # fmt: skip
    if judged["realtime"] is not None:
        console.print(timing_table(judged["realtime"], recording.scenario.clock.sync_bound_s))
    settled = judged["settling_time_s"]
    factor = judged["realtime_factor"] or 0.0
    console.print(
        ("" if settled is None else f"settled after {settled:.2f} s; ")
        + f"simulated {judged['simulated_s']:.1f} s in {judged['wall_s']:.1f} s "
        + f"({times(factor)} real time)"
    )
    console.print(f"sha256 of the trajectories: {judged['trajectory_sha256'][:16]}…")
    if outcome["kind"] in ("completed", "diverged"):
        console.print(_in_a_word(judged))


def _in_a_word(judged: dict[str, Any]) -> str:
    claims = verdict.claimed(judged)
    if not claims:
        trouble = "" if verdict.passed(judged) else ", but not all went well"
        return f"nothing was claimed{trouble}"
    if verdict.standing(judged) == verdict.HOLDS:
        return "[green]every claim holds[/]"
    titles = {
        word: [CLAIM_TITLES[name][0] for name, holds in claims.items() if holds is value]
        for word, value in ((verdict.FAILS, False), (verdict.NOT_JUDGED, None))
    }
    return "; ".join(f"[red]{word}:[/] {', '.join(some)}" for word, some in titles.items() if some)


def times(factor: float) -> str:
    """How many times as fast as real time."""
    return f"{factor:.2g} ×" if factor < 10.0 else f"{factor:.0f} ×"


class _Watch:
    """Shows a run while it goes on: progress, current errors, and events as they come."""

    def __init__(self, console: Console, recording: Recording, scene: "RunFile") -> None:
        self._console = console
        self._recording = recording
        self._scene = scene
        self._lock = threading.RLock()
        self._waits = Waits(console)
        self._started: float | None = None
        self._ended: float | None = None
        self._drawn = 0.0
        self._progress = Progress(
            BarColumn(bar_width=12), TextColumn("{task.description}"), console=console
        )
        self._task = self._progress.add_task("starting", total=recording.scenario.duration_s)

    def __enter__(self) -> "_Watch":
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._draw()
        self._progress.stop()

    @property
    def wall_s(self) -> float:
        """Seconds from the first tick to the last."""
        if self._started is None:
            return 0.0
        return (self._ended or time.monotonic()) - self._started

    def take(self, record: Record) -> None:
        """A sink in front of the recording, for any thread."""
        with self._lock:
            self._take(record)

    def say(self, text: str) -> None:
        """Say something to the user."""
        self._console.print(escape(text), soft_wrap=True)

    def _take(self, record: Record) -> None:
        self._recording(record)
        self._scene.take(record)
        if isinstance(record, Event):
            if record.kind == "started":
                self._started = time.monotonic()
                if not self._console.is_terminal:  # which sees the bar
                    self._console.print(f"started with {named(record.details['robots'])}")
            elif record.kind == "last tick":
                self._ended = time.monotonic()
            elif record.kind == "host lost":
                self._console.print(
                    f"[red]host lost:[/] {record.details['host']}, with "
                    f"{named(record.details['robots'])}: "
                    + escape(record.details["reason"]), soft_wrap=True,
                )  # fmt: skip
            elif record.kind == "silent at the end":
                self._console.print(
                    f"[yellow]silent at the end:[/] {named(record.details['robots'])}: what became "
                    "of messages since the last report is not known", soft_wrap=True,
                )  # fmt: skip
            self._waits.take(record)

    def refresh(self) -> None:
        """Redraw, at most ten times a second."""
        self._scene.refresh()
        if time.monotonic() - self._drawn >= 0.1:
            self._draw()

    def _draw(self) -> None:
        self._drawn = time.monotonic()
        latest = self._recording.latest()
        if self._started is None or not len(latest.t_s):
            return
        t_s = float(latest.t_s[-1])
        up = self._recording.up_at(int(latest.t_ns[-1]))
        found = verdict.error_series(self._recording.scenario, latest, up)
        speed = t_s / max(self.wall_s, 1e-9)
        errors = " ".join(
            f"{claim} {series[-1]:.1e}" for claim, series in verdict.by_claim(found).items()
        )
        self._progress.update(
            self._task, completed=t_s, description=f"t = {t_s:.1f} s  {times(speed)}  {errors}"
        )
