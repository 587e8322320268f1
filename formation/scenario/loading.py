"""Reading scenarios: TOML in, a validated :class:`Scenario` or every problem found out.

All problems of a file are reported together (the first of them, and how many more there are). To
check what refers to what even when some values are bad, each bad value is noted and then replaced
by a good one, so that the whole can still be built.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from formnet.formation.formats.migration import FormatError, migrate
from formnet.formation.scenario.model import Scenario
from formnet.formation.scenario.rules import broken_rules, too_long
from formnet.netem.files.from_file import Reading
from formnet.netem.files.overrides import OverrideError, Values, assign
from formnet.netem.files.problems import (
    MOST_SHOWN,
    Place,
    Problem,
    first_of,
    problems,
    shown,
)
from formnet.netem.files.toml import parse_toml, parse_value, read_toml

Overrides = Values | Iterable[str]
"""Values by key path, or texts ``key.path=value``."""


class ScenarioError(ValueError):
    """A scenario that cannot be run; ``problems`` holds what was found, beyond some its number."""

    def __init__(self, file: str, problems: Sequence[Problem]) -> None:
        self.file = file
        self.problems = list(problems)
        super().__init__("\n".join(f"{file}: {problem}" for problem in problems))


def load(
    path: Path,
    overrides: Overrides = (),
    *,
    follow: bool = True,
    allow_outside: bool = False,
) -> Scenario:
    """Read, override and validate a scenario file; one of an older format is migrated in memory.

    ``overrides`` are values by key path (``{"law.beta": 5.0}``), or ``key.path=value`` texts, the
    value in TOML syntax (a bare word is taken as a string); robots are addressed by id:
    ``robots.3.damping=1``. ``follow``: the file may be a symbolic link. The files that it names
    are looked for in its folder, and must lie below that unless ``allow_outside``.

    Raises:
        ScenarioError: with every problem, or the one that stopped the reading.
    """
    try:
        data = read_toml(path, follow=follow)
    except ValueError as error:
        raise _failure(str(path), str(error)) from None
    return _built(data, str(path), overrides, _files(path.parent, allow_outside))


def loads(
    text: str,
    file: str = "scenario",
    overrides: Overrides = (),
    folder: Path | None = None,
    *,
    allow_outside: bool = False,
) -> Scenario:
    """:func:`load` from text; ``file`` is what errors call it.

    Without ``folder``, to which the files that a scenario names are relative,
    it must name none: a scenario that came over the bus reads nothing here.
    """
    try:
        data = parse_toml(text)
    except ValueError as error:
        raise _failure(file, str(error)) from None
    context = {} if folder is None else _files(folder, allow_outside)
    return _built(data, file, overrides, context)


def from_tables(
    tables: Mapping[str, Any],
    overrides: Overrides = (),
    name: str = "scenario",
    *,
    allow_outside: bool = False,
) -> Scenario:
    """:func:`load` of tables that are in memory; ``name`` is what errors call them.

    A file that they name is looked for where the program runs, and must lie below that unless
    ``allow_outside``.
    """
    return _built(deepcopy(dict(tables)), name, overrides, _files(Path(), allow_outside))


def _files(folder: Path, allow_outside: bool) -> dict[str, Any]:
    """What :class:`netem.files.from_file.FromFile` is told of where files may lie."""
    return {"folder": folder, "allow_outside": allow_outside}


def _built(
    data: dict[str, Any], file: str, overrides: Overrides, context: dict[str, Any]
) -> Scenario:
    try:
        migrate(data)
    except FormatError as error:
        problem = Problem(error.place, shown(error.value), error.rule)
        raise ScenarioError(file, [problem]) from None
    bad = _put(data, overrides)
    if more := too_long(data):
        raise ScenarioError(file, bad + more)
    scenario, found = _validate(data, context)
    bad += found
    if scenario is not None:
        places = tuple(problem.place for problem in bad)
        broken = [
            problem
            for problem in broken_rules(scenario)
            if not any(place.startswith(problem.place) for place in places)  # a stand-in's fault
        ]
        bad += first_of(broken)
    if bad or scenario is None:
        raise ScenarioError(file, bad)
    return scenario


def dumps(scenario: Scenario) -> str:
    """The scenario as TOML, every default written out; loading it gives an equal scenario."""
    return tomli_w.dumps(scenario.model_dump(mode="json", by_alias=True, exclude_none=True))


def _failure(file: str, rule: str) -> ScenarioError:
    return ScenarioError(file, [Problem("", None, rule)])


# --- overrides -----------------------------------------------------------------------


def _put(data: dict[str, Any], overrides: Overrides) -> list[Problem]:
    """Put overrides into ``data``; returns what is wrong with them."""
    found = []
    items = overrides.items() if isinstance(overrides, Mapping) else map(_read, overrides)
    for item in items:
        if isinstance(item, Problem):
            found.append(item)
            continue
        path, value = item
        try:
            assign(data, path, value)
        except OverrideError as error:
            found.append(Problem(f"--set {error.place}", None, error.rule))
    return found


def _read(text: str) -> tuple[str, Any] | Problem:
    """One ``key.path=value``, or what is wrong with it."""
    path, equals, raw = text.partition("=")
    path = path.strip()
    if not equals or not all(path.split(".")):
        return Problem(f"--set {text}", None, "must read key.path=value, such as law.beta=5")
    try:
        return path, parse_value(raw)
    except ValueError as error:
        return Problem(f"--set {path}", shown(raw), str(error))


# --- validation ----------------------------------------------------------------------


def _validate(
    data: dict[str, Any], context: dict[str, Any]
) -> tuple[Scenario | None, list[Problem]]:
    """Build the scenario and say what is wrong with it.

    If something is, a copy is mended place by place until it can be built, so
    that the rules between values can be checked too. None if that fails, or
    more is wrong than is told.
    """
    try:
        return Scenario.model_validate(data, context=context | {"reading": Reading()}), []
    except ValidationError as error:
        found = [_with_id(data, problem) for problem in problems(Scenario, data, error)]
        if error.error_count() > MOST_SHOWN:
            return None, found
        errors = error.errors(include_url=False)
    data = deepcopy(data)
    for _ in range(5):  # a place inside a mended place may need another round
        for item in errors:
            _mend(data, item["loc"], missing=item["type"] == "missing")
        try:
            return Scenario.model_validate(data, context=context | {"reading": Reading()}), found
        except ValidationError as error:
            errors = error.errors(include_url=False)
    return None, found


def _with_id(data: dict[str, Any], problem: Problem) -> Problem:
    """A problem of ``robots[2]``, which counts from 0, says the robot's id, too."""
    found = re.match(r"robots\[(\d+)\]", problem.place)
    robot = data["robots"][int(found[1])] if found else None
    if not isinstance(robot, dict) or "id" not in robot:
        return problem
    return problem._replace(rule=f"{problem.rule} (robot {shown(robot['id'])})")


_STAND_INS: dict[str, Any] = {
    "name": "unnamed",
    "duration_s": 1.0,
    "formation": {"edges": []},
    "edges": [],
    "offset_m": [0.0, 0.0],
    "start": {"x_m": 0.0, "y_m": 0.0},
    "x_m": 0.0,
    "y_m": 0.0,
}
"""Valid values for required keys; a robot's id has none, and without it nothing refers well."""


def _mend(data: Any, loc: Place, *, missing: bool) -> None:
    """Put something valid at ``loc``, or take away what stands there."""
    table, key = None, ""  # the innermost table on the way, and the key in it
    for part in loc:
        if isinstance(data, dict) and isinstance(part, str):
            if part not in data and not missing:
                break  # a union's tag, or a place inside what was mended already
            table, key = data, part
            data = data.get(part)
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            if key != "edges" and not isinstance(data[part], dict):
                break
            if key == "edges":
                data[part] = [0, 0]
                return
            data = data[part]
        else:
            break
    if table is None:
        return
    if key in _STAND_INS:
        table[key] = deepcopy(_STAND_INS[key])
    else:
        table.pop(key, None)
