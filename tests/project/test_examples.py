"""The examples do what they say."""

import json
import re
import signal
import subprocess
import sys
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from formnet.lab.launch.launch import free_port

pytestmark = pytest.mark.processes

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
TALKER = EXAMPLES / "zenoh_talker"


def test_the_own_law_passes_its_own_tests(tmp_path):
    subprocess.run(
        [
            sys.executable,
            "-B",
            "-m",
            "pytest",
            "-p",
            "no:cacheprovider",
            "-c",
            EXAMPLES / "own_law" / "pyproject.toml",
            EXAMPLES / "own_law",
        ],
        check=True,
        cwd=tmp_path,
    )


@contextmanager
def program(*command):
    process = subprocess.Popen(
        [sys.executable, "-B", *map(str, command)],
        text=True,
        cwd=TALKER,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("way", ["directly", "bridge", "library"])
def test_plain_zenoh_programs_meet_the_link_that_is_put_between_them(way):
    near, far = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    with ExitStack() as stack:
        hearer = stack.enter_context(program("talker.py", "hear", far))
        assert hearer.stdout.readline() == "listening\n"
        if way == "bridge":
            teller = stack.enter_context(program("talker.py", "tell", near, "--listen"))
            bridge = stack.enter_context(
                program(
                    "-m",
                    "formnet",
                    "netem-bridge",
                    "--from",
                    near,
                    "--to",
                    far,
                    "--network",
                    "radio.toml",
                )
            )
        elif way == "library":
            teller = stack.enter_context(program("talker_with_netem.py", far))
        else:
            teller = stack.enter_context(program("talker.py", "tell", far))
        said = hearer.communicate(timeout=60)[0]
        assert teller.wait(60) == 0
        if way == "bridge":
            bridge.send_signal(signal.SIGINT)
            assert "random" in bridge.communicate(timeout=60)[0]  # what it lost
    count, median_ms = re.fullmatch(r"heard (\d+), the median (\S+) ms late\n", said).groups()
    if way == "directly":
        assert int(count) == 200
        assert float(median_ms) < 50
    else:  # of 200, a fifth is lost: five standard deviations of the binomial are 28
        assert 132 <= int(count) <= 188
        assert 80 < float(median_ms) < 150


def test_every_cell_of_the_notebook_runs(monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "agg")
    notebook = json.loads((EXAMPLES / "notebook.ipynb").read_text(encoding="utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert len(cells) > 5
    names = {}
    for cell in cells:
        assert cell["outputs"] == []
        exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
    names["plt"].close("all")
