"""``[network]`` and ``[neighbours]``: the links, and what a robot does with what they deliver."""

from typing import Literal

from pydantic import ConfigDict, Field

from formnet.formation.plan.selectors import Robots, pair_covers
from formnet.netem.files.tables import STRICT, PositiveSeconds, Table
from formnet.netem.settings.links import LinkOverrides, LinkSettings

MOST_ENTRIES = 1000
"""Of ``[[network.links]]``, and of the timeline."""


class LinkRule(LinkOverrides):
    """``[[network.links]]``: settings for the links from any of ``from`` to any of ``to``.

    What is not named stays as it is; a ``delay`` or ``loss`` that names its kind is a new one.
    """

    model_config = ConfigDict(**STRICT, validate_by_name=True)
    sources: Robots = Field(
        alias="from", description='The senders: an id, a list of ids, or "*" for all.'
    )
    destinations: Robots = Field(alias="to", description="The receivers, in the same form.")
    both_ways: bool = Field(default=False, description="Also the opposite directions.")

    def covers(self, source: int, destination: int) -> bool:
        """Whether the rule is about the link from ``source`` to ``destination``."""
        pair = (self.sources, self.destinations)
        return pair_covers(pair, source, destination, both_ways=self.both_ways)


class Network(Table):
    """``[network]``: the default of every directed link, and overrides; later ones win."""

    default: LinkSettings = Field(
        default=LinkSettings(), description="Settings of every directed link."
    )
    links: list[LinkRule] = Field(
        default=[],
        max_length=MOST_ENTRIES,
        description="Changes for some links; later ones override earlier ones.",
    )

    def settings(self, source: int, destination: int) -> LinkSettings:
        """The settings of the link from ``source`` to ``destination``."""
        settings = self.default
        for rule in self.links:
            if rule.covers(source, destination):
                settings = settings.changed(rule.values())
        return settings


class Neighbours(Table):
    """``[neighbours]``: what a robot does with what it hears."""

    on_silence: Literal["hold", "drop"] = Field(
        default="drop",
        description=(
            "Hold the last state of a silent neighbour, or drop it from the law's sums "
            "until its next message."
        ),
    )
    silence_s: PositiveSeconds = Field(
        default=0.5,
        description=("A neighbour is silent after this time without a usable message (own clock)."),
    )
