"""How far the exact functions are from the truth, in units in the last place (mpmath, 60 digits).

``python -m arithmetic.accuracy`` prints the table of docs/arithmetic.md (``make accuracy``).
"""

import math
import sys
from collections.abc import Callable
from random import Random
from typing import NamedTuple

import mpmath
from mpmath import mp, mpf

from formnet.exact import exponentials, gamma, normal, trigonometry

Point = tuple[float, ...]
MULTIPLES = [float(k * (mpf(1) * mpmath.pi / 2)) for k in range(1, 63662)]
"""The doubles nearest to the multiples of π/2 up to 1e5: the worst for a reduction."""


class Case(NamedTuple):
    """A function on a domain, from which points are drawn; ``bound`` in ulp, or ``relative``."""

    name: str
    domain: str
    function: Callable[..., float]
    truth: Callable[..., mpf]
    draw: Callable[[Random], Point]
    bound: float
    relative: bool = False


def even(low: float, high: float) -> Callable[[Random], Point]:
    return lambda random: (random.uniform(low, high),)


def sized(low: float, high: float, signs: tuple[int, ...] = (1, -1)) -> Callable[[Random], Point]:
    """Sizes from ``low`` to ``high``, even in their logarithms."""

    def draw(random: Random) -> Point:
        size = math.exp(random.uniform(math.log(low), math.log(high)))
        return (random.choice(signs) * size,)

    return draw


def both(one: Callable[[Random], Point], other: Callable[[Random], Point]):
    return lambda random: one(random) + other(random)


def near(place: float, low: float, high: float) -> Callable[[Random], Point]:
    offset = sized(low, high)
    return lambda random: (place + offset(random)[0],)


def multiples(random: Random) -> Point:
    return (random.choice((1, -1)) * random.choice(MULTIPLES),)


def normal_truth(share: mpf) -> mpf:
    """By Newton's method in the logarithm of the smaller share."""
    tail = min(share, 1 - share)
    z = mpf(normal.normal_quantile(float(tail)))
    for _ in range(4):
        below = mpmath.ncdf(z)
        z -= mpmath.log(below / tail) * below / mpmath.npdf(z)
    return z if share == tail else -z


def gamma_truth(shape: mpf, share: mpf) -> mpf:
    """By one step of Newton's method, which leaves the square of the error, in the smaller share."""
    x = mpf(gamma.gamma_quantile(float(shape), float(share)))
    density = mpmath.exp((shape - 1) * mpmath.log(x) - x - mpmath.loggamma(shape))
    if share < 0.5:
        below = mpmath.gammainc(shape, 0, x, regularized=True)
        return x - mpmath.log(below / share) * below / density
    above = mpmath.gammainc(shape, x, mpmath.inf, regularized=True)
    return x + mpmath.log(above / (1 - share)) * above / density


def gamma_points(low: float, high: float) -> Callable[[Random], Point]:
    """Shapes in a range, and shares whose quantile is no denormal number."""
    shapes = sized(low, high, (1,))

    def draw(random: Random) -> Point:
        while True:
            shape, share = shapes(random)[0], random.random()
            share = random.choice((share, share**8, 1.0 - 2.0**-53 * random.randrange(1, 2**20)))
            if share > 2.0**-54 and gamma.gamma_quantile(shape, share) > 1e-290:
                return shape, share

    return draw


FAR = both(sized(1e-200, 1e200), sized(1e-200, 1e200))
SQUARE = both(even(-1.0, 1.0), even(-1.0, 1.0))
CASES = [
    *(
        Case(name, domain, function, truth, draw, bound)
        for name, function, truth, bound in (
            ("sin", trigonometry.sin, mpmath.sin, 1.0),
            ("cos", trigonometry.cos, mpmath.cos, 1.0),
            ("tan", trigonometry.tan, mpmath.tan, 2.0),
        )
        for domain, draw in (
            ("±π/4", even(-0.8, 0.8)),
            ("±10", even(-10.0, 10.0)),
            ("±1e5", even(-1e5, 1e5)),
            ("1e-12 to 1", sized(1e-12, 1.0)),
            ("nearest to multiples of π/2", multiples),
        )
    ),
    Case("atan", "±3", trigonometry.atan, mpmath.atan, even(-3.0, 3.0), 2.0),
    Case("atan", "1e-10 to 1e10", trigonometry.atan, mpmath.atan, sized(1e-10, 1e10), 2.0),
    Case("atan2", "±1, ±1", trigonometry.atan2, mpmath.atan2, SQUARE, 2.0),
    Case("atan2", "1e-200 to 1e200", trigonometry.atan2, mpmath.atan2, FAR, 2.0),
    Case("hypot", "±1, ±1", trigonometry.hypot, mpmath.hypot, SQUARE, 2.0),
    Case("hypot", "1e-200 to 1e200", trigonometry.hypot, mpmath.hypot, FAR, 2.0),
    Case("exp", "±1", exponentials.exp, mpmath.exp, even(-1.0, 1.0), 1.0),
    Case("exp", "−745 to 709.7", exponentials.exp, mpmath.exp, even(-745.0, 709.7), 1.0),
    Case("expm1", "±3", exponentials.expm1, mpmath.expm1, even(-3.0, 3.0), 2.0),
    Case("expm1", "1e-20 to 1", exponentials.expm1, mpmath.expm1, sized(1e-20, 1.0), 2.0),
    Case("expm1", "−50 to 709", exponentials.expm1, mpmath.expm1, even(-50.0, 709.0), 2.0),
    Case("log", "0.3 to 3", exponentials.log, mpmath.log, even(0.3, 3.0), 1.0),
    Case("log", "1 ± 1e-15 to 0.1", exponentials.log, mpmath.log, near(1.0, 1e-15, 0.1), 1.0),
    Case("log", "all positive", exponentials.log, mpmath.log, sized(5e-324, 1.7e308, (1,)), 1.0),
    Case("log1p", "−0.999 to 3", exponentials.log1p, mpmath.log1p, even(-0.999, 3.0), 2.0),
    Case("log1p", "1e-20 to 0.9", exponentials.log1p, mpmath.log1p, sized(1e-20, 0.9), 2.0),
    Case("log1p", "0.1 to 1e300", exponentials.log1p, mpmath.log1p, sized(0.1, 1e300, (1,)), 2.0),
    *(
        Case("power", domain, exponentials.power, mpmath.power, draw, 2.0)
        for domain, draw in (
            ("1e-3 to 1e3, ±100", both(sized(1e-3, 1e3, (1,)), even(-100.0, 100.0))),
            ("1e-300 to 1e300, ±1.02", both(sized(1e-300, 1e300, (1,)), even(-1.02, 1.02))),
            ("1 ± 1e-12 to 1e-3, 1 to 1e5", both(near(1.0, 1e-12, 1e-3), sized(1.0, 1e5))),
            ("10, −323 to −300", both(even(10.0, 10.0), even(-323.0, -300.0))),
        )
    ),
    Case("erfc", "±6", normal.erfc, mpmath.erfc, even(-6.0, 6.0), 2.0),
    Case("erfc", "0.5 to 27.2", normal.erfc, mpmath.erfc, even(0.5, 27.2), 2.0),
    Case("erfc", "1e-20 to 0.6", normal.erfc, mpmath.erfc, sized(1e-20, 0.6), 2.0),
    Case(
        "normal_quantile",
        "0 to 1",
        normal.normal_quantile,
        normal_truth,
        even(0.0, 1.0),
        2e-15,
        True,
    ),
    Case(
        "normal_quantile",
        "1e-300 to 1e-3",
        normal.normal_quantile,
        normal_truth,
        sized(1e-300, 1e-3, (1,)),
        2e-15,
        True,
    ),
    *(
        Case("gamma_quantile", domain, gamma.gamma_quantile, gamma_truth, draw, 1e-9, True)
        for domain, draw in (
            ("shape 1e-4 to 1", gamma_points(1e-4, 1.0)),
            ("shape 1 to 100", gamma_points(1.0, 100.0)),
            ("shape 100 to 3000", gamma_points(100.0, 3000.0)),
        )
    ),
]


def worst(case: Case, points: int, random: Random) -> tuple[float, Point]:
    """The largest error among so many points, and where it is."""
    largest, where = -1.0, (math.nan,)
    with mp.workdps(60):
        for _ in range(points):
            point = case.draw(random)
            found, true = case.function(*point), case.truth(*map(mpf, point))
            unit = mpf(abs(true)) if case.relative else mpf(math.ulp(float(true)))
            off = float(abs(mpf(found) - true) / unit) if found != true else 0.0
            if not off <= largest:  # also NaN
                largest, where = off, point
    return largest, where


def main() -> None:
    """Print the table."""
    points, seed = int(sys.argv[1]), 20261128
    print("| function | on | points | largest error | promised |\n|---|---|---|---|---|")
    for case in CASES:
        share = points // 100 if case.relative else points
        off, _ = worst(case, share, Random(seed))
        told = (
            f"{off:.1e} | {case.bound:.0e}"
            if case.relative
            else f"{off:.3f} ulp | {case.bound:g} ulp"
        )
        print(f"| `{case.name}` | {case.domain} | {share} | {told} |", flush=True)


if __name__ == "__main__":
    main()
