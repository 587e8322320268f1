"""Standing in a folder of somebody else's, nothing that lies there is executed or obeyed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from formnet.lab.scenarios.packaged import CONFIGS

SECTION5 = CONFIGS / "paper" / "section5-delay.toml"
BAIT = (
    *("formnet", "agent", "plant", "netem", "formation", "lab", "exact"),
    *("zenoh", "msgpack", "numpy", "pydantic", "pyarrow", "rerun", "matplotlib", "rich", "click"),
    *("multiprocessing", "selectors", "signal", "json", "typing", "usercustomize", "sitecustomize"),
)
"""Modules that some process of a run would import from there, were it looked at."""
LOOSE = (
    *("--set", "duration_s=0.5"),
    *("--set", "expect={formation=true, formation_tolerance_m=1e6}"),
)
SHORT = ("--set", "duration_s=0.3", "--set", "clock.control_period_s=0.01")


@pytest.fixture
def received(tmp_path):
    """A folder with a run's scenario and a module of every such name, which says that it ran."""
    folder = tmp_path / "received"
    folder.mkdir()
    (folder / "scenario.toml").write_text(SECTION5.read_text())
    for name in BAIT:
        said = folder / f"{name} was executed"
        (folder / f"{name}.py").write_text(f"open({str(said)!r}, 'w').close()\n")
    return folder


def called(folder, *words):
    """``formnet WORDS`` there; its exit code and what it said."""
    program = Path(sys.executable).with_name("formnet")
    done = subprocess.run([program, *map(str, words)], cwd=folder, capture_output=True, text=True)
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, done.stdout + done.stderr


def executed(folder):
    return sorted(path.name for path in folder.glob("*was executed"))


@pytest.mark.processes
def test_the_bait_is_taken_where_the_working_directory_is_looked_at(received):
    """Else the tests below could not fail."""
    subprocess.run([sys.executable, "-c", "import zenoh"], cwd=received, check=False)
    assert executed(received) == ["zenoh was executed"]


@pytest.mark.processes
@pytest.mark.parametrize(
    ("code", "words"),
    [
        (1, ["run", "scenario.toml", *SHORT, "--out", "out"]),  # plant, robots, scene, figures
        (1, ["run", "scenario.toml", "--inline", *SHORT, "--out", "out"]),
        (0, ["check", "scenario.toml"]),
        (
            0,
            ["nemesis", "scenario.toml", "--inline", "--runs", "2", "--out", "out", *LOOSE],
        ),  # workers of multiprocessing
    ],
    ids=["run", "inline", "check", "nemesis"],
)
def test_no_process_of_a_command_executes_what_lies_there(received, code, words):
    found, said = called(received, *words)
    assert found == code, said
    assert executed(received) == []


@pytest.mark.processes
def test_python_m_formnet_executes_nothing_that_lies_there_once_it_runs(received):
    """Python itself takes ``formnet``, and what it needs to start it, from the working directory."""
    for name in ("formnet", "typing", "json", "signal", "selectors", "multiprocessing"):
        (received / f"{name}.py").unlink()
    words = [sys.executable, "-m", "formnet", "check", "scenario.toml"]
    done = subprocess.run(words, cwd=received, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert executed(received) == []


@pytest.mark.processes
def test_verify_and_the_pages_of_a_run_execute_nothing_either(received):
    assert called(received, "run", "scenario.toml", *SHORT, "--out", "out")[0] == 1
    for words in (["verify", "out"], ["report", "out"], ["plot", "out"], ["list", "."]):
        code, said = called(received, *words)
        assert code == 0, (words, said)
    assert executed(received) == []


@pytest.mark.processes
def test_a_plug_in_s_try_out_does_not_either(received, tmp_path):
    """A law that is not formnet's is built in a process of its own."""
    from plugin import install

    law = "class Law:\n    def __init__(self, situation): pass\n    def command(self, *_): return 0, 0\n"
    place = tmp_path / "packages"
    place.mkdir()
    install(place, "still", law)
    program = Path(sys.executable).with_name("formnet")
    done = subprocess.run(
        [program, "check", "scenario.toml", "--set", "law.kind=still"],
        cwd=received,
        env={**os.environ, "PYTHONPATH": str(place)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert executed(received) == []


@pytest.mark.processes
def test_figures_do_not_obey_a_matplotlibrc_that_lies_there(tmp_path):
    pictures = []
    for name, lines in (("plain", ""), ("hostile", "figure.facecolor: red\nfont.size: 30\n")):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "matplotlibrc").write_text(lines)
        words = ["run", SECTION5, "--inline", "--no-scene", *SHORT, "--out", "out"]
        assert called(folder, *words)[0] == 1
        pictures.append((folder / "out" / "figures" / "paths.png").read_bytes())
    assert pictures[0] == pictures[1]


@pytest.mark.processes
def test_no_file_of_settings_of_matplotlib_s_is_opened_there(tmp_path):
    """Versions before 3.11 evaluate a part of it, long before a figure is made."""
    hostile = tmp_path / "matplotlibrc"
    hostile.write_text("import os\n")  # later versions name the line
    watch = (
        "import os, sys\n"
        "opened = []\n"
        "sys.addaudithook(lambda event, given: event == 'open' and opened.append(given[0]))\n"
        "import formnet.lab.figures.run_figures, formnet.lab.claims.folder\n"
        "from formnet.lab.figures.canvas import blank\n"
        "blank(1.0, 1.0)\n"
        "print([path for path in opened if os.path.realpath(str(path)) == sys.argv[1]])\n"
        "print(os.getcwd())\n"
    )
    words = [sys.executable, "-P", "-c", watch, str(hostile)]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == ["[]", str(tmp_path)]
    assert done.stderr == ""
