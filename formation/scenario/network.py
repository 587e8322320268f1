"""``[network]`` and ``[neighbours]``: the links, and what a robot does with what they deliver."""

from collections.abc import Sequence
from functools import cached_property
from typing import Literal

from pydantic import ConfigDict, Field

from formnet.formation.plan.reach import Named
from formnet.formation.plan.selectors import Robots
from formnet.netem.files.tables import STRICT, PositiveSeconds, Table
from formnet.netem.settings.links import LinkOverrides, LinkSettings, SettingError

MOST_VARIANTS = 20_000
"""Settings of links that differ, with those on the way to them, rule by rule."""
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

    @cached_property
    def reach(self) -> Named:
        """The links that the rule is about."""
        return Named([(self.sources, self.destinations)], both_ways=self.both_ways)


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

    @cached_property
    def variants(self) -> "Variants":
        """The different settings that links have."""
        return Variants(self.default, self.links)

    def settings(self, source: int, destination: int) -> LinkSettings:
        """The settings of the link from ``source`` to ``destination``.

        Raises:
            BadRule: a rule does not go with what the link had before.
        """
        return self.variants.settings[self.variants.number(source, destination)]


class BadRule(ValueError):
    """A rule that does not go with the settings of a link: ``index`` says which, ``error`` why."""

    def __init__(self, index: int, error: SettingError) -> None:
        self.index, self.error = index, error
        super().__init__(str(error))


class TooManyVariants(ValueError):
    """Links differ in more ways than :data:`MOST_VARIANTS`."""


class Variants:
    """The different settings that links have: links that the same rules are about share theirs.

    What a rule makes of some settings is worked out once, however many links have them.
    """

    def __init__(self, default: LinkSettings, rules: Sequence[LinkRule]) -> None:
        self.settings = [default]
        self._rules = rules
        self._after: dict[tuple[int, int], int] = {}  # by the numbers of settings and rule
        self._numbers: dict[tuple[int, int], int] = {}  # by link

    def number(self, source: int, destination: int) -> int:
        """Which of ``settings`` the link from ``source`` to ``destination`` has.

        Raises:
            BadRule: a rule does not go with what the link had before.
            TooManyVariants: there would be too many.
        """
        link = (source, destination)
        found = self._numbers.get(link)
        if found is None:
            found = 0
            for index, rule in enumerate(self._rules):
                if rule.reach.covers(*link):
                    found = self._changed(found, index)
            self._numbers[link] = found
        return found

    def _changed(self, number: int, index: int) -> int:
        step = (number, index)
        if step not in self._after:
            if len(self.settings) > MOST_VARIANTS:
                raise TooManyVariants
            try:
                self.settings.append(
                    self.settings[number].changed(self._rules[index].values(plain=False))
                )
            except SettingError as error:
                raise BadRule(index, error) from None
            self._after[step] = len(self.settings) - 1
        return self._after[step]


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
