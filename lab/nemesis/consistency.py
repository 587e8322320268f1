"""What must hold of the record of any run, whatever goes wrong in it."""

from collections import Counter
from collections.abc import Iterator
from itertools import combinations, groupby, pairwise

from formnet.exact.trigonometry import hypot
from formnet.formation.records.events import Extremes, LastTick, Lost, Planned, Started
from formnet.lab.runs.recording import Collected
from formnet.netem.core.transit import CORRUPTED, DELIVERED, DUPLICATED


def inconsistencies(run: Collected) -> Iterator[str]:
    """What is wrong with a record of a run that came to its planned end; nothing if all is well."""
    yield from _samples(run)
    yield from _messages(run)
    yield from _events(run)
    yield from _motion(run)


def _samples(run: Collected) -> Iterator[str]:
    """Every robot once at every broadcast tick and at the last, in order."""
    scenario = run.scenario
    period_ns, every = scenario.clock.control_period_ns, scenario.clock.broadcast_every
    ticks = [*range(0, scenario.ticks, every), scenario.ticks]
    wanted = [(tick * period_ns, robot) for tick in ticks for robot in scenario.ids]
    found = [(sample.t_ns, sample.robot) for sample in run.samples]
    if found != wanted:
        place = next(
            (k for k, (a, b) in enumerate(zip(found, wanted, strict=False)) if a != b),
            min(len(found), len(wanted)),
        )
        yield (
            f"samples: {len(found)} instead of {len(wanted)}, or not in order; the first that "
            f"differs is number {place}"
        )


def _messages(run: Collected) -> Iterator[str]:
    """One fate of each message at each neighbour of a sender that was up, and none else."""
    scenario, roster = run.scenario, run.roster()
    clock = scenario.clock
    broadcasts = range(scenario.ticks // clock.broadcast_every + 1)
    sent = {
        (source, receiver, sequence)
        for sequence in broadcasts
        for source in scenario.ids
        if roster.up(source, sequence * clock.broadcast_every)
        for receiver in scenario.neighbours_of[source]
    }
    fates = Counter(
        (row.source, row.destination, row.sequence)
        for row in run.link_rows
        if row.fate != DUPLICATED
    )
    # A copy that is lost looks like an original that is; only then may there be two.
    doubled = {link for link in scenario.directed_links if _duplicates(run, link)}
    yield from _few(
        "without any fate", [f"{s}→{r} number {k}" for s, r, k in sorted(sent - set(fates))]
    )
    yield from _few(
        "from a robot that was down or does not exist",
        [f"{s}→{r} number {k}" for s, r, k in sorted(set(fates) - sent)],
    )
    yield from _few(
        "with several fates",
        [
            f"{s}→{r} number {k}"
            for (s, r, k), n in sorted(fates.items())
            if n > 1 and (s, r) not in doubled
        ],
    )
    late = []
    for row in run.link_rows:
        name = f"{row.source}→{row.destination} number {row.sequence}"
        if row.t_sent_ns != row.sequence * clock.broadcast_period_ns:
            late.append(f"{name}: sent at {row.t_sent_ns} ns")
        arrives = row.fate in (DELIVERED, DUPLICATED, CORRUPTED)
        if arrives != (row.t_usable_ns is not None):
            late.append(f"{name}: {row.fate}, usable at {row.t_usable_ns} ns")
        elif row.t_usable_ns is not None:
            tick = -(-row.t_usable_ns // clock.control_period_ns)
            if row.t_usable_ns < row.t_sent_ns or tick > scenario.ticks:
                late.append(f"{name}: sent at {row.t_sent_ns} ns, usable at {row.t_usable_ns} ns")
            elif roster.killed(row.destination, tick):
                late.append(f"{name}: usable at {row.t_usable_ns} ns by a robot that was dead")
    yield from _few("at an impossible time", late)


def _duplicates(run: Collected, link: tuple[int, int]) -> bool:
    """Whether a link doubles messages at some time."""
    scenario = run.scenario
    if scenario.link_settings(*link).duplicate.probability:
        return True
    return any(
        getattr(action, "duplicate", None) is not None and action.reach(scenario.ids).covers(*link)  # type: ignore[union-attr]
        for action in scenario.timeline
    )


def _events(run: Collected) -> Iterator[str]:
    """In the order of time, from the start to the end; to robots happens what is planned."""
    events = run.events
    names = [event.name for event in events]
    if names[:1] != [Started.name] or names.count(LastTick.name) != 1:
        yield f"events: must begin with started and have one last tick: {names[:3]} … {names[-3:]}"
    happened = [event for event in events if isinstance(event, Planned)]
    for before, after in pairwise(happened):
        if after.t_ns < before.t_ns:
            yield f"events: {after.name} at {after.t_ns} ns after {before.name} at {before.t_ns} ns"
    period_ns, last = run.scenario.clock.control_period_ns, run.scenario.ticks
    planned = {
        (some.tick * period_ns, some.verb, tuple(some.robots))
        for some in run.scenario.roster().happenings()
        if some.tick <= last
    }
    found = {(event.t_ns, event.name, event.robots) for event in happened}
    yield from _few("planned and not happened", map(str, sorted(planned - found)))
    yield from _few("happened and not planned", map(str, sorted(found - planned)))
    lost = [event for event in events if isinstance(event, Lost)]
    if lost:
        who = ", ".join(f"robot {event.robot} ({event.reason})" for event in lost)
        yield f"lost without a plan: {who}"


def _motion(run: Collected) -> Iterator[str]:
    """Its extremes are told once, and no sample is beyond them."""
    told = [event for event in run.events if isinstance(event, Extremes)]
    if len(told) != 1:
        yield f"motion: its extremes must be recorded once, and are {len(told)} times"
        return
    speed, turn_rate, closest = told[0].top_speed, told[0].top_turn_rate, told[0].closest
    top_mps = speed.speed_mps if speed else -1.0
    top_radps = turn_rate.turn_rate_radps if turn_rate else -1.0
    for row in run.samples:
        for name, size, most in (
            ("speed_mps", row.speed_mps, top_mps),
            ("turn_rate_radps", row.turn_rate_radps, top_radps),
        ):
            if abs(size) > most:
                yield f"motion: {name} {size} of robot {row.robot} at {row.t_ns} ns is above {most}"
                return
    for t_ns, rows in groupby(run.samples, lambda row: row.t_ns):
        for one, other in combinations(rows, 2):
            distance_m = hypot(one.x_m - other.x_m, one.y_m - other.y_m)
            if closest is None or distance_m < closest.distance_m:
                told_of = "nothing" if closest is None else closest.words
                yield (
                    f"motion: robots {one.robot} and {other.robot} are {distance_m} m apart at "
                    f"{t_ns} ns, closer than recorded: {told_of}"
                )
                return


def _few(what: str, items: "list[str] | map[str]") -> Iterator[str]:
    """One line about all of ``items``, the first three by name."""
    all_items = list(items)
    if all_items:
        more = f" and {len(all_items) - 3} more" if len(all_items) > 3 else ""
        yield f"{what}: {', '.join(all_items[:3])}{more}"
