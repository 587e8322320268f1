"""``formnet run``: load, launch, watch, judge, draw."""

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from formnet.agent.law import make
from formnet.formation.briefing.resolving import resolve
from formnet.formation.machines.hosts import Hosts
from formnet.formation.records.outcome import Outcome
from formnet.formation.scenario.loading import ScenarioError
from formnet.formation.scenario.model import Scenario
from formnet.lab.code.laws import NOTHING, Given, executed
from formnet.lab.forecast.checked import load_ready
from formnet.lab.judge import lyapunov
from formnet.lab.launch import live
from formnet.lab.launch.distributed import Distributed
from formnet.lab.launch.engine import Engine
from formnet.lab.launch.inline import Inline
from formnet.lab.launch.signals import stop_signals
from formnet.lab.machines.place import HERE, BadPlace, HostUnreachable, Where
from formnet.lab.runs import files
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT, BROKEN, INTERRUPTED, ONE_FAILS, in_words
from formnet.lab.runs.exits import of as code_of
from formnet.lab.runs.folders import check_free, claimed
from formnet.lab.runs.recording import Recording
from formnet.lab.scene.writer import SceneWriter
from formnet.lab.text.console import Console, escape
from formnet.lab.text.hosts import describe_hosts
from formnet.lab.text.links_table import links_table
from formnet.lab.text.problems import report_problems, say_slow, warn
from formnet.lab.text.progress import Watch
from formnet.lab.text.summary import claims_table, summarise
from formnet.lab.text.tables import output
from formnet.lab.verdict import files as verdict_files
from formnet.lab.verdict.model import judge


def run_scenario(
    path: Path,
    overrides: tuple[str, ...],
    out: Path | None,
    *,
    inline: bool,
    where: Where = HERE,
    view: str | None = None,
    drawn: bool = True,
    scene: bool = True,
    lookahead: bool = True,
    given: Given = NOTHING,
) -> int:
    """Run a scenario file into a run folder; returns the exit code of ``formnet run``.

    ``view``: let somebody watch, in a ``"window"`` or on the ``"web"``. ``drawn``: with figures.
    ``scene``: with ``run.rrd``; without, no process draws it. ``lookahead``: the law is tried
    before. ``given``: what the user says of the files that it names.
    """
    console = Console(stderr=True)
    try:
        if out is not None:
            check_free(out)  # before the work, not after it
        say = partial(say_slow, console)
        ready = load_ready(path, overrides, say, given=given, lookahead=lookahead)
        scenario, law, warnings = ready.scenario, ready.law, ready.warnings
    except ScenarioError as error:
        report_problems(console, error)
        return BAD_INPUT
    except OSError as error:
        return _unusable(console, error)
    if inline and scenario.clock.mode == "realtime":
        console.print(
            '[red]--inline:[/] needs virtual time, but clock.mode = "realtime": add '
            "--set clock.mode=lockstep, or omit --inline",
            soft_wrap=True,
        )
        return BAD_INPUT
    warn(console, warnings)
    try:
        hosts = None if inline else where.hosts(scenario)
    except BadPlace as error:
        console.print(f"[red]{escape(str(error), lines=True)}[/]", soft_wrap=True)
        return BAD_INPUT
    if hosts is not None and law is not None:
        console.print(
            f"[red]law.kind:[/] {escape(law.file)} is a file here, and robots on other machines "
            "have it not: install the law as a package there (docs/laws.md)",
            soft_wrap=True,
        )
        return BAD_INPUT
    _say_hosts(console, scenario, hosts, inline=inline)
    from formnet.lab.watch.watcher import Watcher

    with stop_signals() as stopped, ExitStack() as stack:
        try:
            recording = claimed(out, scenario.name, partial(Recording, scenario=scenario))
            shown = SceneWriter(recording.folder) if scene else None
        except OSError as error:
            return _unusable(console, error)
        if shown is not None:
            stack.callback(shown.leave)
        with (
            Watch(console, recording, None if shown is None else shown.take) as watch,
            where.place(hosts, watch.take, recording.now_ns) as place,
            ExitStack() as meanwhile,
        ):
            watcher = None
            if view is not None:
                watcher = Watcher(view, recording.folder, where, watch.say, where.private(hosts))
                stack.callback(watcher.close)

            def begun(endpoint: str, run: str) -> None:
                meanwhile.enter_context(live.noted(recording.folder, endpoint, run))
                if watcher is not None:
                    watcher.join(endpoint, run)

            def asked() -> bool:
                watch.refresh()
                return stopped.is_set()

            logs = recording.folder / "logs"
            engine: Engine = (
                Inline(logs, law or make) if inline else Distributed(logs, place, begun, law)
            )
            try:
                take = where.private(hosts).sink(watch.take)
                outcome = engine.run(resolve(scenario), take, asked)
            except HostUnreachable as error:
                watch.say(str(error))
                outcome = Outcome("broken", 0, None, error.recorded)
                watch.take(outcome)
            except OSError as error:
                outcome = Outcome("broken", recording.now_ns(), None, in_words(error))
                watch.take(outcome)
        how = {
            "mode": engine.name,
            "wall_s": watch.wall_s,
            "warnings": warnings,
            "code": executed(law),
        }
        code = _conclude(console, recording, shown, outcome, how, stopped.is_set, drawn=drawn)
        if watcher is not None:
            watcher.stay(stopped.is_set)
        return code


def _say_hosts(console: Console, scenario: Scenario, hosts: Hosts | None, *, inline: bool) -> None:
    """Say which hosts are used, before they are; or that the scenario's own are not."""
    if hosts is not None:
        for line in ["robots on other machines:", *describe_hosts(hosts)]:
            console.print(escape(line), soft_wrap=True)
    elif scenario.hosts is not None and not inline:
        console.print(
            "[yellow]\\[hosts] is not used, and all robots run on this machine:[/] "
            "add --hosts scenario to use it (formnet check shows what it would start, and where)",
            soft_wrap=True,
        )


def _unusable(console: Console, error: OSError) -> int:
    console.print(f"[red]--out:[/] {escape(in_words(error))}", soft_wrap=True)
    return code_of(error)


def _conclude(
    console: Console,
    recording: Recording,
    scene: SceneWriter | None,
    outcome: Outcome,
    how: dict[str, Any],
    stopped: Callable[[], bool],
    *,
    drawn: bool,
) -> int:
    """Save, judge (``how`` as for :func:`lab.verdict.model.judge`), print, draw; the exit code.

    What was recorded and its verdict come first, what shows them after that.
    """
    problems = recording.save()
    if scene is not None:
        scene.end(lyapunov.curve(recording))
    judged = judge(recording, **how)
    unjudged = files.attempt(lambda: verdict_files.save(judged, recording.folder))
    if problems or unjudged:  # the scene may have filled the disk
        if scene is not None:
            scene.make_room()
        problems = recording.save()
        if unjudged:
            problems += files.attempt(lambda: verdict_files.save(judged, recording.folder))
    rows = [(f"{link.source}→{link.destination}", link.model_dump()) for link in judged.links]
    page = output()
    page.print(links_table(rows, "all are in verdict.json"))
    page.print(claims_table(judged, recording.scenario))
    summarise(page, recording.scenario, judged)
    if scene is not None:
        problems += files.attempt(scene.close)
    if drawn and outcome.kind != "interrupted":  # who interrupts does not want to wait for figures
        with console.status("drawing figures"):
            from formnet.lab.figures import run_figures as figures

            def draw() -> None:
                place = files.subfolder(recording.folder, "figures", made=True)
                figures.draw(recording, place, stopped)

            problems += files.attempt(draw)
    from formnet.lab.pages import report

    try:
        left_out = report.leave(recording.folder)
        if left_out is not None:
            console.print(f"[yellow]no page:[/] {escape(left_out)}", soft_wrap=True)
    except OSError as error:
        problems.append(error)
    for problem in problems:
        console.print(f"[red]not written:[/] {escape(in_words(problem))}", soft_wrap=True)
    console.print(
        f"{'other ' * bool(problems)}results are in {escape(str(recording.folder))}",
        soft_wrap=True,
    )
    if problems:
        return BROKEN
    if outcome.kind == "interrupted" or stopped():
        return INTERRUPTED
    if outcome.kind not in ("completed", "diverged"):
        return BROKEN
    return ALL_HOLD if judged.passed else ONE_FAILS
