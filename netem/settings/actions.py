"""What can be done to a link at an instant, beside a :class:`formnet.netem.settings.ramp.Ramp`."""

from dataclasses import dataclass

from formnet.netem.files.overrides import Values


@dataclass(frozen=True)
class Change:
    """Put ``values`` in place; other settings stay."""

    values: Values


@dataclass(frozen=True)
class Cut:
    """Lose whatever is sent from now on; what is in flight is kept, or lost too."""

    lose_in_flight: bool = False


@dataclass(frozen=True)
class Heal:
    """End a cut."""
