"""``events.jsonl``: a line for every event of a run and for how it ended, as they come.

``t_s`` is the run's time in seconds, ``event`` the event's name or the outcome's kind, then come
its own fields, then ``wall``, when it was written (ISO 8601, UTC). Lines are read strictly: a
file may come from anybody.
"""

import json
import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from formnet.formation.records.checked import Malformed, Robots
from formnet.formation.records.events import EVENTS as KNOWN
from formnet.formation.records.events import Event, event
from formnet.formation.records.outcome import OUTCOMES, Outcome, outcome
from formnet.lab.runs import files

EVENTS = "events.jsonl"
_MOST_S = 2**63 / 1e9
_ISO_8601 = re.compile(
    r"\d{4}-\d\d-\d\d(T\d\d:\d\d:\d\d(\.\d{3}(\d{3})?)?(Z|[+-]\d\d:\d\d)?)?", re.ASCII
)
"""As it is written; ``fromisoformat`` takes any character for the T."""
LONGEST_LINE, MOST_LINES = 2**20, 50_000
"""A line that is longer, and what comes after so many, is not read."""


class Line(NamedTuple):
    """What a line tells, and when it was written (ISO 8601)."""

    record: Event | Outcome
    wall: str


def written(record: Event | Outcome, wall: datetime) -> str:
    """A line of the file, with its end."""
    line = {
        "t_s": record.t_ns / 1e9,
        "event": record.name,
        **record.details,
        "wall": wall.isoformat(timespec="milliseconds"),
    }
    return json.dumps(line) + "\n"


def read_events(folder: Path, robots: Robots = None) -> Iterator[Line]:
    """What the file in a run's folder tells; a last line that was cut off is left out.

    ``robots`` are the ids that the scenario has; None: any will do.

    Raises:
        OSError: the file cannot be read.
        Malformed: a line is none; the text says which, and what is wrong.
    """
    with files.reading(folder / EVENTS) as lines:
        for number in range(1, MOST_LINES + 2):
            line = lines.readline(LONGEST_LINE + 1)
            if not line:
                return
            if len(line) > LONGEST_LINE:
                raise Malformed(f"line {number}: is longer than {LONGEST_LINE} bytes")
            if number > MOST_LINES:
                raise Malformed(f"line {number}: at most {MOST_LINES} lines are read")
            if not line.endswith(b"\n"):
                return
            try:
                yield parsed(line, robots)
            except Malformed as error:
                raise Malformed(f"line {number}: {error}") from None


def parsed(line: bytes, robots: Robots = None) -> Line:
    """What one line tells. Raises Malformed."""
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        raise Malformed.at("", line[:60], "is not JSON") from None
    if type(found) is not dict:
        raise Malformed.at("", found, "must be a table")
    t_s, name, wall = (found.pop(key, None) for key in ("t_s", "event", "wall"))
    if type(t_s) not in (int, float) or not 0 <= t_s < _MOST_S:
        raise Malformed.at("t_s", t_s, "must be a time in seconds")
    if type(wall) is not str or not _is_time(wall):
        raise Malformed.at("wall", wall, "must be a time such as 2026-01-31T12:00:00.000+00:00")
    t_ns = round(t_s * 1e9)
    # A robot that is lost is an event, which has its tick, or the end of a run.
    if name in OUTCOMES and (name not in KNOWN or "tick" not in found):
        return Line(outcome(name, t_ns, found, robots), wall)
    return Line(event(name, t_ns, found, robots), wall)


def _is_time(text: str) -> bool:
    if _ISO_8601.fullmatch(text) is None:
        return False
    try:
        datetime.fromisoformat(text)
    except ValueError:
        return False
    return True
