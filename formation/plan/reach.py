"""Which directed links something is about, worked out once: asked of a link, it answers at once."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

from formnet.formation.plan.selectors import Robots, named

_ALL = 1
"""The bit that stands for every destination."""


class Reach(Protocol):
    """Directed links."""

    def covers(self, source: int, destination: int) -> bool:
        """Whether the link from ``source`` to ``destination`` is one of them."""


class Everywhere:
    """All links."""

    def covers(self, source: int, destination: int) -> bool:
        """It is."""
        return True


class Named:
    """The links that some pairs of from and to name; with ``both_ways`` their ways back, too."""

    def __init__(self, pairs: Iterable[tuple[Robots, Robots]], *, both_ways: bool) -> None:
        self._both_ways = both_ways
        self._bits: dict[int, int] = {}  # by destination; a number is a set of them
        self._from_all = 0
        self._from: dict[int, int] = {}
        for sources, destinations in pairs:
            to = self._set(destinations)
            if sources == "*":
                self._from_all |= to
            for source in named(sources):
                self._from[source] = self._from.get(source, 0) | to

    def _set(self, robots: Robots) -> int:
        found = _ALL if robots == "*" else 0
        for robot in named(robots):
            found |= self._bits.setdefault(robot, 2 << len(self._bits))
        return found

    def covers(self, source: int, destination: int) -> bool:
        """Whether a pair names the link from ``source`` to ``destination``."""
        return self._names(source, destination) or (
            self._both_ways and self._names(destination, source)
        )

    def _names(self, source: int, destination: int) -> bool:
        to = self._from.get(source, 0) | self._from_all
        return bool(to and to & (_ALL | self._bits.get(destination, 0)))


class Between:
    """The links between robots of different sides; ``bridge`` is in touch with both."""

    def __init__(self, sides: Mapping[int, int], bridge: int | None = None) -> None:
        self._sides, self._bridge = sides, bridge

    def covers(self, source: int, destination: int) -> bool:
        """Whether the two are on different sides."""
        if self._bridge is not None and self._bridge in (source, destination):
            return False
        return self._sides.get(source, -1) != self._sides.get(destination, -1)


class Chords:
    """The links between robots that are not next to each other in a ring of ``robots``."""

    def __init__(self, robots: Sequence[int]) -> None:
        self._places = {robot: place for place, robot in enumerate(robots)}

    def covers(self, source: int, destination: int) -> bool:
        """Whether the two are apart."""
        apart = abs(self._places[source] - self._places[destination])
        return apart not in (1, len(self._places) - 1)
