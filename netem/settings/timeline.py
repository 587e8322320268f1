"""What happens to one link, and when: changes of settings, ramps, cuts.

Pure, as the link is: whoever owns the clock calls :meth:`Timeline.advance`.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from formnet.netem.core.link import Link
from formnet.netem.core.transit import Transit
from formnet.netem.files.overrides import Values
from formnet.netem.settings.actions import Change, Cut, Heal
from formnet.netem.settings.links import LinkSettings, SettingError
from formnet.netem.settings.ramp import Ramp

Action = Change | Ramp | Cut | Heal

NEVER = 2**63 - 1


class Timeline:
    """Holds the settings of one link over time and keeps ``link`` to them.

    A message sent at s meets whatever was to be done at or before s; one due at
    or before the instant of a cut has arrived. Actions of one instant come in
    the order given. A change ends the ramps of what it names. Without ``link``
    it only says what the settings are (for plans and checks).

    Attributes:
        settings: those of the latest instant asked for.
        is_cut: whether the link is cut at it.
        next_ns: when the next action comes or the next ramp ends; NEVER if none does.
    """

    def __init__(
        self,
        settings: LinkSettings,
        actions: Iterable[tuple[int, Action]] = (),
        link: Link | None = None,
    ) -> None:
        self.settings = settings
        self.is_cut = False
        self._link = link
        self._held = settings  # what the link goes by
        self._ahead = deque(sorted(actions, key=lambda item: item[0]))
        self._ramps: dict[str, tuple[int, Ramp]] = {}  # by parameter: since when, which
        self.next_ns = self._next()

    @property
    def ramping(self) -> bool:
        """Whether the settings change from message to message."""
        return bool(self._ramps)

    def advance(self, now_ns: int) -> list[Transit]:
        """Do all that is to be done up to ``now_ns``; returns what a cut lost in flight.

        Raises:
            SettingError: a change or ramp that the settings do not admit.
        """
        lost: list[Transit] = []
        while self._ahead and self._ahead[0][0] <= now_ns:
            at_ns, action = self._ahead.popleft()
            lost += self._do(at_ns, action)
        self._follow_ramps(now_ns)
        self._adjust_link()
        self.next_ns = self._next()
        return lost

    def do(self, now_ns: int, action: Action) -> list[Transit]:
        """Do something unplanned now, after all that is to be done up to now.

        Returns and raises as :meth:`advance` does; after an error nothing has changed.
        """
        lost = self.advance(now_ns)
        lost += self._do(now_ns, action)
        return lost + self.advance(now_ns)

    def _do(self, at_ns: int, action: Action) -> list[Transit]:
        self._follow_ramps(at_ns)
        if isinstance(action, Change):
            with _caused_by(action):
                self.settings = self.settings.changed(action.values)
            for parameter in [p for p in self._ramps if _names(action.values, p)]:
                del self._ramps[parameter]
        elif isinstance(action, Ramp):
            with _caused_by(action):  # an end that cannot be reached should not be begun
                self.settings.changed({action.parameter: action.at(action.duration_ns)})
                self.settings = self.settings.changed({action.parameter: action.at(0)})
            self._ramps[action.parameter] = (at_ns, action)
        elif isinstance(action, Cut):
            self.is_cut = True
            if self._link is not None:
                return self._link.cut(at_ns, lose_in_flight=action.lose_in_flight)
        else:
            self.is_cut = False
            if self._link is not None:
                self._link.heal()
        return []

    def _follow_ramps(self, now_ns: int) -> None:
        for parameter, (since_ns, ramp) in list(self._ramps.items()):
            with _caused_by(ramp):
                self.settings = self.settings.changed({parameter: ramp.at(now_ns - since_ns)})
            if now_ns >= since_ns + ramp.duration_ns:
                del self._ramps[parameter]

    def _adjust_link(self) -> None:
        if self._link is not None and self.settings != self._held:
            self._link.change(
                self.settings.impairments(self._held, self._link.impairments),
                self.settings.duplicates(),
            )
            self._held = self.settings

    def _next(self) -> int:
        ends = [since_ns + ramp.duration_ns for since_ns, ramp in self._ramps.values()]
        return min([*ends, self._ahead[0][0] if self._ahead else NEVER])


@contextmanager
def _caused_by(action: Action) -> Iterator[None]:
    try:
        yield
    except SettingError as error:
        error.cause = action
        raise


def _names(values: Values, parameter: str) -> bool:
    """Whether ``values`` says what the number ``parameter`` is to be."""
    return not values.keys().isdisjoint((parameter, parameter.partition(".")[0]))
