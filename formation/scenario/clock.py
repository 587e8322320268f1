"""``[clock]``: how time passes in a run."""

from typing import Literal

from pydantic import Field

from formnet.netem.files.tables import PositiveSeconds, Table, nanoseconds


class Clock(Table):
    """``[clock]``: virtual time in lockstep or real time, and the periods of the sampled loop."""

    mode: Literal["lockstep", "realtime"] = Field(
        default="lockstep", description="Exactly repeatable virtual time, or real time."
    )
    control_period_s: PositiveSeconds = Field(
        default=0.001, description="The law is evaluated once per period, and its command is held."
    )
    broadcast_period_s: PositiveSeconds = Field(
        default=0.01,
        description=(
            "Robots broadcast their states at this period; a multiple of control_period_s."
        ),
    )
    sync_bound_s: PositiveSeconds = Field(
        default=0.005,
        description=("In real time, report robots whose clock uncertainty exceeds this bound."),
    )

    @property
    def control_period_ns(self) -> int:
        return nanoseconds(self.control_period_s)

    @property
    def broadcast_period_ns(self) -> int:
        return nanoseconds(self.broadcast_period_s)

    @property
    def broadcast_every(self) -> int:
        """Control ticks per broadcast."""
        return self.broadcast_period_ns // self.control_period_ns
