"""``network`` and ``ramp``: links whose settings change."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from formnet.formation.plan.selection import LinkSelection
from formnet.netem.files.tables import PositiveSeconds, Table, nanoseconds
from formnet.netem.settings.actions import Change
from formnet.netem.settings.links import LinkOverrides
from formnet.netem.settings.ramp import Ramp, checked_parameter
from formnet.netem.settings.timeline import Action


class NetworkAction(LinkSelection, LinkOverrides):
    """``action = "network"``: exactly the settings that are named change, from that instant."""

    action: Literal["network"] = Field(description="Changes exactly the settings given here.")

    def effect(self) -> Action:
        """What it does to each of its links."""
        return Change(self.values())

    def describe(self) -> str:
        """In words."""
        named = ", ".join(f"{key} {_words(value)}" for key, value in self.named().items())
        return f"network {self.links_in_words}: {named or 'nothing'}"


class RampAction(LinkSelection):
    """``action = "ramp"``: one number moves from ``from_value`` to ``to_value``."""

    action: Literal["ramp"] = Field(description="Changes one number of links linearly.")
    parameter: Annotated[str, AfterValidator(checked_parameter)] = Field(
        description="The number, such as `delay.mean_s`."
    )
    from_value: float = Field(description="Value at the beginning.")
    to_value: float = Field(description="Value at the end and from then on.")
    duration_s: PositiveSeconds = Field(description="Duration of the ramp.")

    def effect(self) -> Action:
        """What it does to each of its links."""
        return Ramp(self.parameter, self.from_value, self.to_value, nanoseconds(self.duration_s))

    def describe(self) -> str:
        """In words."""
        return (
            f"ramp {self.links_in_words}: {self.parameter} from {self.from_value:g} to "
            f"{self.to_value:g} in {self.duration_s:g} s"
        )


def _words(value: object) -> str:
    """A table of settings as it would be written, without what is not named."""
    if not isinstance(value, Table):
        return str(value).lower() if isinstance(value, bool) else f"{value}"
    items = value.model_dump(exclude_none=True, exclude_defaults=True).items()
    return "{ " + ", ".join(f"{key} = {_short(item)}" for key, item in items) + " }"


def _short(item: object) -> str:
    return f"[{len(item)} numbers]" if isinstance(item, list) else f"{item}"
