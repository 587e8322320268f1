"""What lies in a folder of runs."""

import os
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from pydantic_core import from_json

from formnet.formation.records.outcome import Outcome
from formnet.lab.runs import files
from formnet.lab.runs.events_file import read_events
from formnet.lab.runs.files import as_text
from formnet.lab.runs.recording import being_written
from formnet.lab.verdict.files import Unreadable, read
from formnet.lab.verdict.model import FAILS, HOLDS, NOT_JUDGED, OBSERVED, Verdict

RUNNING, NO_END = "running", "did not end"
BAD = {FAILS, NOT_JUDGED, NO_END, "diverged", "lost", "failed", "broken", "unreadable"}
"""The standings in which something is wrong."""


_LONGEST = 200
"""How many characters of what is wrong with a file are told."""


class Entry(NamedTuple):
    """One folder among the runs.

    ``kind`` is ``run``, ``claims``, ``nemesis`` or ``broken``; ``when`` local time, ISO 8601;
    ``claims`` what was expected, and whether it holds (None: not judged); ``settled`` when its
    errors settled, in words (``never``); ``note`` says what
    there is to say of a folder that is no whole run, or which robots were lost.
    """

    folder: Path
    kind: str
    name: str
    when: str
    standing: str
    claims: dict[str, bool | None]
    settled_s: float | None = None
    simulated_s: float | None = None
    mode: str = ""
    sha256: str = ""
    note: str = ""
    settled: str = "–"

    @property
    def title(self) -> str:
        """The name of its folder as text."""
        return as_text(self.folder)

    @property
    def is_bad(self) -> bool:
        """Whether something is wrong."""
        return self.standing in BAD

    def as_json(self) -> dict[str, Any]:
        """For other programs."""
        return self._asdict() | {"folder": str(self.folder)}


def look_into(folder: Path) -> tuple[list[Entry], list[str]]:
    """What runs and results lie in ``folder``, newest first, and the names of other folders."""
    entries, others = [], []
    for place in sorted(place for place in folder.iterdir() if place.is_dir()):
        if place.is_symlink():
            others.append(f"{place.name} (a symbolic link, which is not followed)")
            continue
        try:
            entry = look_at(place)
        except OSError as error:  # not ours to look into, or gone meanwhile
            others.append(f"{place.name} ({error.strerror})")
            continue
        if entry is None:
            others.append(place.name)
        else:
            entries.append(entry)
    return sorted(entries, key=lambda entry: entry.when, reverse=True), others


def look_at(folder: Path) -> Entry | None:
    """What ``folder`` holds; None if nothing of formnet."""
    for kind, look in (("claims", _claims), ("nemesis", _nemesis)):
        file = folder / f"{kind}.json"
        if os.path.lexists(file):
            try:
                return look(folder, from_json(files.read_json(file)), _changed(file))
            except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
                reason = error.strerror if isinstance(error, OSError) else repr(error)[:_LONGEST]
                note = f"{file.name} cannot be read: {reason}"
                return Entry(
                    folder, "broken", folder.name, _changed(file), "unreadable", {}, note=note
                )
    if any(os.path.lexists(folder / name) for name in ("scenario.toml", "verdict.json")):
        return _run(folder)
    if files.is_folder(folder / "cases"):
        return Entry(
            folder, "claims", folder.name, _changed(folder), NO_END, {}, note="no claims.json (yet)"
        )
    return None


def standing(judged: Verdict | None, outcome: Outcome | None, *, running: bool) -> str:
    """How a run stands in a word: as it was judged, or else how it ended."""
    if judged is None:
        return RUNNING if running else NO_END if outcome is None else outcome.kind
    return judged.standing


def _run(folder: Path) -> Entry:
    running, when = being_written(folder), _began(folder)
    try:
        judged = read(folder)
    except Unreadable as error:
        missing = not os.path.lexists(folder / "verdict.json")
        how = standing(None, None, running=running) if missing else "unreadable"
        return Entry(
            folder,
            "run" if missing else "broken",
            folder.name,
            when,
            how,
            {},
            note="" if running else str(error),
        )
    return Entry(
        folder,
        "run",
        judged.scenario,
        when,
        judged.standing,
        judged.claimed,
        judged.settling_time_s,
        judged.outcome.t_s,
        judged.mode,
        judged.trajectory_sha256,
        _lost(judged),
        judged.settled,
    )


def _lost(judged: Verdict) -> str:
    robots = [str(item.robot) for item in judged.robots.lost]
    return f"lost robot {', '.join(robots)}" if robots else ""


def _claims(folder: Path, found: Any, when: str) -> Entry:
    verdicts = [claim["verdict"] for claim in found["claims"]]
    well = sum(verdict in (HOLDS, OBSERVED) for verdict in verdicts)
    how = HOLDS if well == len(verdicts) else FAILS
    note = f"{well} of {len(verdicts)} claims as predicted (claims.md)"
    return Entry(folder, "claims", folder.name, when, how, {}, mode=found["mode"], note=note)


def _nemesis(folder: Path, found: Any, when: str) -> Entry:
    well = sum(not trial["problems"] for trial in found)
    how = HOLDS if well == len(found) else FAILS
    return Entry(
        folder,
        "nemesis",
        folder.name,
        when,
        how,
        {},
        mode=found[0]["mode"] if found else "",
        note=f"{well} of {len(found)} runs well (nemesis.json)",
    )


def _began(folder: Path) -> str:
    try:
        began = datetime.fromisoformat(next(read_events(folder)).wall)
        return began.astimezone().isoformat(timespec="seconds")
    except (OSError, ValueError, OverflowError, StopIteration):
        return _changed(folder)


def _changed(place: Path) -> str:
    changed = datetime.fromtimestamp(place.lstat().st_mtime, UTC)
    return changed.astimezone().isoformat(timespec="seconds")


def in_words(claims: Mapping[str, bool | None]) -> str:
    """What was expected: its names if all holds, and else what does not."""
    failing = [name for name, holds in claims.items() if holds is False]
    unknown = [name for name, holds in claims.items() if holds is None]
    parts = [f"FAILS: {', '.join(failing)}"] if failing else []
    parts += [f"not judged: {', '.join(unknown)}"] if unknown else []
    return "; ".join(parts) or ", ".join(claims)
