"""The bits of the exact functions on fixed arguments, as one hash for each function.

Needs nothing but :mod:`formnet.exact`: ``python bits.py`` prints the hashes as JSON, also on
another processor.
"""

import hashlib
import json
import math
import struct
from random import Random

SPECIAL = (0.0, -0.0, 1.0, -1.0, 0.5, math.inf, -math.inf, math.nan, 5e-324, -1e-310, 1e308, -2.5)
POINTS = 4000


def arguments(name: str, count: int) -> list[tuple[float, ...]]:
    """Special values, and numbers of all sizes, from which every processor makes the same."""
    random = Random(name)
    exponents = 40 if name in ("sin_cos", "tan", "exp", "expm1", "erfc") else 300
    drawn = [
        tuple(
            math.ldexp(random.uniform(-1.0, 1.0), random.randint(-exponents, exponents // 4))
            for _ in range(count)
        )
        for _ in range(POINTS)
    ]
    if name == "gamma_quantile":
        sizes = [math.ldexp(random.random(), random.randint(-12, 14)) for _ in range(POINTS // 4)]
        drawn = [(size, random.random()) for size in sizes]
    elif name in ("normal_quantile", "log"):
        drawn = [(math.ldexp(random.random(), -random.randrange(60)),) for _ in range(POINTS)]
    if count == 1:
        return [(x,) for x in SPECIAL] + drawn
    return [(x, y) for x in SPECIAL for y in SPECIAL] + drawn


def hashes(modules: dict[str, dict[str, object]]) -> dict[str, str]:
    """The hash of each function's results; ``modules`` are their names by module."""
    found = {}
    for module, name, count in FUNCTIONS:
        function = modules[module][name]
        digest = hashlib.sha256()
        for point in arguments(name, count):
            result = function(*point)  # type: ignore[operator]
            for value in result if isinstance(result, tuple) else (result,):
                value = math.nan if value != value else value  # a NaN's sign is nobody's promise
                digest.update(struct.pack("<d", value))
        found[name] = digest.hexdigest()[:16]
    return found


FUNCTIONS = [
    ("trigonometry", "sin_cos", 1),
    ("trigonometry", "tan", 1),
    ("trigonometry", "atan", 1),
    ("trigonometry", "atan2", 2),
    ("trigonometry", "hypot", 2),
    ("exponentials", "exp", 1),
    ("exponentials", "expm1", 1),
    ("exponentials", "log", 1),
    ("exponentials", "log1p", 1),
    ("exponentials", "power", 2),
    ("normal", "erfc", 1),
    ("normal", "normal_share", 1),
    ("normal", "normal_quantile", 1),
    ("gamma", "gamma_quantile", 2),
]
MODULES = ("pairs", "trigonometry", "exponentials", "normal", "gamma")
"""Each after those that it needs."""


def installed() -> dict[str, dict[str, object]]:
    """The functions as they are installed."""
    from importlib import import_module

    return {name: vars(import_module(f"formnet.exact.{name}")) for name in MODULES}


if __name__ == "__main__":
    print(json.dumps(hashes(installed()), indent=1))
