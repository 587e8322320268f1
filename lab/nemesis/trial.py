"""One run under a schedule: what is wrong with it, if anything."""

import shutil
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import mkdtemp
from typing import NamedTuple

from formnet.agent.law_file import LawFile
from formnet.formation.briefing.resolving import resolve
from formnet.formation.scenario.expect import ERRORS
from formnet.formation.scenario.model import Scenario
from formnet.lab.launch.engine import EngineName, engine
from formnet.lab.launch.pool import Stopped
from formnet.lab.nemesis.consistency import inconsistencies
from formnet.lab.nemesis.schedule import Episode, scheduled
from formnet.lab.runs.difference import differences
from formnet.lab.runs.recording import Collected, Recording, trajectory_sha256
from formnet.lab.verdict.model import Verdict, judge
from formnet.lab.verdict.traffic import rejections


class Trial(NamedTuple):
    """A run to do. ``twice``: it is run once more, in one process, and must give the same.

    ``limit_s`` is how long it may take on the wall, ``law`` a file whose law robots have.
    """

    scenario: Scenario
    seed: int
    episodes: Sequence[Episode]
    engine: EngineName
    twice: bool
    limit_s: float
    law: LawFile | None = None


class Finding(NamedTuple):
    """How a run ended: ``problems`` in words, none if all is well."""

    problems: list[str]
    trajectory_sha256: str
    errors: dict[str, float | None]
    seconds: float

    @property
    def kinds(self) -> frozenset[str]:
        """What the problems are, without what they say of this one run."""
        return frozenset(problem.partition(":")[0] for problem in self.problems)


def unfit(scenario: Scenario) -> str | None:
    """Why a scenario is none for the nemesis, or None."""
    if scenario.clock.mode == "realtime":
        return 'clock.mode = "realtime": must be "lockstep", in which runs repeat to the bit'
    if scenario.timeline:
        return "timeline: must be empty: the nemesis makes its own (--set timeline=[])"
    if scenario.run.on_unscheduled_loss == "abort":
        return 'run.on_unscheduled_loss = "abort": must be "continue", or one loss ends a run'
    if not scenario.directed_links:
        return "formation.edges = []: needs an edge: links fail, too"
    expect = scenario.expect
    if expect is None or not any(expect.claims[name] for name in ERRORS):
        *names, last = ERRORS
        return f"expect: must claim {', '.join(names)} or {last}, to define recovery"
    return None


def tried(trial: Trial, stopped: Stopped) -> Finding:
    """Do the run, twice if asked, and see whether all is well."""
    began = time.monotonic()
    scenario = scheduled(trial.scenario, trial.seed, trial.episodes)
    run = _run(trial, scenario, stopped, trial.engine)
    problems = list(_problems(run, trial.limit_s))
    if trial.twice and not problems:
        again = _run(trial, scenario, stopped, "inline")
        problems += _differences(run, again)
    judged = judge(run, mode=trial.engine, wall_s=0.0)
    errors = {name: judged.claims[name].largest_in_window for name in ERRORS}
    if not problems:
        problems += _not_recovered(judged)
    seconds = time.monotonic() - began
    return Finding(problems, trajectory_sha256(run.samples), errors, seconds)


def _run(trial: Trial, scenario: Scenario, stopped: Stopped, how: EngineName) -> Collected:
    deadline = time.monotonic() + trial.limit_s

    def over() -> bool:
        return stopped() or time.monotonic() > deadline

    folder = Path(mkdtemp(prefix="formnet-nemesis-"))
    try:
        recording = Recording(folder / "run", scenario)
        engine(how, folder / "logs", trial.law).run(resolve(scenario), recording, over)
        recording.close()
    finally:
        shutil.rmtree(folder)
    return recording


def _problems(run: Collected, limit_s: float) -> list[str]:
    outcome = run.outcome
    assert outcome is not None
    if outcome.kind == "interrupted":
        return [f"did not end: within {limit_s:g} s it came to t = {outcome.t_ns / 1e9:.3f} s"]
    if outcome.kind != "completed":
        who = "" if outcome.robot is None else f"robot {outcome.robot}, "
        at = f"at t = {outcome.t_ns / 1e9:.3f} s"
        return [f"ended as {outcome.kind}: {who}{at}: {outcome.reason}"]
    return list(inconsistencies(run))


def _differences(first: Collected, second: Collected) -> list[str]:
    """What differs between two runs of one scenario that must be the same."""
    problems = [f"not deterministic: {what}" for what in differences(first, second).in_words]
    refused = [rejections(run.events) for run in (first, second)]
    if refused[0] != refused[1]:
        problems.append(f"not deterministic: rejected messages {refused[0]} and {refused[1]}")
    return problems


def _not_recovered(judged: Verdict) -> list[str]:
    return [
        f"does not converge after the healing, {name}: "
        f"{claim.largest_in_window} in the last {judged.window_s:g} s, "
        f"tolerance {claim.tolerance:g}"
        for name, claim in judged.claims.items()
        if name in ERRORS and claim.expected and not claim.observed
    ]
