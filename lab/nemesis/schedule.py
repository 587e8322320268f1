"""Random schedules of failures that heal themselves.

A schedule is a list of episodes. Every episode undoes what it did, and none depends on
another, so that any part of a schedule is a schedule too: that is what lets one be shrunk.
"""

import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from random import Random
from typing import Any, TypeVar

import tomli_w

from formnet.formation.plan.partition import PartitionAction
from formnet.formation.scenario.loading import dumps, loads
from formnet.formation.scenario.model import Scenario
from formnet.netem.core.streams import stream

Item = TypeVar("Item")

MOST_EPISODES = 10
"""How many episodes a schedule has at most."""
SHORTEST_S = 0.002
"""How long an episode lasts at least."""

_UNDONE_AFTER = {
    "kill": "restart_after_s",
    "pause": "resume_after_s",
    "cut": "heal_after_s",
    "partition": "heal_after_s",
    "ramp": "duration_s",
}
"""The key that says how long an action lasts, by the action."""


@dataclass(frozen=True)
class Episode:
    """Something that goes wrong at ``begin_s`` and is mended at ``end_s``.

    ``action`` is an entry of ``[[timeline]]`` without its times; ``mended`` are entries that
    mend it where the action itself has no key for that. ``holds`` names what it has for
    itself alone meanwhile: robots, or tables of links.
    """

    begin_s: float
    end_s: float
    action: dict[str, Any]
    mended: tuple[dict[str, Any], ...] = ()
    holds: frozenset[object] = frozenset()

    def entries(self) -> list[dict[str, Any]]:
        """The episode as entries of ``[[timeline]]``."""
        entry = {**self.action, "at_s": self.begin_s}
        key = _UNDONE_AFTER.get(entry["action"])
        if key is not None:
            entry[key] = round(self.end_s - self.begin_s, 9)
        return [entry, *({**mending, "at_s": self.end_s} for mending in self.mended)]

    def clashes(self, other: "Episode", apart_s: float) -> bool:
        """Whether both need the same thing at times less than ``apart_s`` apart."""
        near = self.begin_s < other.end_s + apart_s and other.begin_s < self.end_s + apart_s
        return near and bool(self.holds & other.holds)

    def shorter(self) -> "Episode":
        """The same, half as long."""
        return replace(self, end_s=round(0.5 * (self.begin_s + self.end_s), 4))


def draw(scenario: Scenario, seed: int, chaos_s: float) -> list[Episode]:
    """The schedule of ``seed``: all of it begins after 0 and is mended by ``chaos_s``.

    ``scenario`` has at least one link.
    """
    random = stream(seed, scenario.name, "nemesis", "schedule")
    apart_s = 2.0 * scenario.clock.control_period_s
    kinds = list(_KINDS)
    if len(scenario.ids) < 2:
        kinds.remove("partition")
    found: list[Episode] = []
    for _ in range(1 + _below(random, MOST_EPISODES)):
        make = _KINDS[kinds[_below(random, len(kinds))]]
        longest_s = chaos_s * random.random() ** 2  # most are short
        begin_s = round(random.random() * (chaos_s - longest_s), 4)
        end_s = round(max(begin_s + longest_s, begin_s + SHORTEST_S + apart_s), 4)
        episode = make(random, scenario, begin_s, end_s)
        # What does nothing, or clashes, is left out instead of drawn again.
        if (
            end_s <= chaos_s
            and _does_something(scenario, episode)
            and not any(episode.clashes(other, apart_s) for other in found)
        ):
            found.append(episode)
    return sorted(found, key=lambda episode: episode.begin_s)


def _does_something(scenario: Scenario, episode: Episode) -> bool:
    """Whether a partition parts anybody; everything else names links or robots that there are."""
    if episode.action["action"] != "partition":
        return True
    action = PartitionAction.model_validate(episode.entries()[0])
    reach = action.reach(scenario.ids)
    return any(reach.covers(*link) for link in scenario.directed_links)


def scheduled(scenario: Scenario, seed: int, episodes: Sequence[Episode]) -> Scenario:
    """``scenario`` with these episodes, and with ``seed`` for all else that is random."""
    data = tomllib.loads(dumps(scenario.without_hosts))
    data["seed"] = seed
    data["name"] = f"{scenario.name[:60]}-nemesis-{seed}"
    data["timeline"] = [entry for episode in episodes for entry in episode.entries()]
    return loads(tomli_w.dumps(data))


# --- kinds of episodes -----------------------------------------------------------------


def _kill(random: Random, scenario: Scenario, begin_s: float, end_s: float) -> Episode:
    return _on_robots(random, scenario, begin_s, end_s, "kill")


def _pause(random: Random, scenario: Scenario, begin_s: float, end_s: float) -> Episode:
    return _on_robots(random, scenario, begin_s, end_s, "pause")


def _on_robots(
    random: Random, scenario: Scenario, begin_s: float, end_s: float, verb: str
) -> Episode:
    """One robot mostly, sometimes several, seldom all."""
    everyone = 1 + _below(random, len(scenario.ids))
    robots = _some(random, scenario.ids, everyone if random.random() < 0.3 else 1)
    return Episode(begin_s, end_s, {"action": verb, "robots": robots}, holds=frozenset(robots))


def _cut(random: Random, scenario: Scenario, begin_s: float, end_s: float) -> Episode:
    links = _links(random, scenario)
    return Episode(
        begin_s,
        end_s,
        {
            "action": "cut",
            "links": links,
            "both_ways": random.random() < 0.5,
            "in_flight": _in_flight(random),
        },
    )


def _partition(random: Random, scenario: Scenario, begin_s: float, end_s: float) -> Episode:
    shape = ("halves", "isolate", "bridge", "ring")[_below(random, 4)]
    action: dict[str, Any] = {
        "action": "partition",
        "shape": shape,
        "in_flight": _in_flight(random),
    }
    if shape in ("isolate", "bridge"):
        action["robot"] = scenario.ids[_below(random, len(scenario.ids))]
    return Episode(begin_s, end_s, action)


def _delay(random: Random, scenario: Scenario, begin_s: float, end_s: float) -> Episode:
    mean_s = round(0.001 + 0.8 * random.random() ** 2, 4)
    tables = (
        {"distribution": "constant", "mean_s": mean_s},
        {"distribution": "uniform", "low_s": 0.0, "high_s": 2.0 * mean_s},
        {"distribution": "exponential", "mean_s": mean_s},
        {"distribution": "lognormal", "mean_s": mean_s, "stddev_s": mean_s},
    )
    change = {"delay": tables[_below(random, len(tables))]}
    return _on_network(random, scenario, begin_s, end_s, change)


def _loss(random: Random, scenario: Scenario, begin_s: float, end_s: float) -> Episode:
    share = round(0.05 + 0.95 * random.random(), 3)
    tables = (
        {"model": "random", "probability": share},
        {"model": "gilbert_elliott", "p": round(0.2 * share, 4), "r": 0.05},
        {"model": "every_nth", "n": 2 + _below(random, 9)},
    )
    change = {"loss": tables[_below(random, len(tables))]}
    return _on_network(random, scenario, begin_s, end_s, change)


def _rising_loss(random: Random, scenario: Scenario, begin_s: float, end_s: float) -> Episode:
    """A ramp of the loss; where links do not have independent loss, the loss changes at once."""
    links = _links(random, scenario)
    if any(scenario.link_settings(*link).loss.model != "random" for link in links):
        return _loss(random, scenario, begin_s, end_s)
    changed = _on_network(random, scenario, begin_s, end_s, {"loss": {}}, links)
    return replace(
        changed,
        action={
            "action": "ramp",
            "links": [list(link) for link in links],
            "parameter": "loss.probability",
            "from_value": 0.0,
            "to_value": round(random.random(), 3),
        },
    )


def _disorder(random: Random, scenario: Scenario, begin_s: float, end_s: float) -> Episode:
    share = round(0.5 * random.random(), 3)
    changes = ({"duplicate": {"probability": share}}, {"corrupt": {"probability": share}})
    return _on_network(random, scenario, begin_s, end_s, changes[_below(random, 2)])


def _on_network(
    random: Random,
    scenario: Scenario,
    begin_s: float,
    end_s: float,
    change: dict[str, Any],
    links: list[tuple[int, int]] | None = None,
) -> Episode:
    """Settings of some links change, and are what they were again."""
    if links is None:
        links = _links(random, scenario)
    tables = frozenset((*link, table) for link in links for table in change)
    mended = tuple(
        {
            "action": "network",
            "links": [[source, destination]],
            **{
                table: getattr(scenario.link_settings(source, destination), table).model_dump(
                    mode="json", exclude_none=True
                )
                for table in change
            },
        }
        for source, destination in links
    )
    action = {"action": "network", "links": [list(link) for link in links], **change}
    return Episode(begin_s, end_s, action, mended, tables)


_KINDS: dict[str, Callable[[Random, Scenario, float, float], Episode]] = {
    "kill": _kill,
    "pause": _pause,
    "cut": _cut,
    "partition": _partition,
    "delay": _delay,
    "loss": _loss,
    "rising loss": _rising_loss,
    "disorder": _disorder,
}


def _links(random: Random, scenario: Scenario) -> list[tuple[int, int]]:
    links = scenario.directed_links
    many = 1 + _below(random, len(links))
    return _some(random, links, len(links) if random.random() < 0.3 else min(many, 4))


def _in_flight(random: Random) -> str:
    return "lost" if random.random() < 0.5 else "kept"


def _below(random: Random, bound: int) -> int:
    """A whole number from 0 to before ``bound``, of one draw (see :mod:`netem.core.streams`)."""
    return int(random.random() * bound)


def _some(random: Random, items: Sequence[Item], count: int) -> list[Item]:
    """``count`` of ``items``, in their order."""
    marks = sorted((random.random(), place) for place in range(len(items)))[:count]
    return [items[place] for place in sorted(place for _, place in marks)]


def describe(episodes: Sequence[Episode]) -> Iterator[str]:
    """A line for each episode."""
    for episode in episodes:
        told = {key: value for key, value in episode.action.items() if key != "action"}
        yield (
            f"{episode.begin_s:9.4f} to {episode.end_s:9.4f} s  {episode.action['action']} "
            + ", ".join(f"{key} {value}" for key, value in told.items())
        )
