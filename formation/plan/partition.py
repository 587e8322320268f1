"""``partition``: who can still hear whom when the network falls apart."""

from collections import Counter
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field, model_validator

from formnet.formation.plan.cut import InFlight
from formnet.formation.plan.reach import Between, Chords, Reach
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

    def effect(self) -> Action:
        """What it does to each of its links."""
        return Cut(lose_in_flight=self.in_flight == "lost")

    def reach(self, robots: Sequence[int]) -> Reach:
        """The links that it cuts; ``robots`` are all, in the order of the file."""
        if self.groups is not None:
            return Between({robot: k for k, group in enumerate(self.groups) for robot in group})
        if self.shape == "isolate" and self.robot is not None:
            return Between({self.robot: 0})
        if self.shape == "ring":
            return Chords(robots)
        if self.shape == "halves":
            return Between(_halves(robots))
        bridge = robots[len(robots) // 2] if self.robot is None else self.robot
        return Between(_halves([robot for robot in robots if robot != bridge]), bridge)

    def describe(self) -> str:
        """In words."""
        if self.groups is None:
            who = f"{self.shape}" + ("" if self.robot is None else f", robot {self.robot}")
        else:
            who = " | ".join(" ".join(map(str, group)) for group in self.groups)
        return f"partition {who}, in flight {self.in_flight}"


def _halves(robots: Sequence[int]) -> dict[int, int]:
    return {robot: int(place >= len(robots) // 2) for place, robot in enumerate(robots)}
