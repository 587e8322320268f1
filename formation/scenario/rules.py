"""The rules between a scenario's values: what refers to what, and what must fit together."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from itertools import islice
from typing import Any

from formnet.formation.plan.fault import FaultAction, FaultError, spans_of
from formnet.formation.plan.selectors import named
from formnet.formation.scenario.clock import Clock
from formnet.formation.scenario.graph import MOST_EDGES
from formnet.formation.scenario.model import MOST_ROBOTS, Scenario
from formnet.formation.scenario.network import MOST_ENTRIES, MOST_VARIANTS, BadRule, TooManyVariants
from formnet.netem.files.problems import Problem
from formnet.netem.files.tables import nanoseconds
from formnet.netem.settings.links import SettingError
from formnet.netem.settings.timeline import NEVER

_FEW = 10
"""So many ids of robots are named where one is unknown."""

MOST_ITEMS = {
    ("robots",): MOST_ROBOTS,
    ("formation", "edges"): MOST_EDGES,
    ("network", "links"): MOST_ENTRIES,
    ("timeline",): MOST_ENTRIES,
}
"""The lists of a scenario that are bounded, by where they stand."""


def too_long(data: Mapping[str, Any]) -> list[Problem]:
    """The lists of a scenario's tables that are beyond their bounds; nothing is built of them."""
    found = []
    for place, most in MOST_ITEMS.items():
        here: Any = data
        for key in place:
            here = here.get(key) if isinstance(here, Mapping) else None
        if isinstance(here, list) and len(here) > most:
            rule = f"must have at most {most} items"
            found.append(Problem(".".join(place), f"{len(here)} items", rule))
    return found


def broken_rules(scenario: Scenario) -> list[Problem]:
    """Every rule that the values of a scenario break together."""
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
        found = [*_check_size(scenario)]
    if not found:
        found = [*_check_links(scenario)] or [*_check_timeline(scenario)]
    return found


MOST_EFFECTS = 2_000_000
"""Entries of ``[[network.links]]`` and the timeline, times directed links: each pair is tried."""


def _check_size(scenario: Scenario) -> Iterator[Problem]:
    links = 2 * len(scenario.formation.edges)
    for place, entries in (
        ("network.links", scenario.network.links),
        ("timeline", scenario.timeline),
    ):
        effects = len(entries) * links
        if effects > MOST_EFFECTS:
            yield Problem(
                place,
                f"{len(entries)} entries",
                f"times {links} directed links: must be at most {MOST_EFFECTS} together",
            )


def _check_hosts(scenario: Scenario) -> Iterator[Problem]:
    known = scenario.vehicles
    for host in scenario.hosts.hosts if scenario.hosts is not None else ():
        for robot in host.robots:
            if robot not in known:
                yield Problem(f"hosts.{host.name}.robots", str(robot), _no_such_robot(robot, known))


def _check_clock(scenario: Scenario) -> Iterator[Problem]:
    clock = scenario.clock
    yield from _check_multiple(
        "clock.broadcast_period_s", clock.broadcast_period_s, "control_period_s", clock
    )
    yield from _check_multiple("duration_s", scenario.duration_s, "clock.control_period_s", clock)


def _check_multiple(place: str, value_s: float, name: str, clock: Clock) -> Iterator[Problem]:
    """``value_s`` must be whole control periods, both as whole nanoseconds."""
    value_ns, period_ns = nanoseconds(value_s), clock.control_period_ns
    periods, rest_ns = divmod(value_ns, period_ns)
    if not rest_ns:
        return
    near = [
        str(near_s)
        for count in (periods, periods + 1)
        if count and nanoseconds(near_s := count * period_ns / 1e9) == count * period_ns
    ]
    yield Problem(
        place,
        str(value_s),
        f"must be a multiple of {name} = {clock.control_period_s}: times are whole nanoseconds, "
        f"and {value_ns} ns is not a multiple of {period_ns} ns"
        + (f" (nearest: {' or '.join(near)})" if near else ""),
    )


def _check_silence(scenario: Scenario) -> Iterator[Problem]:
    neighbours, period_s = scenario.neighbours, scenario.clock.broadcast_period_s
    if neighbours.on_silence == "drop" and neighbours.silence_s < period_s:
        yield Problem(
            "neighbours.silence_s",
            str(neighbours.silence_s),
            f"must be at least clock.broadcast_period_s = {period_s}, the broadcast interval",
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
            yield Problem(place, value, "connects a robot to itself")
        elif key in seen:
            yield Problem(
                place, value, f"repeats formation.edges[{seen[key]}]; edges are undirected"
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
                f'formation.coupling."{name}"', str(weight), "is not an edge of formation.edges"
            )
    for first, second in scenario.formation.edges:
        here = [n for n in (f"{first}-{second}", f"{second}-{first}") if n in coupling]
        if len(here) != 1:
            yield Problem(
                f'formation.coupling."{first}-{second}"',
                None,
                "is required: a table needs one weight for every edge"
                if not here
                else f'given twice (also as "{second}-{first}"); b_ji and b_ij are the same weight',
            )


def _check_selectors(scenario: Scenario) -> Iterator[Problem]:
    for index, rule in enumerate(scenario.network.links):
        place = f"network.links[{index}]"
        yield from _unknown_robots(scenario, f"{place}.from", named(rule.sources))
        yield from _unknown_robots(scenario, f"{place}.to", named(rule.destinations))
    for index, action in enumerate(scenario.timeline):
        yield from _unknown_robots(scenario, f"timeline[{index}]", action.named_robots())


def _check_links(scenario: Scenario) -> Iterator[Problem]:
    for link in scenario.directed_links:
        try:
            scenario.link_settings(*link)
        except BadRule as bad:
            yield _on_link(f"network.links[{bad.index}]", bad.error.problem, *link)
            return
        except TooManyVariants:
            rule = f"links differ in more than {MOST_VARIANTS} ways, counted rule by rule"
            yield Problem("network.links", f"{len(scenario.network.links)} entries", rule)
            return


def _check_faults(scenario: Scenario) -> Iterator[Problem]:
    period_ns = max(1, scenario.clock.control_period_ns)
    known = [
        (k, action)
        for k, action in enumerate(scenario.timeline)
        if isinstance(action, FaultAction) and set(scenario.ids).issuperset(action.named_robots())
    ]
    try:
        spans_of(known, scenario.ids, scenario.seed, period_ns)
    except FaultError as error:
        for index, why in error.problems.items():
            yield Problem(f"timeline[{index}]", None, why)


def _check_timeline(scenario: Scenario) -> Iterator[Problem]:
    effects, variants = scenario.effects, scenario.network.variants
    about = {link: effects.entries(*link) for link in scenario.directed_links}
    touched = {number for entries in set(about.values()) for number in entries}
    for index, entry in enumerate(scenario.timeline):
        if not isinstance(entry, FaultAction) and index not in touched:
            yield Problem(f"timeline[{index}]", None, "applies to no link of formation.edges")
    done = set()  # links with the same settings to which the same is done are alike
    for (source, destination), entries in about.items():
        alike = (variants.number(source, destination), entries)
        if not entries or alike in done:
            continue
        done.add(alike)
        timeline = scenario.timeline_of(source, destination)
        try:
            while timeline.next_ns < NEVER:
                timeline.advance(timeline.next_ns)
        except SettingError as error:
            index = next(k for k in entries if effects.of_entry(k)[0][1] == error.cause)
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
    known = scenario.vehicles
    for robot in dict.fromkeys(robots):
        if robot not in known:
            yield Problem(place, None, _no_such_robot(robot, known))


def _no_such_robot(robot: int, known: Collection[int]) -> str:
    """That a robot does not exist, and the first of those that do, in the order of the file."""
    few = ", ".join(map(str, islice(known, _FEW))) + (", …" if len(known) > _FEW else "")
    return f"robot {robot} does not exist (robots: {few})"
