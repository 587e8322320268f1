"""Imports point one way between packages and between their rooms; nothing is circular or too big.

``python tests/test_layers.py`` prints what is measured here.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("netem", "formation", "agent", "plant", "lab")
MOST_LINES = 400
MOST_FILES = 12

ARROWS = {
    "netem": {
        "netem", "netem.core", "netem.delays", "netem.impairments", "netem.files",
        "netem.settings", "netem.bridge",
    },
    "formation": {"formation.wire", "formation.plan", "formation.scenario", "formation.paper"},
    "agent": {"agent"},
    "plant": {"plant"},
}  # fmt: skip
"""The rooms of each package, from the bottom to the top."""

BELOW = {
    "netem.core": set(),
    "netem.delays": {"netem.core"},
    "netem.impairments": {"netem.core"},
    "netem.files": set(),
    "netem.settings": {"netem.core", "netem.delays", "netem.impairments", "netem.files"},
    "netem.bridge": {"netem.core", "netem.files", "netem.settings"},
    "netem": {"netem.core", "netem.delays", "netem.impairments", "netem.settings"},
    "formation.wire": set(),
    "formation.plan": set(),
    "formation.scenario": {"formation.wire", "formation.plan"},
    "formation.paper": {"formation.plan", "formation.scenario"},
    "formation": set(),
    "agent": {"formation"},
    "plant": {"formation"},
    "lab.runs": set(),
    "lab.judge": {"lab.runs"},
    "lab.launch": {"lab.runs"},
    "lab.machines": {"lab.runs", "lab.launch"},
    "lab.forecast": {"lab.launch"},
    "lab.text": {"lab.runs", "lab.judge"},
    "lab.figures": {"lab.runs", "lab.judge"},
    "lab.scene": {"lab.runs", "lab.judge", "lab.launch", "lab.figures"},
    "lab.pages": {"lab.runs", "lab.judge", "lab.text", "lab.figures"},
    "lab.watch": {"lab.runs", "lab.judge", "lab.launch", "lab.machines", "lab.scene"},
    "lab.scenarios": {"lab.runs", "lab.forecast"},
    "lab.claims": {"lab.runs", "lab.judge", "lab.figures", "lab.launch", "lab.scenarios"},
    "lab.nemesis": {"lab.runs", "lab.judge", "lab.launch"},
}
"""Which rooms of its own package a room may import."""


def modules() -> dict[str, Path]:
    """Every module by its name, without ``formnet.``."""
    found = {}
    for package in PACKAGES:
        for file in sorted((ROOT / package).rglob("*.py")):
            parts = file.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return found


def imports(file: Path, known: dict[str, Path], *, inside: bool = True) -> Iterator[tuple[str, int]]:
    """The modules of ours that ``file`` imports, and on which line.

    Without ``inside``, only those that are imported with the module: not in a function, and not
    for the type checker alone.
    """
    tree = ast.parse(file.read_text(encoding="utf-8"))
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if not inside and (
            isinstance(node, ast.FunctionDef)
            or (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test))
        ):
            continue
        waiting.extend(ast.iter_child_nodes(node))
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}:{node.lineno}: relative import"
            base = node.module or ""
            inner = [f"{base}.{alias.name}" for alias in node.names]
            names = [name if name.removeprefix("formnet.") in known else base for name in inner]
        for name in names:
            assert name.partition(".")[0] not in PACKAGES, f"{file}:{node.lineno}: {name}"
            if name.startswith("formnet."):
                yield name.removeprefix("formnet."), node.lineno


def room(module: str, known: dict[str, Path]) -> str:
    """The folder in which a module lies."""
    return module if known[module].name == "__init__.py" else module.rpartition(".")[0]
