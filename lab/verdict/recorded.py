"""A run read back from its folder, as far as it is there."""

import os
from pathlib import Path

from formnet.formation.records.outcome import Outcome
from formnet.formation.scenario.loading import load
from formnet.formation.scenario.model import Scenario
from formnet.lab.runs import files as regular
from formnet.lab.runs.events_file import read_events
from formnet.lab.runs.recording import (
    LINKS,
    SCENARIO,
    STATES,
    Collected,
    being_written,
)
from formnet.lab.runs.tables import read_links, read_states
from formnet.lab.verdict import files
from formnet.lab.verdict.files import Unreadable
from formnet.lab.verdict.model import Verdict


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
    try:
        regular.reading(folder / SCENARIO).close()
    except FileNotFoundError:
        raise Unreadable("has no scenario.toml; formnet run leaves one") from None
    except OSError as error:
        raise Unreadable(f"{SCENARIO} cannot be read: {error.strerror}") from None
    run = Recorded(
        folder, load(folder / SCENARIO, follow=False).without_hosts
    )  # older ones have them
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


def _read_tables(run: Recorded) -> list[str]:
    """Read states and messages; what is wrong with them."""
    missing = [name for name in (STATES, LINKS) if not os.path.lexists(run.folder / name)]
    if missing:
        return [f"has no {name}" for name in missing]
    try:
        samples = read_states(run.folder, run.scenario)
        run.link_rows = read_links(run.folder, run.scenario)
    except (ValueError, OSError) as error:
        return [f"{STATES} or {LINKS} cannot be read: {error}"]
    run.samples = samples
    return []


def _read_events(run: Recorded) -> None:
    for record, wall in read_events(run.folder, run.scenario.vehicles):
        if isinstance(record, Outcome):
            run.outcome = record
        else:
            run.events.append(record)
            run.walls.append(wall)
