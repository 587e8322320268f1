"""A run as it is resolved: what the plant is briefed with, and what each robot is told of it.

A :class:`Plan` holds values only, every reference looked up and every rule between them checked
(:func:`formnet.formation.briefing.resolving.resolve`). Tables that many links share stand in it
once; links name them by their numbers. As bytes it is JSON: floats come back to the bit.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Annotated, Any, TypeVar

from pydantic import ConfigDict, Discriminator, Tag, TypeAdapter, ValidationError

from formnet.formation.briefing.situation import BodyEstimate, Situation
from formnet.formation.plan.roster import Roster, Span
from formnet.formation.scenario.clock import Clock
from formnet.formation.scenario.failures import Plant, Run
from formnet.formation.scenario.law import LawSettings
from formnet.formation.scenario.robots import Vehicle
from formnet.formation.wire.state import State
from formnet.netem.core.link import Link
from formnet.netem.files.problems import dotted
from formnet.netem.settings.actions import Change, Cut, Heal
from formnet.netem.settings.links import LinkSettings
from formnet.netem.settings.ramp import Ramp
from formnet.netem.settings.timeline import Timeline

Brief = TypeVar("Brief")
_STRICT = ConfigDict(strict=True, extra="forbid", ser_json_inf_nan="constants")


def _kind_of_action(value: Any) -> str:
    if not isinstance(value, Mapping):
        return type(value).__name__
    kinds = {"values": "Change", "parameter": "Ramp", "lose_in_flight": "Cut"}
    return next((kind for key, kind in kinds.items() if key in value), "Heal")


PlannedAction = tuple[
    int,
    Annotated[
        Annotated[Change, Tag("Change")]
        | Annotated[Ramp, Tag("Ramp")]
        | Annotated[Cut, Tag("Cut")]
        | Annotated[Heal, Tag("Heal")],
        Discriminator(_kind_of_action),
    ],
]
"""What is done to links, with its instant in nanoseconds."""


class BadBrief(ValueError):
    """Bytes that are no plan; the text says where and why."""


@dataclass(frozen=True)
class PlannedLink:
    """One directed link: the numbers of its settings at the beginning and of its actions."""

    source: int
    destination: int
    settings: int
    actions: tuple[int, ...]


@dataclass(frozen=True)
class RobotPlan:
    """All that one robot is told of a run: its law's situation, its incoming links, who is down.

    ``spans`` are those of the robot and its neighbours. After ``silence_ns`` without anything
    usable a neighbour is dropped (NEVER: held).
    """

    __pydantic_config__ = _STRICT

    robot: int
    seed: int
    clock: Clock
    situation: Situation
    silence_ns: int
    spans: Mapping[int, tuple[Span, ...]]
    links: tuple[PlannedLink, ...]
    settings: tuple[LinkSettings, ...]
    actions: tuple[PlannedAction, ...]

    @property
    def neighbours(self) -> list[int]:
        """Whom it hears, ascending."""
        return [link.source for link in self.links]

    def roster(self) -> Roster:
        """Who is down when, as planned."""
        return Roster(self.spans)

    def incoming(self, life: int) -> dict[int, tuple[Link, Timeline]]:
        """Its links by source, each with the timeline that keeps it.

        Links stand at the receiver, so one that was restarted ``life`` times has new ones.
        """
        name = f"{self.robot}, life {life}" if life else f"{self.robot}"
        found = {}
        for planned in self.links:
            settings = self.settings[planned.settings]
            link = settings.link(seed=self.seed, source=planned.source, destination=name)
            actions = [self.actions[number] for number in planned.actions]
            found[planned.source] = link, Timeline(settings, actions, link)
        return found

    def pack(self) -> str:
        """The form in which the plant sends it."""
        return _adapter(RobotPlan).dump_json(self).decode()

    @staticmethod
    def unpack(text: str | bytes) -> "RobotPlan":
        """Raises BadBrief."""
        return _unpacked(RobotPlan, text)


@dataclass(frozen=True)
class Plan:
    """A whole run, resolved.

    ``scenario`` is its TOML text without hosts, for who watches. ``ids`` are in the order of the
    file; ``starts`` hold the states at t = 0; ``neighbours_of`` ascends.
    """

    __pydantic_config__ = _STRICT

    name: str
    scenario: str
    seed: int
    clock: Clock
    ticks: int
    law: LawSettings
    plant: Plant
    run: Run
    ids: tuple[int, ...]
    vehicles: Mapping[int, Vehicle]
    estimates: Mapping[int, BodyEstimate]
    starts: Mapping[int, State]
    offsets_m: Mapping[int, tuple[float, float]]
    coupling: Mapping[int, Mapping[int, float]]
    silence_ns: int
    spans: Mapping[int, tuple[Span, ...]]
    links: tuple[PlannedLink, ...]
    settings: tuple[LinkSettings, ...]
    actions: tuple[PlannedAction, ...]

    @cached_property
    def neighbours_of(self) -> dict[int, list[int]]:
        """𝒩_j of every robot, ascending."""
        return {robot: sorted(self.coupling[robot]) for robot in self.ids}

    @property
    def duration_ns(self) -> int:
        """How long the run is."""
        return self.ticks * self.clock.control_period_ns

    def roster(self) -> Roster:
        """Who is down when, as planned."""
        return Roster(self.spans)

    def situation(self, robot: int) -> Situation:
        """What the law of ``robot`` may know."""
        return Situation(
            robot=robot,
            settings=self.law,
            control_period_s=self.clock.control_period_s,
            offsets_m=self.offsets_m,
            coupling=self.coupling[robot],
            damping=self.vehicles[robot].damping,
            body=self.estimates[robot],
        )

    def robot(self, robot: int) -> RobotPlan:
        """What ``robot`` is told."""
        met = {robot, *self.coupling[robot]}
        own = [link for link in self.links if link.destination == robot]
        settings = _Numbers([link.settings for link in own])
        actions = _Numbers([number for link in own for number in link.actions])
        return RobotPlan(
            robot=robot,
            seed=self.seed,
            clock=self.clock,
            situation=self.situation(robot),
            silence_ns=self.silence_ns,
            spans={other: spans for other, spans in self.spans.items() if other in met},
            links=tuple(
                PlannedLink(
                    link.source,
                    robot,
                    settings.new[link.settings],
                    tuple(actions.new[number] for number in link.actions),
                )
                for link in own
            ),
            settings=tuple(self.settings[number] for number in settings.new),
            actions=tuple(self.actions[number] for number in actions.new),
        )

    def pack(self) -> str:
        """The form in which the launcher hands it to the plant."""
        return _adapter(Plan).dump_json(self).decode()

    @staticmethod
    def unpack(text: str | bytes) -> "Plan":
        """Raises BadBrief."""
        return _unpacked(Plan, text)


class _Numbers:
    """Numbers of entries that are kept, and their new ones."""

    def __init__(self, kept: list[int]) -> None:
        self.new = {old: new for new, old in enumerate(sorted(set(kept)))}


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def _unpacked(kind: Callable[..., Brief], text: str | bytes) -> Brief:
    try:
        found: Brief = _adapter(kind).validate_json(text, strict=True)
        return found
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = dotted(first["loc"])
        raise BadBrief(f"{place}: {first['msg']}" if place else first["msg"]) from None
