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


def leaves(value, place=""):
    """Every leaf of a verdict by its place."""
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list):
        items = enumerate(value)
    else:
        return {place: value}
    return {
        key: leaf for name, item in items for key, leaf in leaves(item, f"{place}/{name}").items()
    }


@pytest.mark.processes
def test_a_verdict_elsewhere_has_the_same_booleans_and_numbers_to_1e_12(tmp_path):
    """As where neither the libc nor NumPy finds what newer processors have."""
    others = (
        "AVX2 FMA3 AVX512F AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR X86_V3 X86_V4"
    )
    elsewhere = {
        "GLIBC_TUNABLES": f"glibc.cpu.hwcaps={OTHER_PROCESSORS[-1]}",
        "NPY_DISABLE_CPU_FEATURES": others,
    }
    found = []
    for number, extra in enumerate(({}, elsewhere)):
        out = tmp_path / str(number)
        command = [sys.executable, "-W", "ignore", "-m", "formnet", "run", "section5-delay"]
        leave_out = ["--inline", "--no-scene", "--no-figures", "--no-lookahead"]
        done = subprocess.run(
            [*command, *leave_out, "--set", "duration_s=4.0", "--out", out],
            env={**os.environ, **extra},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 1, done.stderr  # too short for the claims
        found.append(leaves(json.loads((out / "verdict.json").read_text())))
    here, there = found
    clocks = {"/wall_s", "/realtime_factor"}
    assert here.keys() == there.keys()
    assert len(here) > 100
    for place in here.keys() - clocks:
        if isinstance(here[place], float):
            assert there[place] == pytest.approx(here[place], rel=1e-12, abs=1e-300), place
        else:
            assert there[place] == here[place], place
