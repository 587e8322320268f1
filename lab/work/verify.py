"""``formnet verify``: does a recorded run, run again, give the same bits?"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from formnet.agent.law_file import LawFile
from formnet.exact import ARITHMETIC_VERSION
from formnet.formation.briefing.resolving import resolve
from formnet.formation.records.stream import Record
from formnet.formation.scenario.loading import ScenarioError
from formnet.formation.scenario.model import Scenario
from formnet.lab.code.laws import Given, NoLaw, law_of
from formnet.lab.forecast.foresight import obstacle
from formnet.lab.launch.engine import EngineName, engine
from formnet.lab.launch.signals import stop_signals
from formnet.lab.runs.borrowed import borrowed
from formnet.lab.runs.difference import before, differences, other_extremes, without_gap
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT, BROKEN, INTERRUPTED, ONE_FAILS
from formnet.lab.runs.recording import Recording, trajectory_sha256
from formnet.lab.text.console import Console, escape
from formnet.lab.text.problems import report_problems, say_slow
from formnet.lab.text.progress import Waits
from formnet.lab.verdict.files import Unreadable, shown
from formnet.lab.verdict.model import Verdict
from formnet.lab.verdict.recorded import Recorded, read_whole
from formnet.netem.settings.timeline import NEVER


def verify_runs(folders: Sequence[Path], how: EngineName, law: str | None = None) -> int:
    """Repeat every run and compare; the exit code of ``formnet verify``, the gravest of all.

    ``law`` is the ``FILE:NAME`` of one that was code in a file.
    """
    console = Console(highlight=False)
    codes = []
    with stop_signals() as stopped:
        for folder in folders:
            if stopped.is_set():
                codes.append(INTERRUPTED)
                break
            try:
                codes.append(_verify(console, folder, stopped.is_set, how, law))
            except ScenarioError as error:
                report_problems(console, error)
                codes.append(BAD_INPUT)
            except Unreadable as error:
                console.print(
                    f"[red]{escape(str(folder))}:[/] {escape(str(error))}", soft_wrap=True
                )
                codes.append(BAD_INPUT)
    return max(codes)


def _verify(
    console: Console,
    folder: Path,
    stopped: Callable[[], bool],
    how: EngineName,
    named: str | None,
) -> int:
    recorded = read_whole(folder)
    judged = recorded.verdict
    assert judged is not None
    if judged.arithmetic != ARITHMETIC_VERSION:
        writer = shown(judged.versions.get("formnet"))
        raise Unreadable(
            f"its bits come from version {judged.arithmetic} of the arithmetic, and this formnet "
            f"has version {ARITHMETIC_VERSION}: formnet {writer} repeats it (in an environment of "
            f"its own: pip install 'formnet[lab]=={writer}')"
        )
    law = _law_of(recorded.scenario, named)
    problem = obstacle(recorded.scenario, partial(say_slow, console), law)
    if problem is not None:
        raise Unreadable(f"law.kind = {recorded.scenario.law.kind!r}: {problem}")
    if recorded.scenario.clock.mode == "realtime":
        raise Unreadable(
            'clock.mode = "realtime": a run in real time is not repeatable to the bit; '
            "its virtual twin does (--set clock.mode=lockstep)"
        )
    unplanned_s = judged.unplanned_s
    until_ns = NEVER if unplanned_s is None else round(unplanned_s * 1e9)
    samples = before(recorded.samples, until_ns)
    if not samples:
        raise Unreadable(
            "nothing to compare: no sample was recorded before something unplanned happened"
        )
    _check_end(recorded)
    last_ns, next_ns = without_gap(samples, recorded.scenario)
    console.print(
        f"[dim]{escape(str(folder))}: {samples[-1].t_ns / 1e9:g} s are repeated …[/]",
        soft_wrap=True,
    )
    with TemporaryDirectory(prefix="formnet-verify-") as scratch:
        again = Recording(Path(scratch) / "run", recorded.scenario)

        waits = Waits(console)

        def take(record: Record) -> None:
            again(record)
            waits.take(record)

        repeating = engine(how, again.folder / "logs", law)
        end_ns = min(until_ns, next_ns + 1)  # the next row is in no honest table
        outcome = repeating.run(resolve(again.scenario), take, stopped, end_ns)
        again.close()
    if stopped():
        return INTERRUPTED
    if again.now_ns() < last_ns:
        console.print(
            f"[red]{escape(str(folder))}:[/] could not be repeated: {outcome.kind}, "
            + escape(outcome.reason),
            soft_wrap=True,
        )
        return BROKEN
    found = differences(recorded, again, until_ns)
    whole = until_ns == NEVER
    if whole and found.motion is None and judged.motion is not None:
        found = found._replace(motion=other_extremes(judged.motion.model_dump(), again.motion))
    sealed = trajectory_sha256(recorded.samples) == judged.trajectory_sha256
    name = escape(str(folder))
    _say_borrowed(console, recorded.scenario.law.kind, law)
    _say_changed(console, judged, law)
    if found.identical and sealed:
        extent = (
            f": {len(samples)} samples, {len(recorded.link_rows)} messages"
            if whole
            else f" up to t = {until_ns / 1e9:g} s, where {_what_happened(judged, until_ns)}: "
            f"{len(samples)} of {len(recorded.samples)} samples"
        )
        console.print(f"{name}: [green]identical[/]{extent}", soft_wrap=True)
        if whole:
            console.print(f"  sha256 {judged.trajectory_sha256}", soft_wrap=True)
        return ALL_HOLD
    console.print(f"{name}: [red]differs[/]", soft_wrap=True)
    if not sealed:
        console.print(
            "  states.parquet does not match the SHA-256 in verdict.json: it was "
            "changed after the run",
            soft_wrap=True,
        )
    for what in found.in_words:
        console.print(f"  {escape(what)} (recorded, and repeated)", soft_wrap=True)
    for line in [] if found.identical else judged.other_versions():
        console.print(f"  {escape(line)}", soft_wrap=True)
    return ONE_FAILS


def _check_end(recorded: Recorded) -> None:
    """See that a completed run was recorded to its end. Raises Unreadable."""
    scenario, verdict = recorded.scenario, recorded.verdict
    assert verdict is not None
    end_ns, found_ns = scenario.ticks * scenario.clock.control_period_ns, recorded.now_ns()
    if verdict.outcome.kind == "completed" and found_ns != end_ns:
        raise Unreadable(
            f"it completed by verdict.json, and states.parquet ends at t = {found_ns / 1e9:g} s, "
            f"not at {end_ns / 1e9:g} s, where the scenario does"
        )


def _law_of(scenario: Scenario, named: str | None) -> LawFile | None:
    """The file of the law of a recorded run, if it was in one. Raises Unreadable."""
    if scenario.law.file is None:
        return None
    try:
        if named is None:
            raise NoLaw("was code in a file, which is in no run folder: --law FILE:NAME names it")
        return law_of(scenario.law, None, Given(named))
    except NoLaw as error:
        raise Unreadable(f"law.kind = {scenario.law.kind!r}: {error}") from None


def _say_changed(console: Console, judged: Verdict, law: LawFile | None) -> None:
    """Say that the file of a law is another now."""
    for name, recorded in judged.code.items():
        if law is not None and recorded != law.sha256:
            console.print(
                f"[yellow]{escape(name)} is not what was executed then:[/] its SHA-256 was "
                f"{recorded}, and that of {escape(law.path)} is {law.sha256}",
                soft_wrap=True,
            )


def _say_borrowed(console: Console, kind: str, law: LawFile | None) -> None:
    """Name a plug-in law whose bits are not formnet's to promise."""
    if names := borrowed(kind, law):
        console.print(
            f"[yellow]law.kind = {escape(repr(kind))} is a law that uses "
            f"{escape(', '.join(names))}:[/] its bits can depend on the processor and the versions "
            "of libraries; those of formnet.exact do not",
            soft_wrap=True,
        )


def _what_happened(judged: Verdict, at_ns: int) -> str:
    """What the scenario does not say, and is not compared."""
    outcome = judged.outcome
    if outcome.planned or round(outcome.t_s * 1e9) > at_ns:
        return "something unplanned happened"
    return f"the recorded run ended ({outcome.kind}; whether it ends so again is not checked)"
