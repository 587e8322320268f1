"""A package with a law in it, which is installed by being on the path."""

from pathlib import Path


def install(folder: Path, kind: str, source: str) -> None:
    """``source`` has a class ``Law``, which ``law.kind = kind`` then names."""
    module = f"{kind}_law"
    (folder / f"{module}.py").write_text(source, encoding="utf-8")
    info = folder / f"{module}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[formnet.laws]\n{kind} = {module}:Law\n")
