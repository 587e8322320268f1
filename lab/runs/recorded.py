"""A run read back from its folder, as far as it is there."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from formnet.formation.records.outcome import Outcome
from formnet.formation.scenario.loading import load
from formnet.formation.scenario.model import Scenario
from formnet.lab.runs.events_file import read_events
from formnet.lab.runs.recording import (
    LINKS,
    STATES,
    Collected,
    being_written,
    read_links,
    read_states,
)
from formnet.lab.runs.words import motion_told

_NEEDED = {
    "scenario",
    "mode",
    "outcome",
    "robots",
    "claims",
    "settling_time_s",
    "trajectory_sha256",
    "messages",
    "simulated_s",
    "wall_s",
    "formation_error_m",
    "heading_error_rad",
    "centroid_error_m",
}
"""What every verdict has that is used here."""


class Unreadable(ValueError):
    """A folder that holds no run, or not enough of one; the text says what is wrong with it."""


class Recorded(Collected):
    """What a run's folder holds of it.

    ``verdict`` is None if there is none (yet). ``problems`` names what is missing or cannot be
    read, by file; a whole run has none. ``walls`` holds the wall time of every event (ISO 8601).
    """

    def __init__(self, folder: Path, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.folder = folder
        self.verdict: Mapping[str, Any] | None = None
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
        run.verdict = read_verdict(folder)
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


def read_verdict(folder: Path) -> dict[str, Any]:
    """A run's verdict.

    Raises:
        Unreadable: there is none.
    """
    try:
        judged = json.loads((folder / "verdict.json").read_text(encoding="utf-8"))
        if missing := sorted(_NEEDED - judged.keys()):
            raise KeyError(*missing)
        judged["outcome"]["kind"], judged["outcome"]["t_s"], judged["robots"]["lost"]
        judged["messages"]["sent"], judged["messages"]["fates"].items()
        for claim in judged["claims"].values():
            claim["expected"], claim["holds"], claim["largest_in_window"]
        motion_told(judged)
    except FileNotFoundError:
        raise Unreadable("has no verdict.json") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise Unreadable(f"verdict.json is not a verdict: {error!r}") from None
    assert isinstance(judged, dict)
    return judged


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
    for record, wall in read_events(run.folder, run.scenario.vehicles):
        if isinstance(record, Outcome):
            run.outcome = record
        else:
            run.events.append(record)
            run.walls.append(wall)
