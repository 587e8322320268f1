"""How long each measurement of a run is; everything follows from ``--ticks`` and ``--rounds``."""

from dataclasses import dataclass

from rich.console import Console

LEAST_TICKS = 100


@dataclass(frozen=True)
class Plan:
    """``ticks`` a round for formnet and the bare exchange, ``rounds`` of each comparison."""

    ticks: int
    rounds: int
    skip_helics: bool
    helics_core: str
    console: Console

    @property
    def helics_ticks(self) -> int:
        """Fewer: HELICS is several times slower, and no start-up is in the time."""
        return max(LEAST_TICKS, self.ticks // 4)

    @property
    def inline_ticks(self) -> int:
        """More: an inline tick is several times cheaper."""
        return 5 * self.ticks

    def scaling_ticks(self, robots: int) -> int:
        """Fewer for more robots, so that every size is timed for about as long."""
        return max(LEAST_TICKS, 10 * self.ticks // robots)

    @property
    def scaling_rounds(self) -> int:
        """Fewer: starting 41 processes takes several times as long as the run."""
        return min(3, self.rounds)

    @property
    def throughput_messages(self) -> int:
        """A link takes some microseconds a message."""
        return 100 * self.ticks

    @property
    def paced_s(self) -> int:
        """Seconds of a run in real time."""
        return max(2, self.ticks // 100)

    @property
    def paced_rounds(self) -> int:
        """Fewer: they take their time."""
        return min(3, self.rounds)

    def say(self, what: str) -> None:
        """Tell what is being measured."""
        self.console.print(what, style="dim", highlight=False)
