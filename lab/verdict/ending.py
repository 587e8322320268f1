"""``outcome`` and ``robots``: how a run ended, and which robots took part to the end."""

from collections.abc import Sequence

from pydantic import Field

from formnet.formation.records import events
from formnet.formation.records.events import Event
from formnet.formation.records.outcome import Outcome, OutcomeKind
from formnet.lab.verdict.section import Instant, Listed, RobotId, Section


class Ending(Section):
    """How a run ended.

    The words: ``completed``; ``diverged``, the state left the finite numbers; ``interrupted`` by
    the user; ``lost``, a robot's process died; ``failed``, a robot could not go on; ``broken``,
    anything else.
    """

    kind: OutcomeKind = Field(description="The outcome in a word.")
    t_s: Instant = Field(description="The virtual time at the end.")
    robot: RobotId | None = Field(description="The robot that it is about.")
    reason: str = Field(description="Why it ended so; empty for a run that completed.")

    @property
    def planned(self) -> bool:
        """Whether the run came to an end that follows from its scenario."""
        return self.kind in ("completed", "diverged")


class Lost(Section):
    """A robot that was lost and should not have been."""

    t_s: Instant = Field(description="When.")
    robot: RobotId = Field(description="Which robot.")
    reason: str = Field(description="How it was noticed.")
    tick: int = Field(description="The first tick in which it takes no part.")


class Participants(Section):
    """Which robots the verdict is about."""

    judged: Listed[RobotId] = Field(description="Those up at the end: Eqs. 3-5 are about them.")
    down_at_the_end: Listed[RobotId] = Field(description="All others.")
    lost: Listed[Lost] = Field(description="Those lost although no fault was planned.")


def ending(outcome: Outcome) -> Ending:
    """The section ``outcome``."""
    return Ending(
        kind=outcome.kind,
        t_s=outcome.t_ns / 1e9,
        robot=outcome.robot,
        reason=outcome.reason,
    )


def participants(
    ids: Sequence[int], judged: Sequence[int], happened: Sequence[Event]
) -> Participants:
    """The section ``robots``: of ``ids``, ``judged`` were up at the end."""
    return Participants(
        judged=list(judged),
        down_at_the_end=[robot for robot in ids if robot not in judged],
        lost=[
            Lost(
                t_s=event.t_ns / 1e9,
                robot=event.robot,
                reason=event.reason,
                tick=event.tick,
            )
            for event in happened
            if isinstance(event, events.Lost)
        ],
    )
