"""Robots and links as a scenario names them."""

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from formnet.netem.files.tables import Seconds, Table

RobotId = Annotated[int, Field(ge=0, le=2**31 - 1)]


def _kind_of_selector(value: object) -> str:
    return "all" if isinstance(value, str) else "one" if isinstance(value, int) else "list"


Robots = Annotated[
    Annotated[Literal["*"], Tag("all")]
    | Annotated[RobotId, Tag("one")]
    | Annotated[list[RobotId], Field(min_length=1), Tag("list")],
    Discriminator(_kind_of_selector),
]
"""Robots by one id, a list of ids, or ``"*"`` for all."""

Links = Annotated[
    Annotated[Literal["*"], Tag("all")]
    | Annotated[
        list[Annotated[tuple[Robots, Robots], Field(strict=False)]],
        Field(min_length=1),
        Tag("list"),
    ],
    Discriminator(_kind_of_selector),
]
"""Directed links as a list of ``[from, to]``, each as in :data:`Robots`, or ``"*"`` for all."""


def named(robots: Robots) -> list[int]:
    """The ids that a selector spells out; none for ``"*"``."""
    if isinstance(robots, str):
        return []
    return [robots] if isinstance(robots, int) else robots


def selected(robots: Robots, robot: int) -> bool:
    """Whether ``robot`` is one of ``robots``."""
    return robots == "*" or robot in named(robots)


def pair_covers(
    pair: tuple[Robots, Robots], source: int, destination: int, *, both_ways: bool
) -> bool:
    """Whether ``pair`` names the link from ``source`` to ``destination``, or its way back."""
    first, second = pair
    if selected(first, source) and selected(second, destination):
        return True
    return both_ways and selected(first, destination) and selected(second, source)


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

    def covers(self, source: int, destination: int) -> bool:
        """Whether the action is about the link from ``source`` to ``destination``."""
        return self.links == "*" or any(
            pair_covers(pair, source, destination, both_ways=self.both_ways) for pair in self.links
        )

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
