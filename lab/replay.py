"""``formnet replay``: a recorded run in Rerun's viewer, played as fast as one likes."""

import tempfile
from collections.abc import Callable
from pathlib import Path

from formation.loading import load
from lab.rrd import FILE
from lab.scene import blueprint
from lab.viewer import Viewer


class NoScene(ValueError):
    """A folder has no run to replay; the text says which and why."""


def replay(folder: Path, speed: float, *, web: bool, say: Callable[[str], None]) -> None:
    """Show the run in ``folder`` until its window is closed, or (``web``) the caller is stopped.

    Raises:
        NoScene: there is no ``run.rrd``.
        ScenarioError: its scenario cannot be read.
        ViewerFailed: the viewer does not open.
    """
    if not (folder / FILE).is_file():
        raise NoScene(f"{folder}: has no {FILE} (made by `formnet run`)")
    layout = blueprint(load(folder / "scenario.toml"), speed=speed)
    with tempfile.TemporaryDirectory() as place:
        plan = Path(place) / "formnet.rbl"
        layout.save("formnet", str(plan))
        viewer = Viewer(web=web, files=(folder / FILE, plan))
        try:
            if viewer.page is not None:
                say(f"{folder} at {viewer.page} until Ctrl-C")
            viewer.process.wait()
        finally:
            viewer.close()
