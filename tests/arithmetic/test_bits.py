"""The exact functions' bits: as installed, in plain Python, by Numba, on other processors."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import FunctionType

import numba
import pytest
from arithmetic import bits

from formnet.exact import ARITHMETIC_VERSION

EXACT = Path(__file__).resolve().parents[2] / "exact"
VERSION = 2
GOLDEN = json.loads(Path(__file__).with_name("bits.json").read_text())
OTHER_PROCESSORS = ("-FMA,-AVX2", "-FMA,-AVX2,-AVX512F")


def interpreted(wrap=lambda function: function):
    """The modules executed from their source; ``wrap`` is applied to every function."""
    modules = {}
    for name in bits.MODULES:
        source = (EXACT / f"{name}.py").read_text(encoding="utf-8")
        modules[name] = found = {"__name__": name}
        exec(compile(source, name, "exec"), found)
        for key, value in list(found.items()):
            before = next((m[key] for n, m in modules.items() if n != name and key in m), None)
            if callable(before) and not isinstance(value, type):
                found[key] = before
            elif isinstance(value, FunctionType):
                found[key] = wrap(value)
    return modules


def test_as_installed():
    assert bits.hashes(bits.installed()) == GOLDEN
    assert ARITHMETIC_VERSION == VERSION, "new bits, new version: write both"


def test_in_plain_python():
    modules = interpreted()
    assert isinstance(modules["trigonometry"]["sin_cos"], FunctionType)
    assert bits.hashes(modules) == GOLDEN


@pytest.mark.long
def test_compiled_by_numba():
    assert bits.hashes(interpreted(numba.njit)) == GOLDEN


@pytest.mark.processes
@pytest.mark.parametrize("tunables", OTHER_PROCESSORS)
def test_where_the_libc_thinks_that_the_processor_is_another(tunables):
    told = subprocess.run(
        [sys.executable, bits.__file__],
        env={**os.environ, "GLIBC_TUNABLES": f"glibc.cpu.hwcaps={tunables}"},
        capture_output=True,
        check=True,
    )
    assert json.loads(told.stdout) == GOLDEN


def test_a_hash_tells_a_last_place():
    """Else the tests above could not fail."""
    modules = interpreted()
    sine = modules["trigonometry"]["sin_cos"]

    def off(x):
        s, c = sine(x)
        return (s + 2.0**-53 * s if 0.5 < s < 0.6 else s), c

    modules["trigonometry"]["sin_cos"] = off
    found = bits.hashes(modules)
    assert [name for name in GOLDEN if found[name] != GOLDEN[name]] == ["sin_cos"]
