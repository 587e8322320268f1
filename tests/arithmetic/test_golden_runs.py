"""Whole runs to the bit: compiled, in plain Python, and where the libc is another.

``make prove PROVE=processors`` does the same with other Pythons and on aarch64.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from arithmetic import golden_runs
from arithmetic.test_bits import OTHER_PROCESSORS
from base_install import copied

GOLDEN = json.loads(Path(golden_runs.__file__).with_suffix(".json").read_text())
HELPERS = str(Path(__file__).resolve().parents[1] / "helpers")


@pytest.mark.parametrize("name", golden_runs.RUNS)
def test_as_installed(name):
    assert golden_runs.golden(name) == GOLDEN[name]


def test_every_distribution_law_and_action_is_in_it():
    texts = [text for _, overrides in golden_runs.RUNS.values() for text in overrides]
    for key, tables in golden_runs.COMPLETE.items():
        assert any(f"network.default.{key}=" in text for text in texts), key
        if key == "delay":
            for table in tables:
                assert any(f'"{table["distribution"]}"' in text for text in texts)
    files = {file for file, _ in golden_runs.RUNS.values()}
    assert {"network/every-action", "faults/every-fault", "faults/leader-follower"} <= files


def found_by(path, **extra):
    told = subprocess.run(
        [sys.executable, golden_runs.__file__],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path), **extra},
        capture_output=True,
        text=True,
    )
    assert told.returncode == 0, told.stderr
    return json.loads(told.stdout)


@pytest.mark.processes
@pytest.mark.parametrize("tunables", OTHER_PROCESSORS)
def test_where_the_libc_thinks_that_the_processor_is_another(tunables):
    assert found_by([HELPERS], GLIBC_TUNABLES=f"glibc.cpu.hwcaps={tunables}") == GOLDEN


@pytest.mark.processes
def test_in_plain_python(root, tmp_path):
    copied(root, tmp_path)
    assert not list(tmp_path.rglob("*.so"))
    assert found_by([str(tmp_path), HELPERS]) == GOLDEN
