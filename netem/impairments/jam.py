"""Jamming: at regular times the channel carries nothing for a while."""

from random import Random
from typing import ClassVar

from pydantic import Field

from formnet.netem.core.link import Impairment
from formnet.netem.core.transit import LOST_RANDOM, Transit
from formnet.netem.files.tables import Seconds, nanoseconds
from formnet.netem.impairments.stage import Stages, StageTable


class Jam:
    """What is sent in the first tenth of every ``every_ns`` is lost."""

    name = "jam"

    def __init__(self, every_ns: int) -> None:
        self._every_ns = every_ns

    def twin(self) -> "Jam":
        return self

    def inherit(self, before: Impairment) -> None:
        """Nothing: no message depends on another."""

    def apply(self, copy: Transit, random: Random) -> None:
        if copy.sent_ns % self._every_ns < self._every_ns // 10:
            copy.fate = LOST_RANDOM


class JamSettings(StageTable):
    """``jam = { every_s = 10.0 }``"""

    key: ClassVar[str] = "jam"
    after: ClassVar[str] = "delay"

    every_s: Seconds = Field(default=0.0, description="Time between two jams; 0: none.")

    def stages(self) -> Stages:
        return {"jam": lambda: Jam(nanoseconds(self.every_s))} if self.every_s else {}

    @property
    def loses(self) -> bool:
        return self.every_s > 0
