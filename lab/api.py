"""The Python API, as :mod:`formnet` offers it: run, open and check scenarios, and what a run is.

Runs are in virtual time and in this process, and have the same bits as ``formnet run``.
"""

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from formnet.agent.law import Law, LawFactory, accepts, make
from formnet.agent.law_file import LawFile
from formnet.formation.briefing.resolving import resolve
from formnet.formation.briefing.situation import Situation
from formnet.formation.paper.theory import assess
from formnet.formation.records.events import Event
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.rows import Sample
from formnet.formation.scenario.loading import Overrides, ScenarioError, from_tables, load
from formnet.formation.scenario.model import Scenario
from formnet.lab.code.allowed import BadList
from formnet.lab.code.laws import Given, NoLaw, NotAllowed, executed, law_of
from formnet.lab.forecast.stiffness import warnings as foreseen
from formnet.lab.judge.errors import by_claim, error_series
from formnet.lab.launch.inline import Inline
from formnet.lab.launch.signals import stop_signals
from formnet.lab.runs.recording import (
    LINKS_SCHEMA,
    STATES_SCHEMA,
    Collected,
    Recording,
    Trajectories,
    table,
)
from formnet.lab.scenarios.packaged import find
from formnet.lab.verdict import files
from formnet.lab.verdict.model import Verdict, judge
from formnet.lab.verdict.recorded import read_whole
from formnet.netem.files.problems import Problem
from formnet.netem.settings.timeline import NEVER

Floats = NDArray[np.float64]
Source = str | PathLike[str] | Mapping[str, Any] | Scenario
"""A scenario: a file, the name of a packaged one, a run's folder, tables, or one that is loaded."""


class Check(NamedTuple):
    """What is known of a scenario before it is run.

    ``theorem`` is the number of the paper's theorem that it falls under, or None, and ``why``
    says how that follows; ``warnings`` say what may go wrong.
    """

    scenario: Scenario
    theorem: int | None
    why: str
    warnings: list[str]


class Run:
    """A run: what was recorded of it, and the verdict.

    Arrays have the axes (n_times, n_robots): ``t_s`` is the first, ``robots`` the second.

    Attributes:
        scenario: What was run.
        verdict: The same as in ``verdict.json`` (its page in the docs has every field).
    """

    def __init__(self, collected: Collected, verdict: Verdict) -> None:
        self._collected = collected
        self.scenario = collected.scenario
        self.verdict = verdict
        self._trajectories: Trajectories | None = None

    def __repr__(self) -> str:
        verdict, robots = self.verdict, len(self.robots)
        return (
            f"<Run {verdict.scenario}: {robots} robots, {verdict.simulated_s:g} s, {self.stands}>"
        )

    @property
    def robots(self) -> list[int]:
        """The robots' ids, in the order of the scenario: the second axis of arrays."""
        return self.scenario.ids

    @property
    def t_s(self) -> Floats:
        """The recorded instants in seconds, (n_times,): the first axis of arrays."""
        return self._arrays.t_s

    def state(self, name: str) -> Floats:
        """One quantity of all robots at all recorded instants, (n_times, n_robots).

        Args:
            name: ``x_m``, ``y_m``, ``heading_rad``, ``speed_mps``, ``turn_rate_radps``,
                ``torque_right_nm`` or ``torque_left_nm``. Torques are those at the wheels, after
                the limit, and NaN at the kinematic level.

        Raises:
            KeyError: there is no such quantity; the text names them.
        """
        names = Sample._fields[2:]
        if name not in names:
            raise KeyError(f"no quantity {name!r}; there are {', '.join(names)}")
        number, states = names.index(name), self._arrays.states
        if number < states.shape[2]:
            return states[:, :, number]
        return self._arrays.torques_nm[:, :, number - states.shape[2]]

    @property
    def errors(self) -> dict[str, Floats]:
        """The errors that the claims are about, each (n_times,): ``formation`` (m, Eq. 3),
        ``heading`` (rad, Eq. 4) and ``centroid`` (m, Eq. 5), of the robots judged."""
        judged = self.verdict.robots.judged
        return by_claim(error_series(self.scenario, self._arrays, judged))

    @property
    def states(self) -> pa.Table:
        """What ``states.parquet`` holds: a row for each robot at each recorded instant."""
        return table(self._collected.samples, STATES_SCHEMA)

    @property
    def links(self) -> pa.Table:
        """What ``links.parquet`` holds: a row for each copy of a message, with its fate."""
        return table(self._collected.sorted_link_rows, LINKS_SCHEMA)

    @property
    def events(self) -> list[Event | Outcome]:
        """What happened, ascending by time; the outcome is the last."""
        return self._collected.told

    @property
    def holds(self) -> bool:
        """Whether all that ``[expect]`` claims holds (see ``verdict.passed``)."""
        return self.verdict.passed

    @property
    def stands(self) -> str:
        """How it stands in a word: ``holds``, ``FAILS``, ``observed``, ``diverged`` and so on."""
        return self.verdict.standing

    def save(self, folder: str | PathLike[str]) -> Path:
        """Write a run folder, as ``formnet run`` does; ``formnet report`` and others read it.

        Returns:
            The folder.

        Raises:
            OSError: it exists and is not empty (RunExists), or cannot be written.
        """
        recording = Recording.copy(self._collected, Path(folder))
        problems = recording.save()
        if problems:
            raise problems[0]
        files.save(self.verdict, recording.folder)
        return recording.folder

    @property
    def _arrays(self) -> Trajectories:
        if self._trajectories is None:
            self._trajectories = self._collected.trajectories
        return self._trajectories


def run(
    scenario: Source,
    overrides: Overrides = (),
    *,
    law: Callable[[Situation], Law] | Law | None = None,
    until_s: float | None = None,
    allow_code: bool = False,
    allow_outside: bool = False,
) -> Run:
    """Run a scenario in virtual time, in this process, and judge it.

    Args:
        scenario: A file, the name of a packaged scenario (``"section5-delay"``), the folder of a
            run, the tables of a scenario as a dict, or a loaded one.
        overrides: Values by key path, such as ``{"network.default.delay.mean_s": 0.5}``, or texts
            as ``--set`` takes them. Robots are named by id: ``robots.3.damping``.
        law: A control law of yours instead of the one that the scenario names: a class or function
            that takes a ``Situation``, or an object with the method ``command`` that all
            robots share. The run is of a law with its name.
        until_s: End the run there, as interrupted.
        allow_code: Execute the code in files that the scenario names (``law.kind =
            "laws.py:MyLaw"``); else only what ``formnet allow`` has allowed.
        allow_outside: Whether traces and samples may lie outside the folder of the scenario (of
            tables: the working directory).

    Raises:
        ScenarioError: the scenario is not valid, or its law cannot be had; every problem is named.
        LookupError: ``scenario`` names none.
        KeyboardInterrupt: by Ctrl-C, once the run has stopped.
    """
    loaded = _loaded(scenario, overrides, allow_outside)
    factory: LawFactory = make
    file: LawFile | None = None
    if law is not None:
        factory, name = _factory(law)
        kind = loaded.law.model_copy(update={"kind": name})
        loaded = loaded.model_copy(update={"law": kind})
    else:
        file = _law_file(loaded, scenario, allow_code=allow_code)
        factory = file or make
    if loaded.clock.mode == "realtime":
        rule = 'is wall time; this is virtual time: override "clock.mode" with "lockstep"'
        raise ScenarioError(loaded.name, [Problem("clock.mode", "'realtime'", rule)])
    plan = resolve(loaded)
    problem = accepts(plan, factory)
    if problem is not None:
        raise ScenarioError(loaded.name, [Problem("law.kind", repr(loaded.law.kind), problem)])
    collected = Collected(loaded)
    until_ns = NEVER if until_s is None else round(until_s * 1e9)
    began_s = time.perf_counter()
    with ExitStack() as stack:
        stop = threading.Event()
        if threading.current_thread() is threading.main_thread():
            stop = stack.enter_context(stop_signals())
        Inline(law=factory).run(plan, collected, stop.is_set, until_ns)
    if stop.is_set():
        raise KeyboardInterrupt
    wall_s = time.perf_counter() - began_s
    warnings = assess(loaded).warnings
    how: dict[str, Any] = {"mode": "inline", "wall_s": wall_s, "code": executed(file)}
    return Run(collected, judge(collected, warnings=warnings, **how))


def open(folder: str | PathLike[str]) -> Run:
    """A recorded run, from its folder.

    Raises:
        Unreadable: there is no run, or something of it is missing; the text says what.
        ScenarioError: its scenario is none, or of a newer format.
    """
    recorded = read_whole(Path(folder))
    assert recorded.verdict is not None
    return Run(recorded, recorded.verdict)


def check(
    scenario: Source,
    overrides: Overrides = (),
    *,
    lookahead: bool = True,
    allow_code: bool = False,
    allow_outside: bool = False,
) -> Check:
    """Validate a scenario and say what the theory makes of it, without running it.

    Args:
        scenario: As for ``run``.
        overrides: As for ``run``.
        lookahead: Whether to follow the closed loop from the starts, to warn of a control period
            that is too long for the gains.
        allow_code: As for ``run``.
        allow_outside: As for ``run``.

    Raises:
        ScenarioError: the scenario is not valid, or its law cannot be had.
        LookupError: ``scenario`` names none.
    """
    loaded = _loaded(scenario, overrides, allow_outside)
    factory = _law_file(loaded, scenario, allow_code=allow_code) or make
    problem = accepts(resolve(loaded), factory)
    if problem is not None:
        raise ScenarioError(loaded.name, [Problem("law.kind", repr(loaded.law.kind), problem)])
    found = assess(loaded)
    told = foreseen(loaded, factory) if lookahead else found.warnings
    return Check(loaded, found.theorem, found.why, told)


def _loaded(scenario: Source, overrides: Overrides, allow_outside: bool) -> Scenario:
    if isinstance(scenario, Scenario):
        scenario = scenario.model_dump(mode="json", by_alias=True, exclude_none=True)
    if isinstance(scenario, Mapping):
        return from_tables(scenario, overrides, allow_outside=allow_outside)
    return load(find(str(scenario)), overrides, allow_outside=allow_outside)


def _law_file(loaded: Scenario, source: Source, *, allow_code: bool) -> LawFile | None:
    """The file whose law a scenario has, if it has one that may be executed."""
    folder = Path()
    if isinstance(source, str | PathLike):
        folder = find(str(source)).parent
    try:
        return law_of(loaded.law, folder, Given(allow_code=allow_code))
    except (NotAllowed, NoLaw, BadList) as error:
        problem = Problem("law.kind", repr(loaded.law.kind), str(error))
        raise ScenarioError(loaded.name, [problem]) from None


def _factory(law: Callable[[Situation], Law] | Law) -> tuple[LawFactory, str]:
    """What makes a robot's law, and what it is called."""
    if not isinstance(law, type) and hasattr(law, "command"):
        shared: Any = law
        return lambda _: shared, type(law).__name__
    if not callable(law):
        raise TypeError(f"law must be a class, a function or an object with command, not {law!r}")
    return law, getattr(law, "__name__", type(law).__name__)
