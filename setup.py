"""Compiles what runs in every tick with mypyc, where a C compiler is at hand.

The same source runs interpreted and compiled and gives the same bits; compiled,
it is faster. What cannot be compiled is a warning that names the file and the remedy,
and the build goes on without; in CI (FORMNET_CI=1) it is an error. With FORMNET_PURE=1
in the environment nothing is compiled, and the wheel is for every machine.
"""

import os
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

for link in Path("formnet").iterdir():
    if link.is_file() and link.suffix == "" and link.name != "py.typed":
        sys.exit(
            f"{link} is a text file where a symbolic link should be: this checkout was made "
            "without them. `git config core.symlinks true` and `git checkout -- formnet` make them."
        )

HOT = [
    "formnet/exact/exponentials.py",
    "formnet/exact/gamma.py",
    "formnet/exact/normal.py",
    "formnet/exact/pairs.py",
    "formnet/exact/trigonometry.py",
    "formnet/agent/base.py",
    "formnet/agent/cooperative.py",
    "formnet/agent/dynamics.py",
    "formnet/agent/excitation.py",
    "formnet/agent/process.py",
    "formnet/agent/realtime.py",
    "formnet/agent/robot.py",
    "formnet/agent/timed.py",
    "formnet/formation/wire/broadcast.py",
    "formnet/formation/wire/bus.py",
    "formnet/formation/wire/messages.py",
    "formnet/formation/wire/plant_bus.py",
    "formnet/formation/wire/state.py",
    "formnet/formation/wire/tuples.py",
    "formnet/netem/delays/calibration.py",
    "formnet/netem/delays/copula.py",
    "formnet/netem/delays/delay.py",
    "formnet/netem/delays/distributions.py",
    "formnet/netem/core/link.py",
    "formnet/netem/core/statistics.py",
    "formnet/netem/core/transit.py",
    "formnet/netem/impairments/loss.py",
    "formnet/netem/impairments/markov.py",
    "formnet/plant/body.py",
    "formnet/plant/extremes.py",
    "formnet/plant/host.py",
    "formnet/plant/lockstep.py",
    "formnet/plant/realtime.py",
    "formnet/plant/timed.py",
    "formnet/plant/world.py",
]
MYPY = """
[mypy]
ignore_missing_imports = True
[mypy-formnet.lab.*]
follow_imports = skip
"""
"""What is compiled must be right where only mypy is installed; the lab, which formnet/__init__.py
names for type checkers alone, needs NumPy to be."""


REMEDY = (
    "install a C compiler and Python's headers (Debian: gcc libc6-dev python3-dev), then formnet "
    "again; or set FORMNET_PURE=1 to install it uncompiled: slower, with the same bits"
)
MOST_LINES = 12
"""How much of what a compiler says is shown."""


def uncompiled(file: str, said: str) -> None:
    """Say why ``file`` is not compiled, in the compiler's words; in CI, end the build."""
    lines = [line for line in said.splitlines() if line.strip()]
    telling = [line for line in lines if re.search("error", line, re.IGNORECASE)] or lines
    shown = "\n".join(f"    {line}" for line in telling[:MOST_LINES])
    in_ci = os.environ.get("FORMNET_CI") == "1"
    kind = "error" if in_ci else "warning"
    text = f"{kind}: formnet: {file} cannot be compiled:\n{shown}\n  {REMEDY}"
    if in_ci:
        sys.exit(text)
    print(text, file=sys.stderr)


def first_file(said: str) -> str:
    """The file that mypyc blames first; all of them if it blames none."""
    found = re.search(r"^(\S+\.py):\d+: error", said, re.MULTILINE)
    return "what runs in every tick" if found is None else found[1]


def compiled() -> list[Extension]:
    """The hot path as extension modules; none where mypyc cannot translate them."""
    if {"egg_info", "dist_info"} & set(sys.argv):
        return []  # pip asks for the metadata first; only a build needs the modules
    if os.environ.get("FORMNET_PURE") == "1":
        return []
    said = StringIO()
    try:
        from mypyc.build import mypycify

        with (
            tempfile.TemporaryDirectory() as folder,
            redirect_stdout(said),
            redirect_stderr(said),
        ):
            settings = Path(folder, "mypy.ini")
            settings.write_text(MYPY, encoding="utf-8")
            extensions: list[Extension] = mypycify(
                [f"--config-file={settings}", *HOT],
                group_name="formnet",
                opt_level="2",
                debug_level="0",
            )
    except (Exception, SystemExit) as error:
        uncompiled(first_file(said.getvalue()), said.getvalue() or f"error: {error!r}")
        return []
    for extension in extensions:
        # A fused multiply-add rounds once where Python rounds twice.
        extension.extra_compile_args = [*extension.extra_compile_args, "-ffp-contract=off"]
    return extensions


@contextmanager
def kept(said: list[str]) -> Iterator[None]:
    """What other programs write to standard error meanwhile, passed on at the end."""
    with tempfile.TemporaryFile() as file:
        sys.stderr.flush()
        before = os.dup(2)
        os.dup2(file.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(before, 2)
            os.close(before)
            file.seek(0)
            said.append(file.read().decode(errors="replace"))
            sys.stderr.write(said[-1])


class Compile(build_ext):
    """Goes on without a module that the C compiler refuses, unless in CI."""

    def build_extension(self, ext: Extension) -> None:
        said: list[str] = []
        try:
            with kept(said):
                super().build_extension(ext)
        except Exception as error:  # of any compiler
            uncompiled(str(ext.sources[0]), f"{''.join(said)}\nerror: {error}")
            ext.optional = True  # nobody looks for what it would have made


setup(ext_modules=compiled(), cmdclass={"build_ext": Compile})
