"""The runs of the claims: each done, judged and kept if it surprises."""

import time
from pathlib import Path
from typing import NamedTuple

from formnet.formation.briefing.resolving import resolve
from formnet.formation.scenario.loading import load
from formnet.formation.scenario.model import Scenario
from formnet.lab.claims.claim import Case
from formnet.lab.claims.results import Result
from formnet.lab.launch import engine as execution
from formnet.lab.launch.engine import EngineName
from formnet.lab.launch.pool import Stopped
from formnet.lab.runs.recording import Recording
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.lab.verdict import files
from formnet.lab.verdict.model import judge


class Work(NamedTuple):
    """One run to do, into ``folder``."""

    claim: str
    case: Case
    folder: Path
    engine: EngineName


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
    engine = execution.engine(item.engine, item.folder / "logs")
    engine.run(resolve(recording.scenario), recording, stopped)
    seconds = time.monotonic() - began
    judged = judge(recording, mode=engine.name, wall_s=seconds)
    files.save(judged, item.folder)
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
