"""Delay: how long a message travels."""

from dataclasses import dataclass
from random import Random

from netem.link import Transit


@dataclass(frozen=True, slots=True)
class ConstantDelay:
    """Every message travels ``delay_ns`` nanoseconds (Theorems 5 and 6)."""

    delay_ns: int
    name: str = "delay"

    def __post_init__(self) -> None:
        if self.delay_ns < 0:
            raise ValueError(f"delay_ns must be >= 0, got {self.delay_ns}")

    def apply(self, copies: list[Transit], random: Random) -> list[Transit]:
        for copy in copies:
            copy.due_ns += self.delay_ns
        return copies


@dataclass(frozen=True, slots=True)
class UniformDelay:
    """Travel time uniform on the whole nanoseconds from ``low_ns`` to ``high_ns``, both included.

    ``low`` and ``high`` are the ends of the range, not tc-netem's half-range
    "jitter". Later messages may overtake earlier ones.
    """

    low_ns: int
    high_ns: int
    name: str = "delay"

    def __post_init__(self) -> None:
        if not 0 <= self.low_ns <= self.high_ns:
            raise ValueError(
                f"need 0 <= low_ns <= high_ns, got low_ns={self.low_ns}, high_ns={self.high_ns}"
            )

    def apply(self, copies: list[Transit], random: Random) -> list[Transit]:
        for copy in copies:
            copy.due_ns += self.low_ns + int(random.random() * (self.high_ns - self.low_ns + 1))
        return copies
