"""What this checkout or install was built into, and which extras of formnet it has."""

from importlib.util import find_spec
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[2]
_PACKAGES = ("agent", "exact", "formation", "lab", "netem", "plant")


def compiled() -> bool:
    """Whether what runs in every tick is compiled (setup.py)."""
    return bool(_modules())


def stale() -> str | None:
    """What to do if a compiled module of this checkout is older than its source, or has none.

    None if there is nothing to do. Only a checkout has sources that change; the
    times of an installed wheel's files mean nothing.
    """
    if not (_ROOT / "setup.py").exists():
        return None
    for built in _modules():
        source = built.with_name(built.name.partition(".")[0] + ".py")
        if not source.exists():
            return (
                f"{built.relative_to(_ROOT)} was compiled from a source that no longer exists: "
                "delete it, or run `make clean`"
            )
        if built.stat().st_mtime < source.stat().st_mtime:
            return (
                f"{source.relative_to(_ROOT)} is newer than its compiled module: run `make build`, "
                "or `make clean` to work without compiled modules"
            )
    return None


def _modules() -> list[Path]:
    kinds = ("so", "pyd")
    return [
        built for name in _PACKAGES for kind in kinds for built in (_ROOT / name).rglob(f"*.{kind}")
    ]


def versions() -> dict[str, str | bool]:
    """What a run is made with; ``compiled`` says whether the install had a C compiler."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    found: dict[str, str | bool] = {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "compiled": compiled(),
    }
    for package in ("formnet", "eclipse-zenoh", "numpy", "msgpack"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # run from a checkout that is not installed
            found[package] = "unknown"
    return found


EXTRAS = {
    "lab": (
        "jinja2",
        "matplotlib",
        "networkx",
        "numpy",
        "pyarrow",
        "rerun",
        "rich",
        "tomlkit",
        "tornado",
    ),
    "hosts": ("asyncssh", "cryptography"),
    "export": ("mcap",),
}
"""The packages that each extra brings, by the names under which they are imported."""


def install(extra: str) -> str:
    """How to get an extra of formnet."""
    return f"pip install 'formnet[{extra}]' (in a checkout: -e '.[{extra}]')"


def remedy(error: ModuleNotFoundError) -> str | None:
    """Which package is missing and what installs it; None if no extra of formnet brings it."""
    package = (error.name or "").partition(".")[0]
    for extra, packages in EXTRAS.items():
        if package in packages:
            return f"the package {package} is missing: {install(extra)}"
    return None


def missing(extra: str) -> list[str]:
    """The packages of an extra that are not installed."""
    return [package for package in EXTRAS[extra] if find_spec(package) is None]
