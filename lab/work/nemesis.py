"""``formnet nemesis``: random schedules against a scenario, and what fails made small."""

import json
import shlex
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from formnet.formation.scenario.loading import ScenarioError, dumps
from formnet.lab.code.laws import NOTHING, Given
from formnet.lab.forecast.checked import load_ready
from formnet.lab.launch import pool
from formnet.lab.launch.engine import EngineName
from formnet.lab.launch.signals import stop_signals
from formnet.lab.nemesis.schedule import describe, draw, scheduled
from formnet.lab.nemesis.smallest import MOST_SHRINKING_S, smallest
from formnet.lab.nemesis.trial import Finding, Trial, tried, unfit
from formnet.lab.runs import files
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT, BROKEN, INTERRUPTED, ONE_FAILS, in_words
from formnet.lab.runs.exits import of as code_of
from formnet.lab.runs.folders import claimed, forget, fresh_folder
from formnet.lab.text.console import Console, escape
from formnet.lab.text.problems import report_problems, say_slow, warn

SAMPLE_EVERY = 10
"""Of inline runs, every so many-th is run twice; every distributed one is run inline as well."""
CHAOS_SHARE = 0.25
"""The share of a run in which things go wrong; the rest is for recovery."""


def run_nemesis(
    path: Path,
    overrides: tuple[str, ...],
    runs: int,
    seed: int,
    out: Path | None,
    limit_s: float,
    jobs: int | None,
    engine: EngineName,
    given: Given = NOTHING,
) -> int:
    """Try ``runs`` schedules, of seeds ``seed`` and on; the exit code of the command."""
    console = Console(stderr=True, highlight=False)
    try:
        ready = load_ready(path, overrides, partial(say_slow, console), given=given)
    except ScenarioError as error:
        report_problems(console, error)
        return BAD_INPUT
    scenario = ready.scenario
    warn(console, ready.warnings)
    refused = unfit(scenario)
    if refused is not None:
        console.print(f"[red]{escape(str(path))}:[/] {escape(refused, lines=True)}", soft_wrap=True)
        return BAD_INPUT
    repeat = _repeat(path, overrides, given, limit_s, engine)
    try:
        folder = claimed(out, "nemesis", partial(_begun, command=f"{repeat} {seed}\n"))
    except OSError as error:
        console.print(f"[red]--out:[/] {escape(in_words(error))}", soft_wrap=True)
        return code_of(error)
    trials = [
        Trial(
            scenario,
            number,
            draw(scenario, number, CHAOS_SHARE * scenario.duration_s),
            engine,
            engine != "inline" or number % SAMPLE_EVERY == 0,
            limit_s,
            ready.law,
        )
        for number in range(seed, seed + runs)
    ]
    done: dict[int, Finding] = {}
    failed = None
    with stop_signals() as stopped:
        if engine == "inline":
            found = pool.at_once(tried, trials, stopped.is_set, jobs)
        else:  # every run has all cores
            found = pool.in_turn(tried, trials, stopped.is_set)
        try:
            for trial, finding in pool.shown(console, found, len(trials), "seed {0.seed}".format):
                if stopped.is_set():
                    break
                done[trial.seed] = finding
                if finding.problems:
                    _report(console, folder, trial, finding, repeat, stopped.is_set)
        except pool.WorkFailed as error:
            failed = str(error)
        except OSError as error:
            failed = in_words(error)
    _summarise(console, folder, trials, done)
    try:
        _write(folder, [(trial, done[trial.seed]) for trial in trials if trial.seed in done])
    except OSError as error:
        failed = failed or in_words(error)
    if failed is not None:
        console.print(
            f"[red]broken after {len(done)} of {runs} runs:[/] {escape(failed, lines=True)}",
            soft_wrap=True,
        )
        return BROKEN
    if len(done) < len(trials):
        return INTERRUPTED
    return ONE_FAILS if any(finding.problems for finding in done.values()) else ALL_HOLD


def _begun(folder: Path, command: str) -> Path:
    """A folder of results, with the command that makes them."""
    fresh_folder(folder, "command.txt")
    try:
        files.replace(folder / "command.txt", command)
    except OSError:
        forget(folder, "command.txt")
        raise
    return folder


def _repeat(
    path: Path, overrides: Sequence[str], given: Given, limit_s: float, engine: EngineName
) -> str:
    """The command that repeats one run, up to its seed."""
    words = ["formnet", "nemesis", str(path)]
    words += [word for text in overrides for word in ("--set", text)]
    words += ["--law", given.law] if given.law is not None else []
    words += ["--allow-code"] if given.allow_code else []
    words += ["--inline"] if engine == "inline" else []
    words += ["--allow-outside"] if given.allow_outside else []
    return shlex.join([*words, "--limit", f"{limit_s:g}", "--runs", "1", "--seed"])


def _report(
    console: Console,
    folder: Path,
    trial: Trial,
    finding: Finding,
    repeat: str,
    stopped: pool.Stopped,
) -> None:
    """Say what failed and how to repeat it, then shrink it and write that down."""
    console.print(f"[red]seed {trial.seed} fails:[/]")
    for problem in finding.problems:
        console.print(f"  {escape(problem)}", soft_wrap=True)
    console.print(f"  repeat it: {escape(repeat)} {trial.seed}", soft_wrap=True)
    console.print(
        f"  shrinking its {len(trial.episodes)} episodes, for {MOST_SHRINKING_S / 60:g} "
        "minutes at most …",
        soft_wrap=True,
    )
    least = smallest(trial, finding, stopped)
    place = folder / f"seed-{trial.seed}"
    place.mkdir()
    for name, episodes in (("drawn", trial.episodes), ("shrunk", least)):
        scenario = scheduled(trial.scenario, trial.seed, episodes)
        files.write_new(place / f"{name}.toml", dumps(scenario))
    lines = list(describe(least))
    text = "\n".join([*finding.problems, "", "shrunk to:", *lines])
    files.write_new(place / "problems.txt", text + "\n")
    console.print(
        f"  the shortest of its {len(trial.episodes)} episodes that still fails, "
        f"{escape(str(place / 'shrunk.toml'))}:",
        soft_wrap=True,
    )
    for line in lines or ["(none: it fails without episodes)"]:
        console.print(f"    {escape(line)}", soft_wrap=True)


def _write(folder: Path, done: Sequence[tuple[Trial, Finding]]) -> None:
    rows: list[dict[str, Any]] = [
        {
            "seed": trial.seed,
            "mode": trial.engine,
            "run_twice": trial.twice,
            "episodes": [episode.entries()[0] for episode in trial.episodes],
            **finding._asdict(),
        }
        for trial, finding in done
    ]
    text = json.dumps(rows, indent=1, ensure_ascii=False, allow_nan=False)
    files.write_new(folder / "nemesis.json", text + "\n")


def _summarise(
    console: Console, folder: Path, trials: Sequence[Trial], done: dict[int, Finding]
) -> None:
    tried_seeds = [trial for trial in trials if trial.seed in done]
    if tried_seeds:
        failed = [seed for seed, finding in sorted(done.items()) if finding.problems]
        kinds = Counter(e.action["action"] for trial in tried_seeds for e in trial.episodes)
        twice = sum(trial.twice for trial in tried_seeds)
        compared = f"; {twice} of them run twice and compared" if twice else ""
        told = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
        console.print(
            f"{len(tried_seeds)} runs, seeds {tried_seeds[0].seed} to {tried_seeds[-1].seed} "
            f"({told}){compared}: "
            + (
                f"[red]{len(failed)} fail[/]: seeds {', '.join(map(str, failed))}"
                if failed
                else "[green]all end, are consistent and recover[/]"
            ),
            soft_wrap=True,
        )
    console.print(f"results are in {escape(str(folder))}", soft_wrap=True)
