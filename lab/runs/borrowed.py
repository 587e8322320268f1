"""Where a plug-in law takes functions whose bits are those of a library, and of the processor."""

import ast
import sys
from importlib.util import find_spec
from pathlib import Path

from formnet.agent.law import foreign, installed
from formnet.agent.law_file import LawFile

EXACT_IN_MATH = frozenset(
    {"sqrt", "floor", "ceil", "trunc", "fabs", "copysign", "isfinite", "isinf", "isnan", "isclose"}
    | {"inf", "nan", "pi", "tau", "e", "ldexp", "frexp", "fmod", "remainder", "modf", "fsum"}
    | {"nextafter", "ulp", "degrees", "radians", "gcd", "lcm", "comb", "perm", "factorial", "isqrt"}
)
"""What ``math`` has whose results IEEE 754 or whole numbers fix."""
LIBRARIES = frozenset({"numpy", "scipy", "cmath", "statistics", "torch", "jax", "casadi", "numba"})


def borrowed(kind: str, file: LawFile | None = None) -> list[str]:
    """What the module of the plug-in law ``kind``, or its ``file``, calls of such, ascending.

    Empty for formnet's own laws. A module without source is named itself. It is read, not run.
    """
    if file is not None:
        return sorted(_names(ast.parse(file.source)))
    if not foreign(kind):
        return []
    module = installed()[kind].module
    loaded = sys.modules.get(module)
    spec = find_spec(module) if loaded is None else loaded.__spec__
    origin = None if spec is None else spec.origin
    try:
        tree = ast.parse(Path(origin or "").read_bytes())
    except (OSError, SyntaxError, ValueError):  # compiled, or not there
        return [f"what {module} was compiled from"]
    return sorted(_names(tree))


def _names(tree: ast.AST) -> set[str]:
    found, aliases = set(), set()
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=names):
                for alias in names:
                    top = alias.name.partition(".")[0]
                    if top == "math":
                        aliases.add(alias.asname or "math")
                    elif top in LIBRARIES:
                        found.add(top)
            case ast.ImportFrom(module=str(module), names=names, level=0):
                top = module.partition(".")[0]
                if top == "math":
                    found |= {f"math.{a.name}" for a in names if a.name not in EXACT_IN_MATH}
                elif top in LIBRARIES:
                    found.add(top)
            case ast.BinOp(op=ast.Pow()) | ast.AugAssign(op=ast.Pow()):
                found.add("**")
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(value=ast.Name(id=name), attr=attribute) if (
                name in aliases and attribute not in EXACT_IN_MATH
            ):
                found.add(f"math.{attribute}")
    return found
