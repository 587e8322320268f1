"""How a run ends."""

from dataclasses import dataclass
from typing import Any, Literal, get_args

from formnet.formation.records.checked import Nanoseconds, RobotId, Robots, read
from formnet.formation.records.events import Severity

OutcomeKind = Literal["completed", "diverged", "interrupted", "lost", "failed", "broken"]
OUTCOMES: tuple[OutcomeKind, ...] = get_args(OutcomeKind)


@dataclass(frozen=True)
class Outcome:
    """How the run ended, at ``t_ns`` of its time; the last line of ``events.jsonl``.

    ``kind`` is ``completed``, ``diverged``, ``interrupted``, ``lost`` (a robot
    died), ``failed`` (a robot could not go on) or ``broken`` (the rest).
    """

    kind: OutcomeKind
    t_ns: Nanoseconds
    robot: RobotId | None
    reason: str

    @property
    def name(self) -> str:
        """As in ``events.jsonl``."""
        return self.kind

    @property
    def severity(self) -> Severity:
        """As an event's."""
        if self.kind == "completed":
            return Severity.INFO
        return Severity.WARNING if self.kind == "interrupted" else Severity.ERROR

    @property
    def details(self) -> dict[str, Any]:
        """All but kind and time, as it stands in ``events.jsonl``."""
        return {"robot": self.robot, "reason": self.reason}

    @property
    def words(self) -> str:
        """The details for people; empty where the kind says it all."""
        who = "" if self.robot is None else f"robot {self.robot}: "
        return f"{who}{self.reason}"


def outcome(kind: object, t_ns: int, details: object, robots: Robots = None) -> Outcome:
    """The outcome of this kind with these details (:attr:`Outcome.details`).

    Raises:
        Malformed: there is no such outcome, or it has other details.
    """
    return read(Outcome, details, robots, "outcome", kind=kind, t_ns=t_ns)
