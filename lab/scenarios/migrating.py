"""A scenario's file in the current format, its comments and layout kept."""

import re
from pathlib import Path

import tomlkit

from formnet.formation.formats.migration import FORMAT, format_of, migrate
from formnet.formation.scenario.loading import ScenarioError, load, loads
from formnet.netem.files.problems import Problem
from formnet.netem.files.toml import text_of


def migrated(file: Path, *, follow: bool = True) -> tuple[str, list[str]]:
    """The text of ``file`` in the current format, and what was changed (nothing: it is current).

    Raises:
        ScenarioError: it is no valid scenario; every problem of it.
    """
    before = load(file, follow=follow, allow_outside=True)
    text = text_of(file, follow=follow).removeprefix("\ufeff")
    tables = tomlkit.parse(text)
    old = format_of(tables)
    if old == FORMAT:
        return text, []
    stated = "format" in tables
    changes = [f"format {old} -> {FORMAT}", *migrate(tables)]
    new = tomlkit.dumps(tables)
    if not stated:
        new = _with_first_key(new, f"format = {FORMAT}")
    again = loads(new, str(file), folder=file.parent, allow_outside=True)
    if again != before:  # never write what runs differently
        rule = "cannot be rewritten without changing what it says; please report it"
        raise ScenarioError(str(file), [Problem("", None, rule)])
    return new, changes


def _with_first_key(text: str, line: str) -> str:
    """``text`` with ``line`` after the comments that it begins with."""
    found = re.match(r"(?:[ \t]*(?:#[^\n]*)?\r?\n)*", text)
    place = found.end() if found else 0
    ending = "\r\n" if "\r\n" in text else "\n"
    return f"{text[:place]}{line}{ending}{text[place:]}"
