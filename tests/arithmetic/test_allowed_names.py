"""What enters a hash, a fate or an event is computed by IEEE operations and formnet.exact alone.

A list of what is allowed, so that what nobody thought of is refused.
"""

import ast
import builtins
from pathlib import Path

import pytest

from formnet.lab.runs.borrowed import EXACT_IN_MATH

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = (
    "exact",
    "agent",
    "plant",
    "netem/core",
    "netem/delays",
    "netem/impairments",
    "netem/settings",
    "formation/briefing",
    "formation/plan",
    "formation/scenario",
    "formation/wire",
)
ELSEWHERE = {
    "agent/law_file.py": {"ast", "types", "compile", "exec"},  # somebody else's law is executed
    "exact/arrays.py": {"numpy"},  # for plug-ins
    "formation/scenario/model.py": {"numpy"},  # offsets as an array, for errors and figures
    "formation/wire/sync.py": {"statistics"},  # clocks, in real time
}
"""What is no part of a run's bits, and may import or call this."""
MODULES = sorted(file for folder in FOLDERS for file in (ROOT / folder).rglob("*.py"))
STANDARD = frozenset(
    {"bisect", "collections", "contextlib", "copy", "ctypes", "dataclasses", "functools"}
    | {"gc", "hashlib", "heapq", "importlib", "ipaddress", "itertools", "json", "math"}
    | {"numbers", "os", "pathlib", "pkgutil", "queue", "random", "re", "signal", "struct"}
    | {"sys", "threading", "time", "traceback", "typing", "zlib"}
)
OTHERS = frozenset(
    {"formnet", "msgpack", "mypy_extensions", "pydantic", "pydantic_core", "tomli_w"} | {"zenoh"}
)
NUMERIC = frozenset({"sum", "pow", "complex", "eval", "exec", "compile", "__import__"})
"""Built-ins that are not allowed: ``sum`` of floats is compensated from Python 3.12 on."""
WHOLE_NUMBERS = {
    "agent/robot.py": 1,
    "formation/plan/roster.py": 1,
    "formation/wire/state.py": 1,  # whether it is finite
    "netem/core/statistics.py": 3,
    "netem/impairments/queue.py": 1,
    "netem/impairments/slots.py": 1,
}
"""How often a module adds up whole numbers with ``sum``."""
OPERATORS = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.FloorDiv, ast.Mod)
ON_INTEGERS = (ast.BitAnd, ast.BitOr, ast.BitXor, ast.LShift, ast.RShift)


def forbidden(text, name=""):
    """What in a module is not on the lists, each with its line."""
    found, sums = [], 0
    for node in ast.walk(ast.parse(text)):
        line = getattr(node, "lineno", 0)
        modules = []
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            modules = [node.module or ""]
            if node.module == "math":
                found += [
                    (line, f"math.{alias.name}")
                    for alias in node.names
                    if alias.name not in EXACT_IN_MATH
                ]
            if node.module == "random":
                found += [(line, a.name) for a in node.names if a.name != "Random"]
        for module in modules:
            top = module.partition(".")[0]
            allowed = STANDARD | OTHERS | ELSEWHERE.get(name, set())
            if top not in allowed:
                found.append((line, top))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id == "math" and node.attr not in EXACT_IN_MATH:
                found.append((line, f"math.{node.attr}"))
            if node.value.id in ("random", "_random") and node.attr not in RANDOM:
                found.append((line, f"random.{node.attr}"))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            called = node.func.id
            if called == "sum" and name in WHOLE_NUMBERS:
                sums += 1
            elif called in NUMERIC - ELSEWHERE.get(name, set()) and hasattr(builtins, called):
                found.append((line, called))
        if isinstance(node, ast.BinOp | ast.AugAssign) and not isinstance(
            node.op, (*OPERATORS, *ON_INTEGERS)
        ):
            whole = isinstance(node, ast.BinOp) and all(
                isinstance(side, ast.Constant) and type(side.value) is int
                for side in (node.left, node.right)
            )
            if not (isinstance(node.op, ast.Pow) and whole):
                found.append((line, type(node.op).__name__))
    if sums != WHOLE_NUMBERS.get(name, 0):
        found.append((0, f"sum, {sums} times"))
    return found


RANDOM = frozenset({"random", "Random"})
"""Of a generator only ``random()``: it is the same in every Python; others may be rewritten."""


@pytest.mark.parametrize("file", MODULES, ids=lambda file: str(file.relative_to(ROOT)))
def test_a_module_has_only_what_is_allowed(file):
    name = file.relative_to(ROOT).as_posix()
    assert forbidden(file.read_text(encoding="utf-8"), name) == []


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("import math\ny = math.sin(x)", "math.sin"),
        ("from math import hypot", "math.hypot"),
        ("y = x ** 0.5", "Pow"),
        ("y = 2 ** x", "Pow"),
        ("x **= 2", "Pow"),
        ("y = pow(x, 2)", "pow"),
        ("y = a @ b", "MatMult"),
        ("y = sum(values)", "sum"),
        ("from statistics import NormalDist", "statistics"),
        ("import numpy as np", "numpy"),
        ("from scipy.special import gammaincinv", "scipy"),
        ("import cmath", "cmath"),
        ("def draw(random):\n    return random.gauss(0.0, 1.0)", "random.gauss"),
        ("from random import uniform", "uniform"),
        ("import something_new", "something_new"),
    ],
)
def test_what_is_not_allowed_is_found(text, what):
    assert [found for _, found in forbidden(text)] == [what]
