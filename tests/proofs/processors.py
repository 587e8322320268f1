"""The golden bits by other Pythons, without compiled modules, and by other processors.

Other Pythons are given with ``--python``; an aarch64 one by ``--aarch64 ROOT``, a folder with the
unpacked Debian packages that ``usr/bin/python3.11`` needs, which QEMU's user mode runs.
"""

import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from arithmetic import bits, golden_runs
from base_install import copied

ROOT = Path(__file__).resolve().parents[2]
HELPERS = ROOT / "tests" / "helpers"
NEEDED = ("annotated-types", "msgpack", "mypy-extensions", "pydantic", "tomli-w")
TUNABLES = ("-FMA,-AVX2", "-FMA,-AVX2,-AVX512F")
SCRIPTS = (Path(bits.__file__), Path(golden_runs.__file__))


class Place(NamedTuple):
    """Something that runs Python: its name, command, and what is added to the environment."""

    name: str
    command: list[str]
    extra: dict[str, str]


def places(pythons: Sequence[str], aarch64: Path | None, scratch: Path) -> Iterator[Place]:
    """All that are compared, and what they need made in ``scratch``."""
    for tunables in TUNABLES:
        hwcaps = {"GLIBC_TUNABLES": f"glibc.cpu.hwcaps={tunables}", "PYTHONPATH": str(HELPERS)}
        yield Place(f"as installed, {tunables}", [sys.executable], hwcaps)
    source = scratch / "source"
    source.mkdir()
    copied(ROOT, source)
    ask = "import platform; print(platform.python_version())"
    for python in dict.fromkeys([sys.executable, *pythons]):
        version = subprocess.check_output([python, "-c", ask], text=True).strip()
        path = _packages(scratch, version, platform.machine())
        found = f"Python {version}, {platform.machine()}, not compiled"
        yield Place(found, [python], {"PYTHONPATH": os.pathsep.join(map(str, path))})
    if aarch64 is not None:
        python = str(aarch64 / "usr" / "bin" / "python3.11")
        qemu = ["qemu-aarch64", "-L", str(aarch64), "-E", f"PYTHONHOME={aarch64 / 'usr'}"]
        path = _packages(scratch, "3.11", "aarch64")
        setting = f"PYTHONPATH={os.pathsep.join(map(str, path))}"
        command = [*qemu, "-E", setting, python]
        told = subprocess.check_output(
            [*command, "-c", f"{ask[:-1]}, platform.machine())"], text=True
        )
        version, machine = told.split()
        yield Place(f"Python {version}, {machine} (QEMU), not compiled", command, {})


def _packages(scratch: Path, version: str, machine: str) -> list[Path]:
    """Folders for the path: what formnet needs, as wheels of that Python and machine."""
    short = ".".join(version.split(".")[:2])
    target = scratch / f"{short}-{machine}"
    tags = [f"--platform={tag}_{machine}" for tag in ("manylinux2014", "manylinux_2_28")]
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    only = ["--only-binary=:all:", f"--python-version={short}", "--implementation=cp", *tags]
    subprocess.run([*pip, *only, f"--target={target}", *NEEDED], check=True)
    return [scratch / "source", HELPERS, target]


def compared(pythons: Sequence[str], aarch64: Path | None) -> tuple[dict[str, int], list[str]]:
    """How many hashes each place has equal to the golden ones, and which differ."""
    counts, failures = {}, []
    with TemporaryDirectory() as scratch:
        for place in places(pythons, aarch64, Path(scratch)):
            counts[place.name] = 0
            for script in SCRIPTS:
                golden = json.loads(script.with_suffix(".json").read_text())
                environment = {**os.environ, **place.extra}
                command = [*place.command, str(script)]
                done = subprocess.run(command, env=environment, capture_output=True, text=True)
                found = json.loads(done.stdout) if done.returncode == 0 else {}
                same = [name for name, value in golden.items() if found.get(name) == value]
                counts[place.name] += len(same)
                failures += [f"{place.name}: {name}" for name in golden if name not in same]
                failures += [done.stderr[-500:]] if done.returncode else []
    return counts, failures
