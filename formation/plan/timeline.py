"""``[[timeline]]``: what happens in a run, and when.

What befalls robots is in :mod:`formnet.formation.plan.roster`. Each action on links says which
directed links it is about (``reach``) and what it does to them (``effect``); links apply their own
at the receiving robot, by the stamps of messages, so that a distributed run and an inline one agree
to the bit.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated, NamedTuple

from pydantic import Field

from formnet.formation.plan.change import NetworkAction, RampAction
from formnet.formation.plan.cut import CutAction, HealAction
from formnet.formation.plan.fault import (
    FaultAction,
    KillAction,
    PauseAction,
    RestartAction,
    ResumeAction,
)
from formnet.formation.plan.partition import PartitionAction
from formnet.formation.plan.reach import Reach
from formnet.formation.plan.roster import Happening
from formnet.netem.files.tables import nanoseconds
from formnet.netem.settings.actions import Heal
from formnet.netem.settings.timeline import Action

TimelineAction = Annotated[
    NetworkAction
    | RampAction
    | CutAction
    | HealAction
    | PartitionAction
    | KillAction
    | RestartAction
    | PauseAction
    | ResumeAction,
    Field(discriminator="action"),
]


class Effects:
    """What a timeline does to links. Each entry is worked out once, however many links there are.

    ``robots`` are all of the run, in the order of the file.
    """

    def __init__(self, timeline: Iterable[TimelineAction], robots: Sequence[int]) -> None:
        self._reach: dict[int, Reach] = {}  # by the number of the entry
        self._done: dict[int, list[tuple[int, Action]]] = {}
        self._entries: dict[tuple[int, int], tuple[int, ...]] = {}  # by link
        self._same: dict[tuple[int, ...], tuple[int, ...]] = {}
        for number, action in enumerate(timeline):
            if isinstance(action, FaultAction):
                continue
            at_ns = nanoseconds(action.at_s)
            self._reach[number] = action.reach(robots)
            self._done[number] = [(at_ns, action.effect())]
            if isinstance(action, CutAction | PartitionAction) and action.heal_after_s is not None:
                self._done[number].append((at_ns + nanoseconds(action.heal_after_s), Heal()))

    def entries(self, source: int, destination: int) -> tuple[int, ...]:
        """The numbers of the entries that are about a link, ascending."""
        link = (source, destination)
        found = self._entries.get(link)
        if found is None:
            found = tuple(k for k, reach in self._reach.items() if reach.covers(*link))
            found = self._entries[link] = self._same.setdefault(found, found)
        return found

    def of_entry(self, number: int) -> list[tuple[int, Action]]:
        """What an entry does to each of its links, with the instants in nanoseconds."""
        return self._done[number]

    def on(self, source: int, destination: int) -> Iterator[tuple[int, Action]]:
        """What is done to one link, with the instants in nanoseconds, in the order of the file."""
        for number in self.entries(source, destination):
            yield from self._done[number]


class PlanEntry(NamedTuple):
    """One thing that happens: when, what (for people), and to which directed links or robots."""

    at_s: float
    what: str
    links: list[tuple[int, int]]
    robots: list[int]


def plan_of(
    timeline: Iterable[TimelineAction],
    links: Sequence[tuple[int, int]],
    robots: Sequence[int],
    happenings: Iterable[Happening],
    period_ns: int,
) -> list[PlanEntry]:
    """What happens in a run, in the order in which it does.

    ``links`` are all directed links and ``robots`` all robots, in the order of the file;
    ``happenings`` is what befalls robots, at ticks of ``period_ns``.
    """
    entries = [
        PlanEntry(tick * period_ns / 1e9, f"{verb} {', '.join(map(str, whom))}", [], whom)
        for tick, verb, whom in happenings
    ]
    for action in timeline:
        if isinstance(action, FaultAction):
            continue
        reach = action.reach(robots)
        touched = [link for link in links if reach.covers(*link)]
        what = action.describe()
        if isinstance(action, PartitionAction):
            what += f"; cuts {arrows(touched)}"
        entries.append(PlanEntry(action.at_s, what, touched, []))
        if isinstance(action, CutAction | PartitionAction) and action.heal_after_s is not None:
            at_s = action.at_s + action.heal_after_s
            entries.append(PlanEntry(at_s, f"heal what was cut at {action.at_s:g} s", touched, []))
        if isinstance(action, RampAction):
            at_s = action.at_s + action.duration_s
            what = f"end of the ramp: {action.parameter} = {action.to_value:g}"
            entries.append(PlanEntry(at_s, what, touched, []))
    return sorted(entries, key=lambda entry: entry.at_s)


def arrows(links: Sequence[tuple[int, int]]) -> str:
    """Directed links for people, both ways as one: ``1→2, 2↔3``."""
    there = set(links)
    words = []
    for a, b in links:
        if (b, a) not in there:
            words.append(f"{a}→{b}")
        elif a < b:
            words.append(f"{a}↔{b}")
    return ", ".join(words)
