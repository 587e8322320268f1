"""``formnet list``: what lies in a folder of runs."""

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from formnet.formation.wire.record import Outcome
from formnet.lab.judge import verdict
from formnet.lab.judge.verdict import FAILS, HOLDS, NOT_JUDGED, OBSERVED
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT
from formnet.lab.runs.files import as_text
from formnet.lab.runs.recorded import Unreadable, event_lines, read_verdict
from formnet.lab.runs.recording import being_written
from formnet.lab.text.tables import Column, output, table

RUNNING, NO_END = "running", "did not end"
BAD = {FAILS, NOT_JUDGED, NO_END, "diverged", "lost", "failed", "broken", "unreadable"}
"""The standings in which something is wrong."""
_STYLES = {HOLDS: "green", RUNNING: "cyan", OBSERVED: "dim", "interrupted": "yellow"}

MOST_OTHERS = 10
"""How many folders that are none of formnet's are named."""


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


def list_runs(folder: Path, *, as_json: bool) -> int:
    """Print what lies in ``folder`` and make its index page; the exit code of the command."""
    console = Console(stderr=True, highlight=False)
    if not folder.is_dir():
        console.print(f"[red]{escape(str(folder))}:[/] is no folder; formnet run makes runs/ where "
                      "it is called", soft_wrap=True)  # fmt: skip
        return BAD_INPUT
    if (folder / "events.jsonl").exists():
        console.print(f"[red]{escape(str(folder))}:[/] is one run; give the folder that it is in",
                      soft_wrap=True)  # fmt: skip
        return BAD_INPUT
    entries, others = look_into(folder)
    if as_json:
        print(json.dumps([entry.as_json() for entry in entries], indent=2, ensure_ascii=False))
    elif entries:
        output().print(_table(entries))
    if others:
        more = f" and {len(others) - MOST_OTHERS} more" if len(others) > MOST_OTHERS else ""
        named = escape(", ".join(others[:MOST_OTHERS]))
        console.print(f"not of formnet: {named}{more}", soft_wrap=True)
    if not entries:
        console.print(f"no runs in {escape(str(folder))}", soft_wrap=True)
        return ALL_HOLD
    if folder.resolve().name != "runs":
        return ALL_HOLD  # its page would be a surprise
    from formnet.lab.pages.report import write_index

    problem = write_index(folder, entries)
    console.print(f"as a page: {escape(str(folder / 'index.html'))}" if problem is None
                  else f"[yellow]no index page:[/] {escape(problem)}", soft_wrap=True)  # fmt: skip
    return ALL_HOLD


def look_into(folder: Path) -> tuple[list[Entry], list[str]]:
    """What runs and results lie in ``folder``, newest first, and the names of other folders."""
    entries, others = [], []
    for place in sorted(place for place in folder.iterdir() if place.is_dir()):
        entry = look_at(place)
        if entry is None:
            others.append(place.name)
        else:
            entries.append(entry)
    return sorted(entries, key=lambda entry: entry.when, reverse=True), others


def look_at(folder: Path) -> Entry | None:
    """What ``folder`` holds; None if nothing of formnet."""
    for kind, look in (("claims", _claims), ("nemesis", _nemesis)):
        file = folder / f"{kind}.json"
        if file.is_file():
            try:
                return look(folder, json.loads(file.read_text(encoding="utf-8")), _changed(file))
            except (OSError, ValueError, KeyError, TypeError) as error:
                note = f"{file.name} cannot be read: {error!r}"
                return Entry(folder, "broken", folder.name, _changed(file), "unreadable", {},
                             note=note)  # fmt: skip
    if any((folder / name).is_file() for name in ("scenario.toml", "verdict.json")):
        return _run(folder)
    if (folder / "cases").is_dir():
        return Entry(folder, "claims", folder.name, _changed(folder), NO_END, {},
                     note="no claims.json (yet)")  # fmt: skip
    return None


def standing(judged: Mapping[str, Any] | None, outcome: Outcome | None, *, running: bool) -> str:
    """How a run stands in a word: as it was judged, or else how it ended."""
    if judged is None:
        return RUNNING if running else NO_END if outcome is None else outcome.kind
    return verdict.standing(judged)


def _run(folder: Path) -> Entry:
    running, when = being_written(folder), _began(folder)
    try:
        judged = read_verdict(folder)
    except Unreadable as error:
        missing = not (folder / "verdict.json").exists()
        how = standing(None, None, running=running) if missing else "unreadable"
        return Entry(folder, "run" if missing else "broken", folder.name, when, how, {},
                     note="" if running else str(error))  # fmt: skip
    return Entry(
        folder, "run", str(judged["scenario"]), when, verdict.standing(judged),
        verdict.claimed(judged), judged["settling_time_s"], judged["outcome"]["t_s"],
        str(judged["mode"]), str(judged["trajectory_sha256"]), _lost(judged),
        verdict.settled(judged),
    )  # fmt: skip


def _lost(judged: Mapping[str, Any]) -> str:
    robots = [str(item["robot"]) for item in judged["robots"]["lost"]]
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
    return Entry(folder, "nemesis", folder.name, when, how, {},
                 mode=found[0]["mode"] if found else "",
                 note=f"{well} of {len(found)} runs well (nemesis.json)")  # fmt: skip


def _began(folder: Path) -> str:
    try:
        began = datetime.fromisoformat(next(event_lines(folder))["wall"])
        return began.astimezone().isoformat(timespec="seconds")
    except (OSError, ValueError, TypeError, StopIteration):
        return _changed(folder)


def _changed(place: Path) -> str:
    changed = datetime.fromtimestamp(place.stat().st_mtime, UTC)
    return changed.astimezone().isoformat(timespec="seconds")


def _table(entries: list[Entry]) -> Table:
    columns = [
        Column("folder", left=True, wraps=output().is_terminal),
        Column("standing", left=True), Column("claims", 1, left=True, wraps=True),
        Column("settled", 3), Column("simulated", 4), Column("begun", 2, left=True),
    ]  # fmt: skip
    rows = []
    for entry in entries:
        style = _STYLES.get(entry.standing, "red")
        said = "; ".join(filter(None, (in_words(entry.claims), entry.note)))
        rows.append([
            escape(entry.title), f"[{style}]{escape(entry.standing)}[/]", escape(said),
            entry.settled, _seconds(entry.simulated_s),
            entry.when[:16].replace("T", " "),
        ])  # fmt: skip
    return table("", columns, rows, "--json has all", output().width)


def in_words(claims: Mapping[str, bool | None]) -> str:
    """What was expected: its names if all holds, and else what does not."""
    failing = [name for name, holds in claims.items() if holds is False]
    unknown = [name for name, holds in claims.items() if holds is None]
    parts = [f"FAILS: {', '.join(failing)}"] if failing else []
    parts += [f"not judged: {', '.join(unknown)}"] if unknown else []
    return "; ".join(parts) or ", ".join(claims)


def _seconds(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f} s"
