"""Imports point one way: netem <- formation <- agent, plant <- lab."""

import ast

import pytest

ALLOWED = {
    "netem": set(),
    "formation": {"netem"},
    "agent": {"netem", "formation"},
    "plant": {"netem", "formation"},
    "lab": {"netem", "formation", "agent", "plant"},
}


@pytest.mark.parametrize("package", ALLOWED)
def test_package_imports_only_what_lies_below_it(root, package):
    files = sorted((root / package).rglob("*.py"))
    assert files
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{file}:{node.lineno}: relative import"
                names = [node.module or ""]
            for name in names:
                top = name.partition(".")[0]
                if top in ALLOWED:
                    assert top in ALLOWED[package] | {package}, f"{file}:{node.lineno}: {name}"
