"""Compiles what runs in every tick with mypyc, where a C compiler is at hand.

The same source runs interpreted and compiled and gives the same bits; compiled,
it is faster. Without a compiler the build goes on without; with FORMNET_PURE=1 in
the environment nothing is compiled, and the wheel is for every machine.
"""

import os
import sys
import tempfile
from pathlib import Path

from setuptools import Extension, setup

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


def compiled() -> list[Extension]:
    """The hot path as extension modules; none where mypyc cannot translate them."""
    if {"egg_info", "dist_info"} & set(sys.argv):
        return []  # pip asks for the metadata first; only a build needs the modules
    if os.environ.get("FORMNET_PURE") == "1":
        return []
    try:
        from mypyc.build import mypycify

        with tempfile.TemporaryDirectory() as folder:
            settings = Path(folder, "mypy.ini")
            settings.write_text(MYPY, encoding="utf-8")
            extensions: list[Extension] = mypycify(
                [f"--config-file={settings}", *HOT],
                group_name="formnet",
                opt_level="2",
                debug_level="0",
            )
    except (Exception, SystemExit) as error:
        print(f"formnet is installed uncompiled: {error!r}", file=sys.stderr)
        return []
    for extension in extensions:
        extension.optional = True
        # A fused multiply-add rounds once where Python rounds twice.
        extension.extra_compile_args = [*extension.extra_compile_args, "-ffp-contract=off"]
    return extensions


setup(ext_modules=compiled())
