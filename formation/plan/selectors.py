"""Robots and links as a scenario names them."""

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

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
