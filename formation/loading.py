"""Reading scenarios: TOML in, a validated :class:`Scenario` or every problem found out.

All problems of a file are reported together. To check what refers to what even
when some values are bad, each bad value is noted and then replaced by a good
one, so that the whole can still be built.
"""

import re
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from formation.fault import FaultAction, FaultError, spans_of
from formation.scenario import Scenario
from formation.selectors import named
from netem.problems import Place, Problem, problems, shown
from netem.settings import SettingError
from netem.tables import nanoseconds, read_toml
from netem.timeline import NEVER


class ScenarioError(ValueError):
    """A scenario that cannot be run; ``problems`` holds everything found."""

    def __init__(self, file: str, problems: Sequence[Problem]) -> None:
        self.file = file
        self.problems = list(problems)
        super().__init__("\n".join(f"{file}: {problem}" for problem in problems))


def load(path: Path, overrides: Iterable[str] = ()) -> Scenario:
    """Read, override and validate a scenario file.

    ``overrides`` are ``key.path=value`` texts, the value in TOML syntax (a bare
    word is taken as a string); robots are addressed by id: ``robots.3.damping=1``.

    Raises:
        ScenarioError: with every problem, or the one that stopped the reading.
    """
    try:
        data = read_toml(path)
    except ValueError as error:
        raise _failure(str(path), str(error)) from None
    return _built(data, str(path), overrides, path.parent)


def loads(
    text: str,
    file: str = "scenario",
    overrides: Iterable[str] = (),
    folder: Path | None = None,
) -> Scenario:
    """:func:`load` from text; ``file`` is what errors call it.

    Without ``folder``, to which the files that a scenario names are relative,
    it must name none: a scenario that came over the bus reads nothing here.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise _failure(file, f"not TOML: {error}") from None
    return _built(data, file, overrides, folder)


def _built(
    data: dict[str, Any], file: str, overrides: Iterable[str], folder: Path | None
) -> Scenario:
    bad = [problem for text in overrides if (problem := _override(data, text))]
    scenario, found = _validate(data, folder)
    bad += found
    if scenario is not None:
        places = tuple(problem.place for problem in bad)
        bad += [
            problem
            for problem in _cross_check(scenario)
            if not any(place.startswith(problem.place) for place in places)  # a stand-in's fault
        ]
    if bad or scenario is None:
        raise ScenarioError(file, bad)
    return scenario


def dumps(scenario: Scenario) -> str:
    """The scenario as TOML, every default written out; loading it gives an equal scenario."""
    return tomli_w.dumps(scenario.model_dump(mode="json", by_alias=True, exclude_none=True))


def _failure(file: str, rule: str) -> ScenarioError:
    return ScenarioError(file, [Problem("file", None, rule)])


# --- overrides -----------------------------------------------------------------------


def _override(data: dict[str, Any], text: str) -> Problem | None:
    """Apply one ``key.path=value``; returns what is wrong with it, if anything."""
    path, equals, raw = text.partition("=")
    keys = path.strip().split(".")
    if not equals or not all(keys):
        return Problem(f"--set {text}", None, "must read key.path=value, such as law.beta=5")
    try:
        value = tomllib.loads(f"value = {raw}")["value"]
    except tomllib.TOMLDecodeError:
        value = raw.strip()
    here: Any = data
    for depth, key in enumerate(keys):
        last = depth == len(keys) - 1
        place = ".".join(keys[: depth + 1])
        if isinstance(here, list):
            known = _keys_of(here)
            if not key.isdigit() or int(key) not in known:
                rule = f"there is no {key!r} in this list (there: {', '.join(map(str, known))})"
                return Problem(f"--set {place}", None, rule)
            index = known.index(int(key))
            if last:
                here[index] = value
            else:
                here = here[index]
        elif isinstance(here, dict):
            if last:
                here[key] = value
            else:
                here = here.setdefault(key, {})
        else:
            return Problem(f"--set {place}", None, f"{'.'.join(keys[:depth])} is not a table")
    return None


def _keys_of(items: list[Any]) -> list[Any]:
    """By what the items of a list are addressed: their ``id``, or else their numbers from 0."""
    if any(isinstance(item, dict) and "id" in item for item in items):
        return [item.get("id") if isinstance(item, dict) else None for item in items]
    return list(range(len(items)))


# --- validation ----------------------------------------------------------------------


def _validate(data: dict[str, Any], folder: Path | None) -> tuple[Scenario | None, list[Problem]]:
    """Build the scenario and say what is wrong with it.

    If something is, a copy is mended place by place until it can be built, so
    that the rules between values can be checked too. None if that fails.
    """
    context = {} if folder is None else {"folder": folder}
    try:
        return Scenario.model_validate(data, context=context), []
    except ValidationError as error:
        errors = error.errors()
        found = [_with_id(data, problem) for problem in problems(Scenario, data, error)]
    data = deepcopy(data)
    for _ in range(5):  # a place inside a mended place may need another round
        for item in errors:
            _mend(data, item["loc"], missing=item["type"] == "missing")
        try:
            return Scenario.model_validate(data, context=context), found
        except ValidationError as error:
            errors = error.errors()
    return None, found


def _with_id(data: dict[str, Any], problem: Problem) -> Problem:
    """A problem of ``robots[2]``, which counts from 0, says the robot's id, too."""
    found = re.match(r"robots\[(\d+)\]", problem.place)
    robot = data["robots"][int(found[1])] if found else None
    if not isinstance(robot, dict) or "id" not in robot:
        return problem
    return problem._replace(rule=f"{problem.rule} (robot {shown(robot['id'])})")


_STAND_INS: dict[str, Any] = {
    "name": "unnamed", "duration_s": 1.0, "formation": {"edges": []}, "edges": [],
    "offset_m": [0.0, 0.0], "start": {"x_m": 0.0, "y_m": 0.0}, "x_m": 0.0, "y_m": 0.0,
}  # fmt: skip
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


# --- rules between values --------------------------------------------------------------


def _cross_check(scenario: Scenario) -> list[Problem]:
    found = [
        *_check_clock(scenario),
        *_check_silence(scenario),
        *_check_robots(scenario),
        *_check_edges(scenario),
        *_check_coupling(scenario),
        *_check_selectors(scenario),
        *_check_faults(scenario),
        *_check_window(scenario),
        *_check_hosts(scenario),
    ]
    if not found:  # which links there are is clear
        found = [*_check_links(scenario)] or [*_check_timeline(scenario)]
    return found


def _check_hosts(scenario: Scenario) -> Iterator[Problem]:
    for host in scenario.hosts.hosts if scenario.hosts is not None else ():
        for robot in host.robots:
            if robot not in scenario.ids:
                yield Problem(
                    f"hosts.{host.name}.robots", str(robot),
                    f"robot {robot} does not exist (robots: {', '.join(map(str, scenario.ids))})",
                )  # fmt: skip


def _check_clock(scenario: Scenario) -> Iterator[Problem]:
    clock = scenario.clock
    control, broadcast = clock.control_period_ns, clock.broadcast_period_ns
    if control < 1:
        yield Problem(
            "clock.control_period_s", str(clock.control_period_s), "must be at least 1e-9 (1 ns)"
        )
        return
    if broadcast % control or broadcast < control:
        yield Problem(
            "clock.broadcast_period_s",
            str(clock.broadcast_period_s),
            f"must be a multiple of control_period_s = {clock.control_period_s}",
        )
    if nanoseconds(scenario.duration_s) % control:
        yield Problem(
            "duration_s",
            str(scenario.duration_s),
            f"must be a multiple of clock.control_period_s = {clock.control_period_s}",
        )


def _check_silence(scenario: Scenario) -> Iterator[Problem]:
    neighbours, period_s = scenario.neighbours, scenario.clock.broadcast_period_s
    if neighbours.on_silence == "drop" and neighbours.silence_s < period_s:
        yield Problem(
            "neighbours.silence_s",
            str(neighbours.silence_s),
            f"must be at least clock.broadcast_period_s = {period_s}: nobody is heard more often",
        )


def _check_robots(scenario: Scenario) -> Iterator[Problem]:
    first: dict[int, int] = {}
    for index, robot in enumerate(scenario.robots):
        if robot.id in first:
            yield Problem(
                f"robots[{index}].id", str(robot.id), f"already used by robots[{first[robot.id]}]"
            )
        first.setdefault(robot.id, index)


def _check_edges(scenario: Scenario) -> Iterator[Problem]:
    seen: dict[tuple[int, int], int] = {}
    for index, edge in enumerate(scenario.formation.edges):
        place, value = f"formation.edges[{index}]", str(list(edge))
        yield from _unknown_robots(scenario, place, edge)
        key = (min(edge), max(edge))
        if edge[0] == edge[1]:
            yield Problem(place, value, "joins a robot to itself")
        elif key in seen:
            yield Problem(
                place, value, f"repeats formation.edges[{seen[key]}]; edges have no direction"
            )
        seen.setdefault(key, index)


def _check_coupling(scenario: Scenario) -> Iterator[Problem]:
    coupling = scenario.formation.coupling
    if not isinstance(coupling, dict):
        return
    names = {f"{a}-{b}" for edge in scenario.formation.edges for a, b in (edge, edge[::-1])}
    for name, weight in coupling.items():
        if name not in names:
            yield Problem(
                f'formation.coupling."{name}"', str(weight), "names no edge of formation.edges"
            )
    for first, second in scenario.formation.edges:
        here = [n for n in (f"{first}-{second}", f"{second}-{first}") if n in coupling]
        if len(here) != 1:
            yield Problem(
                f'formation.coupling."{first}-{second}"',
                None,
                "is required: a table needs one weight for every edge"
                if not here
                else f'given twice (also as "{second}-{first}"); b_ji = b_ij is one number',
            )


def _check_selectors(scenario: Scenario) -> Iterator[Problem]:
    for index, rule in enumerate(scenario.network.links):
        place = f"network.links[{index}]"
        yield from _unknown_robots(scenario, f"{place}.from", named(rule.sources))
        yield from _unknown_robots(scenario, f"{place}.to", named(rule.destinations))
    for index, action in enumerate(scenario.timeline):
        yield from _unknown_robots(scenario, f"timeline[{index}]", action.named_robots())


def _check_links(scenario: Scenario) -> Iterator[Problem]:
    for source, destination in scenario.directed_links:
        settings = scenario.network.default
        for index, rule in enumerate(scenario.network.links):
            if not rule.covers(source, destination):
                continue
            try:
                settings = settings.changed(rule)
            except SettingError as error:
                yield _on_link(f"network.links[{index}]", error.problem, source, destination)
                return


def _check_faults(scenario: Scenario) -> Iterator[Problem]:
    period_ns = max(1, scenario.clock.control_period_ns)
    known = [
        (k, action) for k, action in enumerate(scenario.timeline)
        if isinstance(action, FaultAction) and set(scenario.ids).issuperset(action.named_robots())
    ]  # fmt: skip
    try:
        spans_of(known, scenario.ids, scenario.seed, period_ns)
    except FaultError as error:
        for index, why in error.problems.items():
            yield Problem(f"timeline[{index}]", None, why)


def _check_timeline(scenario: Scenario) -> Iterator[Problem]:
    links = [(k, e) for k, e in enumerate(scenario.timeline) if not isinstance(e, FaultAction)]
    for index, entry in links:
        if not any(entry.effect(*link, scenario.ids) for link in scenario.directed_links):
            yield Problem(f"timeline[{index}]", None, "concerns no link of formation.edges")
    for source, destination in scenario.directed_links:
        timeline = scenario.timeline_of(source, destination)
        try:
            while timeline.next_ns < NEVER:
                timeline.advance(timeline.next_ns)
        except SettingError as error:
            index = next(
                k
                for k, entry in links
                if entry.effect(source, destination, scenario.ids) == error.cause
            )
            yield _on_link(f"timeline[{index}]", error.problem, source, destination)
            return


def _on_link(place: str, problem: Problem, source: int, destination: int) -> Problem:
    rule = f"{problem.rule} (on the link from {source} to {destination})"
    return Problem(f"{place}.{problem.place}", problem.value, rule)


def _check_window(scenario: Scenario) -> Iterator[Problem]:
    window = scenario.expect.window_s if scenario.expect else None
    if window is not None and window > scenario.duration_s:
        yield Problem(
            "expect.window_s", str(window), f"must not exceed duration_s = {scenario.duration_s}"
        )


def _unknown_robots(scenario: Scenario, place: str, robots: Iterable[int]) -> Iterator[Problem]:
    ids = sorted(set(scenario.ids))
    for robot in dict.fromkeys(robots):
        if robot not in ids:
            yield Problem(
                place, None, f"robot {robot} does not exist (robots: {', '.join(map(str, ids))})"
            )
