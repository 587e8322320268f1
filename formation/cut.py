"""``cut`` and ``heal``: links that carry nothing for a while."""

from collections.abc import Sequence
from typing import Literal

from formation.selectors import LinkSelection
from netem.actions import Cut, Heal
from netem.tables import PositiveSeconds
from netem.timeline import Action

InFlight = Literal["kept", "lost"]
"""What a cut does to messages that were sent before it and are due after it."""


class CutAction(LinkSelection):
    """``action = "cut"``: what is sent from then on is lost, until a ``heal``.

    ``heal_after_s`` heals the same links that much later.
    """

    action: Literal["cut"]
    in_flight: InFlight = "kept"
    heal_after_s: PositiveSeconds | None = None

    def effect(self, source: int, destination: int, robots: Sequence[int]) -> Action | None:
        """What it does to one link."""
        if not self.covers(source, destination):
            return None
        return Cut(lose_in_flight=self.in_flight == "lost")

    def describe(self) -> str:
        """In words."""
        return f"cut {self.links_in_words}, in flight {self.in_flight}"


class HealAction(LinkSelection):
    """``action = "heal"``: cut links carry what is sent from then on; by default all links."""

    action: Literal["heal"]

    def effect(self, source: int, destination: int, robots: Sequence[int]) -> Action | None:
        """What it does to one link."""
        return Heal() if self.covers(source, destination) else None

    def describe(self) -> str:
        """In words."""
        return f"heal {self.links_in_words}"
