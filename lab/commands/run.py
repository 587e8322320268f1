"""``formnet run``: load, launch, watch, judge, draw."""

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from formnet.formation.paper.theory import of_the_paper
from formnet.formation.scenario.loading import ScenarioError, load
from formnet.formation.scenario.model import Scenario
from formnet.formation.wire.record import Outcome
from formnet.lab.forecast.foresight import foresee
from formnet.lab.judge import claim_words, lyapunov, verdict
from formnet.lab.launch import live
from formnet.lab.launch.execution import execute
from formnet.lab.launch.signals import stop_signals
from formnet.lab.machines.place import HERE, BadPlace, HostUnreachable, Where
from formnet.lab.runs import files
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT, BROKEN, INTERRUPTED, ONE_FAILS, in_words
from formnet.lab.runs.exits import of as code_of
from formnet.lab.runs.folders import check_free, claimed
from formnet.lab.runs.recording import Recording
from formnet.lab.runs.words import named, times, told
from formnet.lab.text.links_table import links_table
from formnet.lab.text.progress import Watch
from formnet.lab.text.tables import Column, output, table
from formnet.netem.files.problems import Problem

if TYPE_CHECKING:
    from formnet.lab.scene.rrd import RunFile


def run_scenario(
    path: Path, overrides: tuple[str, ...], out: Path | None, *, inline: bool,
    where: Where = HERE, view: str | None = None, drawn: bool = True,
) -> int:  # fmt: skip
    """Run a scenario file into a run folder; returns the exit code of ``formnet run``.

    ``view``: let somebody watch, in a ``"window"`` or on the ``"web"``. ``drawn``: with figures.
    """
    console = Console(stderr=True)
    try:
        if out is not None:
            check_free(out)  # before the work, not after it
        scenario, warnings = load_checked(path, overrides, console)
    except ScenarioError as error:
        report_problems(console, error)
        return BAD_INPUT
    except OSError as error:
        return _unusable(console, error)
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
    mode = "inline" if inline else "distributed"
    from formnet.lab.scene.rrd import RunFile  # loads Rerun, which other commands need not wait for
    from formnet.lab.watch.watcher import Watcher

    with stop_signals() as stopped, ExitStack() as stack:
        try:
            recording = claimed(out, scenario.name, partial(Recording, scenario=scenario))
            scene = RunFile(recording.folder, scenario)
        except OSError as error:
            return _unusable(console, error)
        stack.callback(scene.leave)
        with (
            Watch(console, recording, scene) as watch,
            where.place(hosts, watch.take, recording.now_ns) as place,
            ExitStack() as meanwhile,
        ):
            watcher = None
            if view is not None:
                watcher = Watcher(view, recording.folder, where, watch.say)
                stack.callback(watcher.close)

            def begun(endpoint: str, run: str) -> None:
                meanwhile.enter_context(live.noted(recording.folder, endpoint, run))
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
            except OSError as error:
                outcome = Outcome("broken", recording.now_ns(), None, in_words(error))
                watch.take(outcome)
        how = {"mode": mode, "wall_s": watch.wall_s, "warnings": warnings}
        code = _conclude(console, recording, scene, outcome, how, stopped.is_set, drawn=drawn)
        if watcher is not None:
            watcher.stay(stopped.is_set)
        return code


def _unusable(console: Console, error: OSError) -> int:
    console.print(f"[red]--out:[/] {escape(in_words(error))}", soft_wrap=True)
    return code_of(error)


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
    how: dict[str, Any], stopped: Callable[[], bool], *, drawn: bool,
) -> int:  # fmt: skip
    """Save, judge (``how`` as for :func:`lab.judge.verdict.of`), print, draw; the exit code.

    What was recorded and its verdict come first, what shows them after that.
    """
    problems = recording.save()
    judged = verdict.of(recording, **how)
    unjudged = files.attempt(lambda: verdict.save(judged, recording.folder))
    if problems or unjudged:  # the scene may have filled the disk
        scene.make_room()
        problems = recording.save()
        if unjudged:
            problems += files.attempt(lambda: verdict.save(judged, recording.folder))
    rows = [(f"{link['source']}→{link['destination']}", link) for link in judged["links"]]
    page = output()
    page.print(links_table(rows, "all are in verdict.json"))
    page.print(_table(judged, recording.scenario))
    _summarise(page, recording, judged)
    problems += files.attempt(lambda: scene.close(lyapunov.curve(recording)))
    if drawn and outcome.kind != "interrupted":  # who interrupts does not want to wait for figures
        with console.status("drawing figures"):
            from formnet.lab.figures import run_figures as figures

            place = recording.folder / "figures"
            problems += files.attempt(lambda: figures.draw(recording, place, stopped))
    from formnet.lab.pages import report

    try:
        left_out = report.leave(recording.folder)
        if left_out is not None:
            console.print(f"[yellow]no page:[/] {escape(left_out)}", soft_wrap=True)
    except OSError as error:
        problems.append(error)
    for problem in problems:
        console.print(f"[red]not written:[/] {escape(in_words(problem))}", soft_wrap=True)
    console.print(f"everything{' else' * bool(problems)} is in {escape(str(recording.folder))}",
                  soft_wrap=True)  # fmt: skip
    if problems:
        return BROKEN
    if outcome.kind == "interrupted" or stopped():
        return INTERRUPTED
    if outcome.kind not in ("completed", "diverged"):
        return BROKEN
    return ALL_HOLD if verdict.passed(judged) else ONE_FAILS


def _table(judged: dict[str, Any], scenario: Scenario) -> Table:
    marks = {True: "[green]holds[/]", False: "[red]FAILS[/]", None: "[dim]not judged[/]"}
    words = {True: "yes", False: "no", None: "-"}
    titles = claim_words.titles(scenario)
    columns = [
        Column("claim", left=True), Column("expected", 3), Column("observed", 4),
        Column("largest at end", 1), Column("tolerance", 2), Column("verdict"),
    ]  # fmt: skip
    rows = []
    for claim, entry in claim_words.told(judged).items():
        unit = claim_words.UNITS[claim]
        largest = entry["largest_in_window"]
        rows.append([
            titles[claim], words[entry["expected"]], words[entry["observed"]],
            "-" if largest is None else f"{largest:.2e} {unit}", f"{entry['tolerance']:g} {unit}",
            "[dim]not claimed[/]" if entry["expected"] is None else marks[entry["holds"]],
        ])  # fmt: skip
    why = f": {escape(judged['why'])}" if of_the_paper(scenario) else ""
    title = f"{judged['scenario']}{why}"
    made = table(title, columns, rows, "verdict.json has all", output().width)
    if judged["claims"]["lyapunov"]["largest_in_window"] is not None:
        said = "of V: the largest rise of the whole run, by its share of V"
        made.caption = f"{made.caption}\n{said}" if made.caption else said
    return made


def timing_table(timing: dict[str, Any], sync_bound_s: float) -> Table:
    """How well a run in real time kept its time, by process."""
    columns = [
        Column(""), Column("missed periods"), Column("woke late", 3), Column("sense→drive", 1),
        Column("transit", 4), Column("clock", 2),
    ]  # fmt: skip

    def spread(found: dict[str, float] | None) -> str:
        return "-" if found is None else f"{1e3 * found['p50']:.2f} {1e3 * found['p99']:.2f}"

    rows = [["plant", "", spread(timing["plant"]["woke_late_s"]), "", "", ""]]
    for robot, own in timing["robots"].items():
        bound_s = own["clock_uncertainty_s"]
        known = f"±{1e3 * bound_s:.2f}"
        rows.append([
            f"robot {robot}", f"{own['missed']} of {own['periods']}", spread(own["woke_late_s"]),
            spread(own["sense_to_drive_s"]), spread(own["transit_s"]),
            known if bound_s <= sync_bound_s else f"[red]{known}[/]",
        ])  # fmt: skip
    where = "verdict.json has all"
    return table(f"real time (p50, p99 in ms; {where})", columns, rows, where, output().width)


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
    factor = judged["realtime_factor"] or 0.0
    settled = {"never": "it never settled; ", "–": ""}.get(
        at := verdict.settled(judged), f"settled after {at}; "
    )
    console.print(
        f"{settled}simulated {judged['simulated_s']:.1f} s in {judged['wall_s']:.1f} s "
        f"({times(factor)} real time)"
    )
    console.print(f"sha256 of the trajectories: {judged['trajectory_sha256'][:16]}…")
    if outcome["kind"] in ("completed", "diverged"):
        console.print(_in_a_word(judged, claim_words.titles(recording.scenario)))


def _in_a_word(judged: dict[str, Any], titles: dict[str, str]) -> str:
    claims = verdict.claimed(judged)
    if not claims:
        trouble = "" if verdict.passed(judged) else ", but not all went well"
        return f"nothing was claimed{trouble}"
    if verdict.standing(judged) == verdict.HOLDS:
        return "[green]every claim holds[/]"
    found = {
        word: [titles[name] for name, holds in claims.items() if holds is value]
        for word, value in ((verdict.FAILS, False), (verdict.NOT_JUDGED, None))
    }
    return "; ".join(f"[red]{word}:[/] {', '.join(some)}" for word, some in found.items() if some)
