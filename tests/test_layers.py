"""Imports point one way: netem <- formation <- agent, plant <- lab."""

import ast
import re

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


def test_an_exception_s_name_has_one_type_in_a_compiled_function(root):
    """mypyc gives it the type of its first handler, and a later one of another type breaks."""
    setup = (root / "setup.py").read_text(encoding="utf-8")
    patterns = re.findall(r'^    "(.*\.py)",$', setup, re.MULTILINE)
    assert len(patterns) > 10
    for file in (path for pattern in patterns for path in root.glob(pattern)):
        for function in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(function, ast.FunctionDef):
                kinds = {}
                for node in ast.walk(function):
                    if isinstance(node, ast.ExceptHandler) and node.name:
                        kinds.setdefault(node.name, set()).add(ast.unparse(node.type))
                assert all(len(some) == 1 for some in kinds.values()), (file, function.name, kinds)
