"""The table of settings that turns an impairment on; each stands beside its impairment.

A new impairment is one file in this folder: the impairment, and a table that names its key and its
place in the order of :data:`formnet.netem.settings.links.PIPELINE`::

    class JamSettings(StageTable):
        key: ClassVar[str] = "jam"
        after: ClassVar[str] = "delay"
        every_s: Seconds = Field(default=0.0, description="Time between two jams; 0: none.")

        def stages(self) -> Stages:
            return {"jam": lambda: Jam(self.every_s)} if self.every_s else {}

Every link then has it: in scenarios, rules, changes, ramps and presets, the schema and the docs.
"""

from collections.abc import Callable, Mapping
from typing import ClassVar

from formnet.netem.core.link import Impairment
from formnet.netem.files.tables import Table

Stages = Mapping[str, Callable[[], Impairment]]
"""What makes each impairment that is on, by its name."""


class StageTable(Table):
    """A table that turns impairments on.

    ``key`` is what it is called in a link's settings, ``after`` the impairment that its own (of
    the name ``key``) follow; both only where :mod:`formnet.netem.settings.links` does not name it.
    """

    key: ClassVar[str] = ""
    after: ClassVar[str] = ""

    def stages(self) -> Stages:
        """What it turns on; nothing if it is off."""
        raise NotImplementedError

    @property
    def delays(self) -> bool:
        """Whether it makes delays differ from message to message."""
        return False

    @property
    def loses(self) -> bool:
        """Whether it may lose or damage messages."""
        return False
