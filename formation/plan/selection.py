"""What an action on links begins with: when, and which links."""

from collections.abc import Sequence

from pydantic import Field

from formnet.formation.plan.reach import Everywhere, Named, Reach
from formnet.formation.plan.selectors import Links, Robots, named
from formnet.netem.files.tables import Seconds, Table


class LinkSelection(Table):
    """What an action on links begins with: when, and which.

    ``links`` are directed, as pairs of from and to; ``both_ways`` adds the ways back.
    """

    at_s: Seconds = Field(description="Time of the action.")
    links: Links = Field(
        default="*",
        description=(
            'Directed links as `[[from, to], ...]`, each end an id, a list of ids or "*"; "*" '
            "alone: all."
        ),
    )
    both_ways: bool = Field(default=False, description="Also the opposite directions.")

    def reach(self, robots: Sequence[int]) -> Reach:
        """The links that the action is about."""
        if isinstance(self.links, str):
            return Everywhere()
        return Named(self.links, both_ways=self.both_ways)

    def named_robots(self) -> list[int]:
        """The robots that are named."""
        pairs = [] if isinstance(self.links, str) else self.links
        return [robot for pair in pairs for end in pair for robot in named(end)]

    @property
    def links_in_words(self) -> str:
        """Which links, for people."""
        if isinstance(self.links, str):
            return "all links"
        arrow = "↔" if self.both_ways else "→"
        return ", ".join(f"{_end(a)}{arrow}{_end(b)}" for a, b in self.links)


def _end(robots: Robots) -> str:
    return ",".join(map(str, named(robots))) or "*"
