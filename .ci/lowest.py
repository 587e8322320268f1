"""Prints pip's constraints for the lowest versions that pyproject.toml admits of what it names."""

import re
import sys
import tomllib
from pathlib import Path

EXTRAS = ("lab", "export", "hosts", "test")
"""Those that the quick tests need, all together."""


def lowest(project: dict) -> list[str]:
    """``NAME==VERSION`` for each requirement.

    Raises:
        ValueError: one has no lower bound.
    """
    needs = list(project["dependencies"])
    needs += [need for extra in EXTRAS for need in project["optional-dependencies"][extra]]
    found = {}
    for need in needs:
        if need.startswith(f"{project['name']}["):
            continue
        parts = re.fullmatch(r"([\w.-]+)(?:\[[\w,-]+\])?>=([\w.]+)(?:,<[\w.]+)?", need)
        if parts is None:
            raise ValueError(
                f"pyproject.toml: {need}: must be NAME>=LOWEST, with or without ,<NEXT"
            )
        found[parts[1]] = f"{parts[1]}=={parts[2]}"
    return sorted(found.values())


if __name__ == "__main__":
    file = Path(__file__).resolve().parents[1] / "pyproject.toml"
    try:
        print("\n".join(lowest(tomllib.loads(file.read_text(encoding="utf-8"))["project"])))
    except ValueError as error:
        sys.exit(str(error))
