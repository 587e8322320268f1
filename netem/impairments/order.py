"""Order kept in spite of jitter."""

from collections.abc import Sequence
from random import Random

from formnet.netem.core.link import Impairment
from formnet.netem.core.transit import Transit


class KeepOrder:
    """No message arrives before one that was sent earlier: it waits for it.

    A message that waits arrives together with the one it waited for, after it.
    """

    name = "order"

    def __init__(self) -> None:
        self._latest_ns = 0

    def twin(self) -> "KeepOrder":
        return self

    def inherit(self, before: Impairment) -> None:
        if isinstance(before, KeepOrder):
            self._latest_ns = before._latest_ns

    def occupy(self, under_way: Sequence[Transit]) -> None:
        self._latest_ns = max((copy.leaves_ns for copy in under_way), default=0)

    def apply(self, copy: Transit, random: Random) -> None:
        if not copy.absent:
            self._latest_ns = max(self._latest_ns, copy.due_ns)
            copy.due_ns = self._latest_ns
