"""A run read back from its folder, as far as it is there."""

import json
from collections.abc import Iterator
from math import isfinite
from pathlib import Path
from typing import Any

from formnet.formation.scenario.loading import load
from formnet.formation.scenario.model import Scenario
from formnet.formation.wire.record import Event, Outcome
from formnet.lab.runs.recording import (
    LINKS,
    STATES,
    Collected,
    being_written,
    read_links,
    read_states,
)
from formnet.lab.runs.words import extremes_told
from formnet.lab.verdict import files
from formnet.lab.verdict.ending import KINDS
from formnet.lab.verdict.files import Unreadable
from formnet.lab.verdict.model import Verdict

_END = {"robot", "reason"}
"""What an outcome's line tells; a robot's loss is an event that tells its tick, too."""


class Recorded(Collected):
    """What a run's folder holds of it.

    ``verdict`` is None if there is none (yet). ``problems`` names what is missing or cannot be
    read, by file; a whole run has none. ``walls`` holds the wall time of every event (ISO 8601).
    """

    def __init__(self, folder: Path, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.folder = folder
        self.verdict: Verdict | None = None
        self.problems: list[str] = []
        self.walls: list[str] = []
        self.running = being_written(folder)


def not_a_folder(path: Path) -> str | None:
    """Why ``path`` is no folder, or None."""
    if path.is_dir():
        return None
    return "is a file; give the folder of a run" if path.exists() else "no such folder"


def read_run(folder: Path, *, tables: bool = True) -> Recorded:
    """What ``folder`` holds of a run, whole or not; without ``tables``, no states and no messages.

    Raises:
        Unreadable: there is no run.
        ScenarioError: its scenario is none, or one of another version.
    """
    if (problem := not_a_folder(folder)) is not None:
        raise Unreadable(problem)
    if not (folder / "scenario.toml").is_file():
        raise Unreadable("has no scenario.toml; formnet run leaves one")
    run = Recorded(folder, load(folder / "scenario.toml"))
    try:
        run.verdict = files.read(folder)
    except Unreadable as error:
        run.problems.append(str(error))
    try:
        _read_events(run)
    except FileNotFoundError:
        run.problems.append("has no events.jsonl")
    except (OSError, ValueError) as error:
        run.problems.append(f"events.jsonl cannot be read: {error}")
    if tables:
        run.problems += _read_tables(run)
    return run


def read_whole(folder: Path) -> Recorded:
    """:func:`read_run`, of a run of which nothing is missing.

    Raises:
        Unreadable: something is, or there is no run.
        ScenarioError: as there.
    """
    run = read_run(folder)
    if run.problems:
        raise Unreadable("; ".join(run.problems))
    return run


def event_lines(folder: Path) -> Iterator[dict[str, Any]]:
    """The lines of ``events.jsonl``; one that was cut off at the end is left out.

    Raises:
        OSError: the file cannot be read.
        ValueError: a line is no event.
    """
    with (folder / "events.jsonl").open(encoding="utf-8") as lines:
        for line in lines:
            if not line.endswith("\n"):
                return
            found = json.loads(line)
            if not _is_event(found):
                raise ValueError(f"no event: {line.strip()[:80]}")
            yield found


def _is_event(found: Any) -> bool:
    return (
        isinstance(found, dict)
        and isinstance(found.get("t_s"), int | float)
        and isfinite(found["t_s"])
        and isinstance(found.get("event"), str)
        and isinstance(found.get("wall"), str)
    )


def _read_tables(run: Recorded) -> list[str]:
    """Read states and messages; what is wrong with them."""
    missing = [name for name in (STATES, LINKS) if not (run.folder / name).is_file()]
    if missing:
        return [f"has no {name}" for name in missing]
    try:
        samples, run.link_rows = read_states(run.folder), read_links(run.folder)
    except (ValueError, KeyError, OSError) as error:  # pyarrow's errors are among them
        return [f"{STATES} or {LINKS} cannot be read: {error}"]
    if [sample.robot for sample in samples] != run.scenario.ids * (
        len(samples) // len(run.scenario.ids)
    ):
        return [f"{STATES} is not about the scenario's robots in their order"]
    run.samples = samples
    return []


def _read_events(run: Recorded) -> None:
    for line in event_lines(run.folder):
        t_ns, kind, wall = round(line.pop("t_s") * 1e9), line.pop("event"), line.pop("wall")
        if kind in KINDS and line.keys() == _END:
            run.outcome = Outcome(kind, t_ns, **line)
        elif kind == "lost" and not (
            line.get("robot") in run.scenario.ids and isinstance(line.get("tick"), int)
        ):
            raise ValueError(f"a loss without robot and tick: {line}")
        else:
            if kind == "extremes":
                extremes_told(line)
            run.events.append(Event(kind, t_ns, line))
            run.walls.append(wall)
