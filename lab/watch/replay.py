"""``formnet replay``: a recorded run in Rerun's viewer, played as fast as one likes."""

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from formnet.formation.scenario.loading import load
from formnet.formation.scenario.model import Scenario
from formnet.lab.launch.signals import stop_signals
from formnet.lab.runs import files
from formnet.lab.runs.recording import SCENARIO, STATES, STATES_SCHEMA
from formnet.lab.runs.tables import most_samples, read_table
from formnet.lab.scene.blueprint import NOWHERE, blueprint, half_width
from formnet.lab.scene.viewer import Viewer
from formnet.lab.scene.writer import FILE
from formnet.lab.verdict.recorded import not_a_folder

_LOOK_S = 0.1


class NoScene(ValueError):
    """A folder has no run to replay; the text says which and why."""


def replay(folder: Path, speed: float, *, web: bool, say: Callable[[str], None]) -> None:
    """Show the run in ``folder`` until its window is closed, or (``web``) the caller is stopped.

    Raises:
        NoScene: there is no ``run.rrd``.
        ScenarioError: its scenario cannot be read.
        ViewerFailed: the viewer does not open.
    """
    if (problem := not_a_folder(folder)) is not None:
        raise NoScene(f"{folder}: {problem}")
    if not files.is_file(folder, FILE):
        raise NoScene(f"{folder}: has no {FILE} (made by `formnet run`)")
    scenario = load(folder / SCENARIO, follow=False)
    layout = blueprint(scenario, half_width(scenario, _places(folder, scenario)), speed=speed)
    with stop_signals() as stopped, tempfile.TemporaryDirectory() as place:
        plan = Path(place) / "formnet.rbl"
        layout.save("formnet", str(plan))
        viewer = Viewer(web=web, files=(folder / FILE, plan))
        try:
            if viewer.page is not None:
                say(f"{folder} at {viewer.page} until Ctrl-C")
            while viewer.process.poll() is None and not stopped.wait(_LOOK_S):
                pass
        finally:
            viewer.close()


def _places(folder: Path, scenario: Scenario) -> NDArray[np.float64]:
    """Where the robots were, (n, 2); none if the run left no table."""
    try:
        table = read_table(folder / STATES, STATES_SCHEMA, most_samples(scenario), ["x_m", "y_m"])
        return np.column_stack([table.column(axis).to_numpy() for axis in ("x_m", "y_m")])
    except (OSError, ValueError):  # it broke off, or is damaged
        return NOWHERE
