"""The verdict on a run: errors of Eqs. 3-5, when they settled, and whether each claim held."""

import json
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formnet.formation.paper.geometry import Errors, errors
from formnet.formation.paper.theory import CLAIMS, assess
from formnet.formation.records.events import Lost, Refused, Rejected, Timing
from formnet.formation.scenario.expect import Expect
from formnet.formation.scenario.model import Scenario
from formnet.lab.judge import lyapunov
from formnet.lab.judge.rises import ROUNDING, rises, standing_causes
from formnet.lab.runs import files
from formnet.lab.runs.build import compiled
from formnet.lab.runs.recording import Collected, Trajectories, trajectory_sha256
from formnet.netem.core.statistics import Fate, summarise
from formnet.netem.files.tables import nanoseconds

HOLDS, FAILS, NOT_JUDGED, OBSERVED = "holds", "FAILS", "not judged", "observed"
"""How a run stands that completed (or that diverged as it should): see :func:`standing`."""


def of(
    recording: Collected, *, mode: str, wall_s: float, warnings: Sequence[str] = ()
) -> dict[str, Any]:
    """The contents of ``verdict.json`` (numbers that are not finite become null).

    A claim is judged over the last ``expect.window_s`` of the run: it is
    observed if the error stays within its tolerance at every recorded instant
    of that stretch, and holds if that is what was expected. In a run that
    diverged no equation holds; one that ended early in another way is not judged.
    The equations are about the robots that are up at the end; where none is, nothing is judged.
    ``lyapunov`` is judged over the whole run (see :mod:`lab.judge.lyapunov`).
    ``motion`` has the extremes of the whole run (see :mod:`plant.extremes`); None without any.
    ``warnings`` are those that were given before the run.
    """
    scenario, outcome = recording.scenario, recording.outcome
    assert outcome is not None
    trajectories = recording.trajectories
    judged = recording.up_at(outcome.t_ns)
    found = error_series(scenario, trajectories, judged)
    expect = scenario.expect or Expect()
    tolerances = tolerances_of(expect)
    completed = outcome.kind == "completed"
    window = trajectories.t_ns >= outcome.t_ns - nanoseconds(window_s(scenario))
    ended = bool(judged) and (completed or outcome.kind == "diverged")
    claims = {}
    for claim, series in by_claim(found).items():
        expected = getattr(expect, claim)
        within = bool(completed and np.all(series[window] <= tolerances[claim]))
        observed = within if ended else None
        claims[claim] = {
            "expected": expected,
            "observed": observed,
            "holds": None if expected is None or observed is None else observed == expected,
            "tolerance": tolerances[claim],
            "largest_in_window": _number(series[window].max()) if window.any() else None,
        }
    rising = _lyapunov(recording)
    claims["lyapunov"] = _lyapunov_claim(
        rising if ended else None, expect.lyapunov, diverged=outcome.kind == "diverged"
    )
    asked = [claim for claim in CLAIMS if getattr(expect, claim)] or list(CLAIMS)
    assessment = assess(scenario)
    simulated_s = outcome.t_ns / 1e9
    return {
        "scenario": scenario.name,
        "mode": mode,
        "seed": scenario.seed,
        "outcome": {
            "kind": outcome.kind,
            "t_s": simulated_s,
            "robot": outcome.robot,
            "reason": outcome.reason,
        },
        "robots": {
            "judged": judged,
            "down_at_the_end": [robot for robot in scenario.ids if robot not in judged],
            "lost": [
                {"t_s": event.t_ns / 1e9, **event.details}
                for event in recording.events
                if isinstance(event, Lost)
            ],
        },
        "warnings": list(warnings),
        "theorem": assessment.theorem,
        "why": assessment.why,
        "formation_error_m": _last(found.formation_m),
        "heading_error_rad": _last(found.heading_rad),
        "centroid_error_m": _last(found.centroid_m),
        "window_s": window_s(scenario),
        "settling_time_s": settling_time(
            trajectories.t_s, {c: s for c, s in by_claim(found).items() if c in asked}, tolerances
        )
        if completed
        else None,
        "claims": claims,
        "motion": recording.motion,
        "lyapunov": rising,
        "trajectory_sha256": trajectory_sha256(recording.samples),
        "messages": _messages(recording),
        "links": _links(recording, outcome.t_ns),
        "simulated_s": simulated_s,
        "wall_s": wall_s,
        "realtime_factor": simulated_s / wall_s if wall_s > 0 else None,
        "realtime": next((e.details for e in recording.events if isinstance(e, Timing)), None),
        "versions": versions(),
    }


def save(verdict: Mapping[str, Any], folder: Path) -> None:
    """Write ``verdict.json`` into ``folder``, whole or not at all. Raises OSError."""
    text = json.dumps(verdict, indent=2, allow_nan=False, ensure_ascii=False)
    files.replace(folder / "verdict.json", text + "\n")


def claimed(verdict: Mapping[str, Any]) -> dict[str, bool | None]:
    """The claims that ``[expect]`` makes, and whether each holds (None: not judged)."""
    return {
        name: claim["holds"]
        for name, claim in verdict["claims"].items()
        if claim["expected"] is not None
    }


def standing(verdict: Mapping[str, Any]) -> str:
    """How a run stands in a word: whether what was claimed holds, or else how the run ended.

    OBSERVED: it completed with every robot, and nothing was claimed.
    """
    kind = str(verdict["outcome"]["kind"])
    holds = claimed(verdict).values()
    if kind not in ("completed", "diverged"):
        return kind
    if holds and all(holds):
        return HOLDS
    if kind == "diverged":
        return kind
    if not holds:
        return "lost" if verdict["robots"]["lost"] else OBSERVED
    return FAILS if False in holds else NOT_JUDGED


def passed(verdict: Mapping[str, Any]) -> bool:
    """Whether all that was claimed holds or, without claims, the run completed with every robot."""
    return standing(verdict) in (HOLDS, OBSERVED)


def error_series(
    scenario: Scenario, trajectories: Trajectories, robots: Sequence[int] | None = None
) -> Errors:
    """The three errors at every recorded instant, each (n_samples,).

    They are those of ``robots`` (ids; None: of all); NaN if that is nobody.
    """
    kept = [k for k, robot in enumerate(scenario.ids) if robots is None or robot in robots]
    if not len(trajectories.t_s) or not kept:
        unknown = np.full(len(trajectories.t_s), np.nan)
        return Errors(unknown, unknown, unknown)
    with np.errstate(over="ignore", invalid="ignore"):  # a diverging run overflows
        return errors(
            trajectories.positions_m[:, kept],
            trajectories.headings_rad[:, kept],
            scenario.offsets_m[kept],
        )


def by_claim(found: Errors) -> dict[str, NDArray[np.float64]]:
    """The errors under the names of the claims they decide."""
    return dict(zip(CLAIMS, found, strict=True))


def tolerances_of(expect: Expect) -> dict[str, float]:
    """Each claim's tolerance, in the unit of its error."""
    return {
        "formation": expect.formation_tolerance_m,
        "heading": expect.heading_tolerance_rad,
        "centroid": expect.centroid_tolerance_m,
    }


def window_s(scenario: Scenario) -> float:
    """How long before the end the claims must hold (see ``scenario.Expect``)."""
    if scenario.expect is not None and scenario.expect.window_s is not None:
        return scenario.expect.window_s
    return max(0.1 * scenario.duration_s, scenario.clock.broadcast_period_s)


def settling_time(
    t_s: NDArray[np.float64],
    series: Mapping[str, NDArray[np.float64]],
    tolerances: Mapping[str, float],
) -> float | None:
    """When every error in ``series`` entered its tolerance for good; None if one did not."""
    outside = np.zeros(len(t_s), dtype=bool)
    for claim, values in series.items():
        outside |= ~(values <= tolerances[claim])
    if not len(t_s) or outside[-1]:
        return None
    last_outside = np.flatnonzero(outside)
    return float(t_s[last_outside[-1] + 1]) if len(last_outside) else float(t_s[0])


def settled(verdict: Mapping[str, Any]) -> str:
    """When a run settled, in words: ``never`` if it completed and its errors did not stay small.

    A dash if it ended in another way, or if nobody was judged.
    """
    at_s = verdict["settling_time_s"]
    if at_s is not None:
        return f"{at_s:.2f} s"
    judged = verdict["outcome"]["kind"] == "completed" and verdict["robots"].get("judged")
    return "never" if judged else "–"


def versions() -> dict[str, str | bool]:
    """What produced a run; ``compiled`` says whether the install had a C compiler (setup.py)."""
    found: dict[str, str | bool] = {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "compiled": compiled(),
    }
    for package in ("formnet", "eclipse-zenoh", "numpy", "msgpack"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # run from a checkout that is not installed
            found[package] = "unknown"
    return found


def _lyapunov(recording: Collected) -> dict[str, Any] | None:
    """V along the run and every rise of it; None where it cannot be had."""
    found = lyapunov.curve(recording)
    if found is None:
        return None
    first = int(np.argmax(found.whole)) if found.whole.any() else None
    return {
        "equation": lyapunov.equation(recording.scenario),
        "from_s": None if first is None else float(found.t_s[first]),
        "initial": None if first is None else _number(found.v[first]),
        "final": _number(found.v[-1]),
        "budget": None if first is None else _number(found.budget[first + 1 :].sum()),
        "may_rise_by": standing_causes(recording.scenario),
        "rises": [
            {
                name: _number(value) if name.endswith("gain") else value
                for name, value in rise._asdict().items()
            }
            for rise in rises(recording, found)
        ],
    }


def rises_in_words(verdict: Mapping[str, Any]) -> str | None:
    """When V rose first and, in a run that diverged, last, and why; None where it did not."""
    rising = verdict["lyapunov"]
    if rising is None or not rising["rises"]:
        return None
    rises = rising["rises"]
    told = {"first": rises[0]}
    if verdict["outcome"]["kind"] == "diverged" and len(rises) > 1:
        told["last"] = rises[-1]
    words = [
        f"{which} from {rise['begin_s']:.2f} to {rise['end_s']:.2f} s: {'; '.join(rise['causes'])}"
        for which, rise in told.items()
    ]
    often = "once" if len(rises) == 1 else f"{len(rises)} times"
    return f"V (Eq. {rising['equation']}) rises {often}, {', and '.join(words)}"


def _lyapunov_claim(
    rising: dict[str, Any] | None, expected: bool | None, *, diverged: bool
) -> dict[str, Any]:
    """The entry of "V never rises" among the claims."""
    known = rising is not None and rising["from_s"] is not None
    gains = [rise["relative_gain"] for rise in rising["rises"]] if rising is not None else []
    observed = False if diverged else not gains if known else None
    unknown = not known or None in gains or (diverged and not gains)
    largest = None if unknown else max(gains, default=0.0)
    return {
        "expected": expected,
        "observed": observed,
        "holds": None if expected is None or observed is None else observed == expected,
        "tolerance": ROUNDING,
        "largest_in_window": largest,
    }


def rejections(recording: Collected) -> dict[tuple[Any, Any, str], int]:
    """How many messages each receiver refused, by receiver, source and reason."""
    found: dict[tuple[Any, Any, str], int] = {}
    for event in recording.events:
        if isinstance(event, Rejected):
            found[event.robot, event.source, event.reason] = event.times
    return found


def _messages(recording: Collected) -> dict[str, Any]:
    fates: dict[str, int] = {}
    for row in recording.link_rows:
        fates[row.fate] = fates.get(row.fate, 0) + 1
    return {
        "sent": len({(r.source, r.destination, r.sequence) for r in recording.link_rows}),
        "fates": dict(sorted(fates.items())),
        "rejected": [
            {"robot": robot, "source": source, "reason": reason, "times": times}
            for (robot, source, reason), times in rejections(recording).items()
        ],
        "refused": _refused(recording),
    }


def _refused(recording: Collected) -> list[dict[str, Any]]:
    """Who was denied which key by the hub's access control, and how often, at least."""
    times = {
        (event.who, event.key): event.times
        for event in recording.events
        if isinstance(event, Refused)
    }
    return [{"who": who, "key": key, "times": count} for (who, key), count in times.items()]


def _links(recording: Collected, end_ns: int) -> list[dict[str, Any]]:
    """The statistics of every directed link that carried something, ascending."""
    fates: dict[tuple[int, int], list[Fate]] = {}
    for row in recording.link_rows:
        fate = Fate(row.sequence, row.t_sent_ns, row.t_usable_ns, row.fate)
        fates.setdefault((row.source, row.destination), []).append(fate)
    return [
        {"source": source, "destination": destination, **summarise(rows, end_ns)._asdict()}
        for (source, destination), rows in sorted(fates.items())
    ]


def _last(series: NDArray[np.float64]) -> float | None:
    return _number(series[-1]) if len(series) else None


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None
