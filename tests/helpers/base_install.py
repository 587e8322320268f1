"""A virtual environment that has formnet's base install and nothing else, made without a network."""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from importlib.metadata import distribution, requires
from pathlib import Path

from packaging.requirements import Requirement

PARTS = ("agent", "configs", "exact", "formation", "lab", "netem", "plant")


def copied(root: Path, source: Path) -> None:
    """What a checkout holds of the package, without what was compiled in it."""
    for part in (*PARTS, "formnet"):
        shutil.copytree(
            root / part,
            source / part,
            symlinks=True,
            ignore=shutil.ignore_patterns("*.so", "__py*"),
        )
    for file in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(root / file, source)


def built(source: Path, target: Path, what: str = "wheel") -> Path:
    """A wheel or an sdist of ``source``, nothing compiled."""
    target.mkdir(exist_ok=True)
    code = f"import setuptools.build_meta as backend; backend.build_{what}({str(target)!r})"
    subprocess.run(
        [sys.executable, "-c", code],
        cwd=source,
        check=True,
        capture_output=True,
        env={**os.environ, "FORMNET_PURE": "1"},
    )
    (file,) = target.iterdir()
    return file


def environment(wheel: Path, home: Path) -> tuple[Path, Path]:
    """An empty environment at ``home`` with ``wheel`` in it, and none of what that needs.

    Returns its interpreter and its folder of packages.
    """
    venv.create(home)
    python = home / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "--no-cache-dir"]
    offline = ("--no-index", "--no-deps")
    subprocess.run([*pip, "--python", python, "install", *offline, wheel], check=True)
    code = "import sysconfig; print(sysconfig.get_path('purelib'))"
    return python, Path(subprocess.check_output([python, "-c", code], text=True).strip())


def needed(name: str) -> set[str]:
    """The distributions that ``name`` needs without any extra, and those that they need."""
    found: set[str] = set()
    waiting = [name]
    while waiting:
        for text in requires(waiting.pop()) or []:
            need = Requirement(text)
            if need.marker is None or need.marker.evaluate({"extra": ""}):
                if need.name not in found:
                    waiting.append(need.name)
                found.add(need.name)
    return found


def base(wheel: Path, home: Path) -> tuple[Path, Path]:
    """:func:`environment` and what formnet's ``dependencies`` name, as copies of what is here."""
    python, packages = environment(wheel, home)
    here = Path(sysconfig.get_path("purelib"))
    for name in needed("formnet"):
        for file in distribution(name).files or []:
            source = Path(str(file.locate()))
            if source.is_relative_to(here):
                target = packages / source.relative_to(here)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(source, target)
    return python, packages
