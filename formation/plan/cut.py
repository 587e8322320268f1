"""``cut`` and ``heal``: links that carry nothing for a while."""

from typing import Literal

from pydantic import Field

from formnet.formation.plan.selection import LinkSelection
from formnet.netem.files.tables import PositiveSeconds
from formnet.netem.settings.actions import Cut, Heal
from formnet.netem.settings.timeline import Action

InFlight = Literal["kept", "lost"]
"""What a cut does to messages that were sent before it and are due after it."""


class CutAction(LinkSelection):
    """``action = "cut"``: what is sent from then on is lost, until a ``heal``."""

    action: Literal["cut"] = Field(
        description="Links lose all messages sent from then on, until a heal."
    )
    in_flight: InFlight = Field(
        default="kept",
        description="Fate of messages sent before the cut and due after it.",
    )
    heal_after_s: PositiveSeconds | None = Field(
        default=None, description="Heals the same links after this time."
    )

    def effect(self) -> Action:
        """What it does to each of its links."""
        return Cut(lose_in_flight=self.in_flight == "lost")

    def describe(self) -> str:
        """In words."""
        return f"cut {self.links_in_words}, in flight {self.in_flight}"


class HealAction(LinkSelection):
    """``action = "heal"``: cut links carry what is sent from then on; by default all links."""

    action: Literal["heal"] = Field(
        description="Cut links deliver messages again that are sent from then on."
    )

    def effect(self) -> Action:
        """What it does to each of its links."""
        return Heal()

    def describe(self) -> str:
        """In words."""
        return f"heal {self.links_in_words}"
