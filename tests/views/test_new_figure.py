"""A new figure is one module: it is drawn, saved and in the page."""

import pytest
from matplotlib.figure import Figure  # noqa: TID251

from formnet.formation.briefing.resolving import resolve
from formnet.formation.scenario.loading import load
from formnet.lab import figures
from formnet.lab.figures import run_figures
from formnet.lab.launch.inline import Inline
from formnet.lab.pages.pictures import pictures
from formnet.lab.runs.recording import Recording
from formnet.lab.scenarios.packaged import find
from formnet.lab.verdict import files
from formnet.lab.verdict.model import judge
from formnet.lab.verdict.recorded import read_run

MODULE = '''
"""How fast the robots are."""

from matplotlib.figure import Figure


def speeds(run):
    figure = Figure()
    axes = figure.subplots()
    axes.plot(run.trajectories.t_s, run.trajectories.states[..., 3])
    return figure


FIGURES = {"speed-of-robots": speeds, "nothing": lambda run: None}
'''


@pytest.fixture
def run(tmp_path):
    scenario = load(find("section5"), {"duration_s": 0.1})
    recording = Recording(tmp_path / "run", scenario)
    Inline().run(resolve(scenario), recording)
    assert recording.save() == []
    files.save(judge(recording, mode="inline", wall_s=1.0), recording.folder)
    return recording


@pytest.mark.long
def test_a_module_with_figures_is_all_that_a_new_one_needs(run, tmp_path, monkeypatch):
    (tmp_path / "speeds.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.setattr(figures, "__path__", [*figures.__path__, str(tmp_path)])
    (run.folder / "figures").mkdir()
    run_figures.draw(run, run.folder / "figures")
    assert (run.folder / "figures" / "speed-of-robots.svg").is_file()
    assert not (run.folder / "figures" / "nothing.svg").exists()
    (picture,) = [p for p in pictures(read_run(run.folder)) if p.name == "speed-of-robots"]
    assert (picture.title, picture.alt) == ("Speed of robots", "Speed of robots.")
    assert picture.source.startswith("data:image/")


def test_files_that_are_no_figures_are_not_in_the_page(run):
    place = run.folder / "figures"
    place.mkdir()
    for name in ("<script>", "A b", "x" * 60, "..", "thumbnail", *(f"n{k}" for k in range(50))):
        Figure().savefig(place / f"{name}.png")
    names = [picture.name for picture in pictures(read_run(run.folder))]
    assert len(names) == 20
    assert all(name.startswith("n") for name in names)
