"""The runs of the claims: each done, judged and kept if it surprises."""

import time
from pathlib import Path
from typing import NamedTuple

from formnet.formation.scenario.loading import load
from formnet.formation.scenario.model import Scenario
from formnet.lab.claims.claim import Case
from formnet.lab.claims.results import Result
from formnet.lab.judge import verdict
from formnet.lab.launch.execution import execute
from formnet.lab.launch.pool import Stopped
from formnet.lab.runs.recording import Recording
from formnet.lab.scenarios.packaged import CONFIGS


class Work(NamedTuple):
    """One run to do, into ``folder``."""

    claim: str
    case: Case
    folder: Path
    inline: bool


def cost(case: Case) -> float:
    """How long a run takes, roughly, in robots times virtual seconds."""
    scenario = scenario_of(case)
    return len(scenario.ids) * scenario.duration_s


def do(item: Work, stopped: Stopped) -> Result:
    """One run, judged; what it recorded is kept if it did not end as it should.

    Raises:
        ScenarioError: the scenario is not valid.
        OSError: processes cannot be started, or a file cannot be written.
    """
    recording = Recording(item.folder, scenario_of(item.case))
    began = time.monotonic()
    execute(recording, recording, stopped, inline=item.inline)
    seconds = time.monotonic() - began
    mode = "inline" if item.inline else "distributed"
    judged = verdict.of(recording, mode=mode, wall_s=seconds)
    verdict.save(judged, item.folder)
    result = Result(item.case, judged, seconds)
    if result.as_expected:
        recording.close()
    elif problems := recording.save():
        raise problems[0]
    return result


def scenario_of(case: Case) -> Scenario:
    """The scenario of a run, its overrides applied.

    Raises:
        ScenarioError: it is not valid.
    """
    return load(CONFIGS / case.scenario, case.all_overrides)
