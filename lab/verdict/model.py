"""The verdict on a run: the model of ``verdict.json``, how it is computed, and what follows."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Final, Literal

from pydantic import AfterValidator, Field

from formnet.exact import ARITHMETIC_VERSION
from formnet.formation.paper.status import Status
from formnet.formation.scenario.expect import CRITERIA, ERRORS, LYAPUNOV, Expect
from formnet.lab.runs.build import versions
from formnet.lab.verdict.claims import Claims, Judgement, claims
from formnet.lab.verdict.ending import Ending, Participants, ending, participants
from formnet.lab.verdict.motion import Motion, motion
from formnet.lab.verdict.realtime import Timing, timing
from formnet.lab.verdict.section import Instant, Listed, PositiveCount, Section, finite
from formnet.lab.verdict.stability import Stability, stability
from formnet.lab.verdict.traffic import LinkTraffic, Messages, links, messages

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from formnet.lab.runs.recording import Collected

HOLDS, FAILS, NOT_JUDGED, OBSERVED = "holds", "FAILS", "not judged", "observed"
"""How a run stands that completed (or that diverged as it should): see :meth:`Verdict.standing`."""
FORMAT: Final = 2
"""The format of the verdicts that are written; see :mod:`lab.verdict.files`."""


def _sha256(value: str) -> str:
    if len(value) != 64 or not set(value) <= set("0123456789abcdef"):
        raise ValueError("must be 64 hexadecimal digits")
    return value


Sha256 = Annotated[
    str, AfterValidator(_sha256), Field(json_schema_extra={"pattern": "^[0-9a-f]{64}$"})
]


class Verdict(Section):
    """The contents of ``verdict.json``. Numbers that are not finite are null."""

    format: Literal[2] = Field(description="The format of this file.")
    scenario: str = Field(description="The scenario's name.")
    mode: str = Field(description="`inline` (one process) or `distributed`.")
    seed: int = Field(description="The scenario's seed.")
    outcome: Ending = Field(description="How the run ended.")
    robots: Participants = Field(description="Which robots the verdict is about.")
    warnings: Listed[str] = Field(description="What was warned of before the run.")
    theorem: int | None = Field(
        description="The theorem of the paper that the scenario falls under, if any."
    )
    proof: Status | None = Field(
        default=None,
        description="What is proved of the scenario: `proved`, with its law; `proved with "
        'compensation`, with `law.cross_term = "compensated"` only, which it does not have; `not '
        "covered`, by any theorem. Null in verdicts from before there was this field.",
    )
    why: str = Field(
        description="Why it falls under that theorem, or under none, and why that is proved of it."
    )
    formation_error_m: float | None = Field(description="The error of Eq. 3 at the end.")
    heading_error_rad: float | None = Field(description="The error of Eq. 4 at the end.")
    centroid_error_m: float | None = Field(description="The error of Eq. 5 at the end.")
    window_s: Instant = Field(description="The length of the stretch at the end that is judged.")
    settling_time_s: Instant | None = Field(
        description="From when on all errors that shall be small (without claims: all) stayed "
        "within their tolerances; null if one did not, or the run did not complete."
    )
    claims: Claims = Field(description="What was claimed of the run, and whether it holds.")
    motion: Motion | None = Field(description="The extremes of the motion.")
    lyapunov: Stability | None = Field(description="V along the run; null where it is not defined.")
    trajectory_sha256: Sha256 = Field(
        description="SHA-256 over every row of states.parquet: two runs have the same if and only "
        "if every bit of every sample is the same."
    )
    arithmetic: PositiveCount = Field(
        description="The version of the arithmetic that the bits come from; it goes up whenever "
        "they change."
    )
    messages: Messages = Field(description="The messages of all links together.")
    links: Listed[LinkTraffic] = Field(description="Each direction of each link.")
    simulated_s: Instant = Field(description="The virtual time that was simulated.")
    wall_s: float = Field(description="The wall time from the first tick to the last.")
    realtime_factor: float | None = Field(description="`simulated_s` by `wall_s`.")
    realtime: Timing | None = Field(
        description="How well a run in real time kept its time; null in virtual time."
    )
    versions: dict[str, str | bool] = Field(
        description="What the run was made with; `compiled`: whether formnet was."
    )
    code: dict[str, Sha256] = Field(
        default={},
        description="The files of code that the scenario names, each with the SHA-256 of what was "
        "executed of it.",
    )

    def error(self, name: str) -> float | None:
        """The error of one of Eqs. 3-5 at the end, in its unit."""
        value: float | None = getattr(self, ERRORS[name].error_key)
        return value

    @property
    def claimed(self) -> dict[str, bool | None]:
        """The claims that ``[expect]`` makes, and whether each holds (None: not judged)."""
        return {
            name: claim.holds for name, claim in self.claims.items() if claim.expected is not None
        }

    @property
    def told(self) -> dict[str, Judgement]:
        """The claims that there is something to say of, in order: V only if known or claimed."""
        silent = self.lyapunov is None and self.claims[LYAPUNOV.name].expected is None
        return {
            name: self.claims[name] for name in CRITERIA if not (silent and name == LYAPUNOV.name)
        }

    @property
    def standing(self) -> str:
        """How a run stands in a word: whether what was claimed holds, or else how the run ended.

        OBSERVED: it completed with every robot, and nothing was claimed.
        """
        holds = self.claimed.values()
        if not self.outcome.planned:
            return self.outcome.kind
        if holds and all(holds):
            return HOLDS
        if self.outcome.kind == "diverged":
            return self.outcome.kind
        if not holds:
            return "lost" if self.robots.lost else OBSERVED
        return FAILS if False in holds else NOT_JUDGED

    @property
    def passed(self) -> bool:
        """Whether all that was claimed holds or, without claims, it completed with every robot."""
        return self.standing in (HOLDS, OBSERVED)

    @property
    def settled(self) -> str:
        """When a run settled, in words: ``never`` if it completed and an error did not stay small.

        A dash if it ended in another way, or if nobody was judged.
        """
        if self.settling_time_s is not None:
            return f"{self.settling_time_s:.2f} s"
        return "never" if self.outcome.kind == "completed" and self.robots.judged else "–"

    @property
    def rises_in_words(self) -> str | None:
        """When V rose, and why; None where it did not."""
        if self.lyapunov is None:
            return None
        return self.lyapunov.in_words(diverged=self.outcome.kind == "diverged")

    @property
    def unplanned_s(self) -> float | None:
        """When the first thing happened that the scenario does not say (s); None if nothing did."""
        times = [lost.t_s for lost in self.robots.lost]
        if not self.outcome.planned:
            times.append(self.outcome.t_s)
        return min(times, default=None)

    def other_versions(self) -> list[str]:
        """What the run was made with that is another now."""
        return [
            f"{name}: recorded with {self.versions.get(name)}, now {value}"
            for name, value in versions().items()
            if self.versions.get(name) != value
        ]


def judge(
    recording: "Collected",
    *,
    mode: str,
    wall_s: float,
    warnings: Sequence[str] = (),
    code: Mapping[str, str] | None = None,
) -> Verdict:
    """The verdict on a run that ended; ``warnings`` are those that were given before it, and
    ``code`` the files that were executed in it, with the SHA-256 of each.

    Equations 3-5 are about the robots that are up at the end; where none is, nothing is judged.
    """
    from formnet.formation.paper.theory import assess  # loads NumPy
    from formnet.lab.judge import errors
    from formnet.lab.runs.recording import trajectory_sha256

    scenario, outcome = recording.scenario, recording.outcome
    assert outcome is not None
    expect = scenario.expect or Expect()
    trajectories = recording.trajectories
    judged = recording.up_at(outcome.t_ns)
    found = errors.error_series(scenario, trajectories, judged)
    series = errors.by_claim(found)
    window = errors.in_window(scenario, trajectories.t_ns, outcome.t_ns)
    asked = [name for name in ERRORS if expect.claims[name]] or list(ERRORS)
    end, rising, assessment = ending(outcome), stability(recording), assess(scenario)
    return Verdict(
        format=FORMAT,
        scenario=scenario.name,
        mode=mode,
        seed=scenario.seed,
        outcome=end,
        robots=participants(scenario.ids, judged, recording.events),
        warnings=list(warnings),
        theorem=assessment.theorem,
        proof=assessment.proof,
        why=assessment.why,
        formation_error_m=_last(found.formation_m),
        heading_error_rad=_last(found.heading_rad),
        centroid_error_m=_last(found.centroid_m),
        window_s=errors.window_s(scenario),
        settling_time_s=errors.settling_time(
            trajectories.t_s, {name: series[name] for name in asked}, expect.tolerances
        )
        if end.kind == "completed"
        else None,
        claims=claims(
            expect,
            end,
            {name: values[window] for name, values in series.items()},
            rising,
            anybody=bool(judged),
        ),
        motion=motion(recording.motion),
        lyapunov=rising,
        trajectory_sha256=trajectory_sha256(recording.samples),
        arithmetic=ARITHMETIC_VERSION,
        messages=messages(recording.events, recording.link_rows),
        links=links(recording.link_rows, outcome.t_ns),
        simulated_s=end.t_s,
        wall_s=wall_s,
        realtime_factor=end.t_s / wall_s if wall_s > 0 else None,
        realtime=timing(recording.events),
        versions=versions(),
        code=dict(code or {}),
    )


def _last(series: "NDArray[np.float64]") -> float | None:
    return finite(series[-1]) if len(series) else None
