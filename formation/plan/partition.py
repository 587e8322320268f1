"""``partition``: who can still hear whom when the network falls apart."""

from collections import Counter
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field, model_validator

from formnet.formation.plan.cut import InFlight
from formnet.formation.plan.selectors import RobotId
from formnet.netem.files.tables import PositiveSeconds, Seconds, Table
from formnet.netem.settings.actions import Cut
from formnet.netem.settings.timeline import Action

SHAPES = ("halves", "isolate", "bridge", "ring")


class PartitionAction(Table):
    """``action = "partition"``: cut every link between robots that no longer reach each other.

    By ``groups``: links inside a group stay, all others are cut; robots in no
    group make up one more. Or by ``shape``, robots in the order of the file:

    halves
        the first half (of an odd number, the smaller one) and the rest;
    isolate
        ``robot`` alone, the others together;
    bridge
        two halves of the others, and ``robot`` in touch with both (without
        ``robot``, the first of the second half);
    ring
        each robot in touch with the one before and the one after it alone.

    Links that an earlier action cut stay cut.
    """

    action: Literal["partition"] = Field(
        description="Cuts the links between robots of different groups."
    )
    at_s: Seconds = Field(description="Time of the action.")
    groups: (
        Annotated[list[Annotated[list[RobotId], Field(min_length=1)]], Field(min_length=1)] | None
    ) = Field(
        default=None, description="Robots that stay connected; robots in no group form one more."
    )
    shape: Literal["halves", "isolate", "bridge", "ring"] | None = Field(
        default=None, description="A named partition, instead of `groups`."
    )
    robot: RobotId | None = Field(
        default=None,
        description="The robot that `isolate` isolates, or that connects the halves of `bridge`.",
    )
    in_flight: InFlight = Field(
        default="kept",
        description="Fate of messages sent before the cut and due after it.",
    )
    heal_after_s: PositiveSeconds | None = Field(
        default=None, description="Heals the same links after this time."
    )

    @model_validator(mode="after")
    def _one_way_to_say_it(self) -> "PartitionAction":
        if (self.groups is None) == (self.shape is None):
            raise ValueError("needs either groups or shape")
        if self.shape == "isolate" and self.robot is None:
            raise ValueError("shape = 'isolate' needs robot, the one to isolate")
        if self.robot is not None and self.shape not in ("isolate", "bridge"):
            raise ValueError("robot belongs to the shapes 'isolate' and 'bridge'")
        members = [robot for group in self.groups or [] for robot in group]
        twice = next((robot for robot, count in Counter(members).items() if count > 1), None)
        if twice is not None:
            raise ValueError(f"robot {twice} is in two groups, or twice in one")
        return self

    def named_robots(self) -> list[int]:
        """The robots that are named."""
        named = [robot for group in self.groups or [] for robot in group]
        return named if self.robot is None else [self.robot]

    def effect(self, source: int, destination: int, robots: Sequence[int]) -> Action | None:
        """What it does to one link; ``robots`` are all, in the order of the file."""
        if self._in_touch(source, destination, robots):
            return None
        return Cut(lose_in_flight=self.in_flight == "lost")

    def _in_touch(self, a: int, b: int, robots: Sequence[int]) -> bool:
        if self.groups is not None:
            return _group(a, self.groups) == _group(b, self.groups)
        if self.shape == "isolate":
            return self.robot not in (a, b)
        places = {robot: place for place, robot in enumerate(robots)}
        if self.shape == "ring":
            return abs(places[a] - places[b]) in (1, len(robots) - 1)
        if self.shape == "halves":
            return _half(places[a], len(robots)) == _half(places[b], len(robots))
        bridge = robots[len(robots) // 2] if self.robot is None else self.robot
        others = {robot: place for place, robot in enumerate(r for r in robots if r != bridge)}
        if bridge in (a, b):
            return True
        return _half(others[a], len(others)) == _half(others[b], len(others))

    def describe(self) -> str:
        """In words."""
        if self.groups is None:
            who = f"{self.shape}" + ("" if self.robot is None else f", robot {self.robot}")
        else:
            who = " | ".join(" ".join(map(str, group)) for group in self.groups)
        return f"partition {who}, in flight {self.in_flight}"


def _group(robot: int, groups: Sequence[Sequence[int]]) -> int:
    """Which group ``robot`` is in; -1 is that of those in none."""
    return next((k for k, group in enumerate(groups) if robot in group), -1)


def _half(place: int, count: int) -> bool:
    return place >= count // 2
