"""``verdict.json``: written whole or not at all, and read back from folders of unknown origin.

The format is the file's first key. Format 2 is what is written. Format 1 has no such key; the
first of its files lack what was added to verdicts later, for which there is a neutral value. Both
must then be what :class:`lab.verdict.model.Verdict` says.
"""

import json
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import from_json

from formnet.formation.scenario.graph import MOST_EDGES
from formnet.formation.scenario.model import MOST_ROBOTS
from formnet.lab.runs import files
from formnet.lab.verdict.model import FORMAT, Verdict
from formnet.netem.files.printable import printable
from formnet.netem.files.problems import problems

FILE = "verdict.json"
MOST_KEYS, MOST_ITEMS = MOST_ROBOTS, 2 * MOST_EDGES
"""Of an object (timing by robot is the longest) and of a list (both directions of every edge)."""
_SHOWN = 3
"""How many of a file's problems are named."""


class Unreadable(ValueError):
    """A folder that holds no run, or not enough of one; the text says what is wrong with it."""


def save(verdict: Verdict, folder: Path) -> None:
    """Write ``verdict.json`` into ``folder``. Raises OSError."""
    files.replace(folder / FILE, text(verdict))


def text(verdict: Verdict) -> str:
    """A verdict as it stands in its file."""
    data = verdict.model_dump(mode="json")
    return json.dumps(data, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def read(folder: Path) -> Verdict:
    """A run's verdict.

    Raises:
        Unreadable: there is none, it is too long, or not of a format that can be read.
    """
    try:
        content = files.read_json(folder / FILE)
    except FileNotFoundError:
        raise Unreadable(f"has no {FILE}") from None
    except OSError as error:
        raise Unreadable(f"{FILE} cannot be read: {error.strerror}") from None
    return _verdict(content)


def _verdict(content: bytes) -> Verdict:
    """The verdict of a file that says this. Raises Unreadable."""
    try:
        data = from_json(content, allow_inf_nan=False)
    except ValueError as error:
        raise Unreadable(f"{FILE} is not a verdict: not JSON: {error}") from None
    if not isinstance(data, dict):
        raise Unreadable(f"{FILE} is not a verdict: must be an object")
    _check_lengths(data)
    number = data.get("format", 1)
    if type(number) is not int or not 1 <= number <= FORMAT:
        raise Unreadable(
            f"{FILE} is of format {shown(number)}, written by formnet {_writer(data)}; "
            f"this formnet reads formats 1 to {FORMAT}"
        )
    converted = _from_1(data) if number == 1 else data
    try:
        return Verdict.model_validate(converted)
    except ValidationError as error:
        found = problems(Verdict, converted, error, _SHOWN)
        raise Unreadable(
            f"{FILE} is not a verdict of format {number} (written by formnet {_writer(data)}): "
            + "; ".join(shown(str(problem), 200) for problem in found)
        ) from None


def _check_lengths(data: dict[str, Any]) -> None:
    """Raises Unreadable: there is a list or an object that no run has, each item of which may be
    wrong."""
    left: list[Any] = [data]
    while left:
        some = left.pop()
        if isinstance(some, dict):
            if len(some) > MOST_KEYS:
                raise Unreadable(f"{FILE} has an object of {len(some)} keys; at most {MOST_KEYS}")
            left.extend(some.values())
        elif isinstance(some, list):
            if len(some) > MOST_ITEMS:
                raise Unreadable(f"{FILE} has a list of {len(some)} items; at most {MOST_ITEMS}")
            left.extend(some)


def _from_1(data: dict[str, Any]) -> dict[str, Any]:
    """Format 1 as format 2: with what its first files lack."""
    messages = data.get("messages")
    if isinstance(messages, dict):
        messages = {"refused": [], **messages}
    lacking: dict[str, Any] = {"warnings": [], "motion": None, "arithmetic": 1}
    return {**lacking, **data, "messages": messages, "format": FORMAT}


def _writer(data: dict[str, Any]) -> str:
    """The version of formnet that wrote a file, as far as it says so."""
    versions = data.get("versions")
    found = versions.get("formnet") if isinstance(versions, dict) else None
    return shown(found) if isinstance(found, str) else "of an unknown version"


def shown(value: object, longest: int = 40) -> str:
    """What a file says, fit for a line: printable, and not too long."""
    return printable(str(value)[:longest]) + "…" * (len(str(value)) > longest)
