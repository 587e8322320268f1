"""Whether a recorded run, run again, gave the same bits, as far as they must be the same."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from formnet.formation.records.rows import Sample
from formnet.lab.judge.verdict import versions
from formnet.lab.runs.difference import Difference, first_difference, other_extremes
from formnet.lab.runs.recorded import Recorded
from formnet.lab.runs.recording import Collected, trajectory_sha256
from formnet.netem.settings.timeline import NEVER


class Repetition(NamedTuple):
    """How a run compares with its record, each first value the recorded one.

    ``first`` is where the tables differ first and ``motion`` the first extreme that differs, in
    words; None where every bit is the same. ``sealed``: the recorded samples have the SHA-256
    that the verdict gives.
    """

    first: Difference | None
    motion: str | None
    sealed: bool

    @property
    def identical(self) -> bool:
        """Whether nothing differs."""
        return self.first is None and self.motion is None and self.sealed


def compared(recorded: Recorded, again: Collected, until_ns: int) -> Repetition:
    """Compare the samples before ``until_ns`` (ns); of a whole run (NEVER) the messages, too."""
    judged = recorded.verdict
    assert judged is not None
    period_ns = recorded.scenario.clock.control_period_ns
    first = first_difference(
        before(recorded.samples, until_ns), before(again.samples, until_ns), period_ns
    )
    motion = None
    if until_ns == NEVER:  # what becomes of messages depends on what comes after
        first = first or first_difference(recorded.link_rows, again.sorted_link_rows, period_ns)
        motion = other_extremes(judged.get("motion"), again.motion)
    sealed = trajectory_sha256(recorded.samples) == judged["trajectory_sha256"]
    return Repetition(first, motion, sealed)


def planned_until_ns(judged: Mapping[str, Any]) -> int:
    """Up to when (ns) nothing happened that the scenario does not say; NEVER if nothing did."""
    unplanned = [item["t_s"] for item in judged["robots"]["lost"]]
    if judged["outcome"]["kind"] not in ("completed", "diverged"):
        unplanned.append(judged["outcome"]["t_s"])
    return min((round(t_s * 1e9) for t_s in unplanned), default=NEVER)


def what_happened(judged: Mapping[str, Any], at_ns: int) -> str:
    """What the scenario does not say, and is not compared."""
    outcome = judged["outcome"]
    if outcome["kind"] in ("completed", "diverged") or round(outcome["t_s"] * 1e9) > at_ns:
        return "something unplanned happened"
    return f"the recorded run ended ({outcome['kind']}; whether it ends so again is not checked)"


def before(samples: Sequence[Sample], until_ns: int) -> list[Sample]:
    """The samples of instants before ``until_ns`` (ns)."""
    return [sample for sample in samples if sample.t_ns < until_ns]


def other_versions(judged: Mapping[str, Any]) -> list[str]:
    """What the recorded run was made with that is another now."""
    then, now = judged.get("versions", {}), versions()
    return [
        f"{name}: recorded with {then.get(name)}, now {value}"
        for name, value in now.items()
        if then.get(name) != value
    ]
