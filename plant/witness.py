"""What is sent to robots that may die, in real time: links stand at their receivers, and one that
is killed takes with it what it knows of them."""

from collections.abc import Iterable

from formnet.formation.records.rows import LinkRow
from formnet.netem.core.transit import LOST_DOWN


class Witness:
    """Counts every message to the robots it watches until they have told what became of it."""

    def __init__(self) -> None:
        self._untold: dict[tuple[int, int], dict[int, int]] = {}  # by link: sequence, sent at
        self._newest: dict[tuple[int, int], int] = {}
        self._ahead: set[tuple[int, int, int]] = set()  # told before they were seen here

    def watch(self, robot: int, neighbours: Iterable[int]) -> None:
        """From now on, what ``neighbours`` send to ``robot``."""
        for source in neighbours:
            self._untold.setdefault((source, robot), {})

    def sent(self, source: int, sequence: int, t_ns: int) -> None:
        """``source`` has sent a message at ``t_ns``."""
        for link, untold in self._untold.items():
            if link[0] != source:
                continue
            self._newest[link] = sequence
            if (*link, sequence) in self._ahead:
                self._ahead.discard((*link, sequence))
            else:
                untold[sequence] = t_ns

    def told(self, rows: Iterable[LinkRow]) -> None:
        """These fates are known."""
        for row in rows:
            link = row.source, row.destination
            untold = self._untold.get(link)
            if untold is None or untold.pop(row.sequence, None) is not None:
                continue
            if row.sequence > self._newest.get(link, -1):
                self._ahead.add((*link, row.sequence))

    def lost_with(self, robot: int) -> list[LinkRow]:
        """The messages whose fate ``robot`` has taken with it, once each."""
        rows = []
        for (source, destination), untold in self._untold.items():
            if destination != robot:
                continue
            rows += [
                LinkRow(t_ns, None, source, robot, sequence, LOST_DOWN)
                for sequence, t_ns in untold.items()
            ]
            untold.clear()
        return rows
