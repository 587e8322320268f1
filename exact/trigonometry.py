"""Sine, cosine, tangent, arctangent and the hypotenuse.

The argument is reduced by π/2 in parts whose products with the quadrant's number are exact
(W. J. Cody and W. Waite, *Software Manual for the Elementary Functions*, 1980); what is left is
in ±π/4, where near-minimax polynomials take over.
"""

import math
from typing import Final

from formnet.exact.pairs import Pair, add, divide

NAN: Final = math.nan
_TWO_OVER_PI: Final = 0.6366197723675814
_ROUND: Final = 6755399441055744.0  # 1.5 · 2⁵²: adding and taking it away rounds to even
# π/2 = A + B + C + D, A to C with 33 bits each; B and C with 53 bits from C on.
_A: Final = 1.5707963267341256
_B: Final = 6.077100506303966e-11
_C: Final = 2.0222662487111665e-21
_D: Final = 8.4784276603689e-32
_C_AND_D: Final = 2.0222662487959506e-21
_TWO_PI: Final = 6.283185307179586
_QUARTER_PI: Final = 0.7853981633974483
_HALF_PI: Final = 1.5707963267948966
_HALF_PI_LOW: Final = 6.123233995736766e-17
_FAR: Final = 1e5

S1: Final = -0.16666666666666666
S2: Final = 0.008333333333330946
S3: Final = -0.0001984126983675497
S4: Final = 2.755731610068303e-06
S5: Final = -2.5051131455427943e-08
S6: Final = 1.5918101230273893e-10
C1: Final = 0.041666666666666664
C2: Final = -0.0013888888888887395
C3: Final = 2.4801587298763433e-05
C4: Final = -2.755731727056032e-07
C5: Final = 2.0876146024689503e-09
C6: Final = -1.138261486854208e-11


def _reduced(x: float) -> tuple[float, float, int]:
    """``x`` less the nearest multiple of π/2, as a pair, and which multiple, modulo 4."""
    if -_QUARTER_PI <= x <= _QUARTER_PI:
        return x, 0.0, 0
    if x > _FAR or x < -_FAR:
        x = math.copysign(abs(x) % _TWO_PI, x)  # of positive numbers, % is exact
    n = (x * _TWO_OVER_PI + _ROUND) - _ROUND
    near = x - n * _A  # exact, as is n · B
    more = n * _B
    rest = near - more
    part = rest - near
    low = (near - (rest - part)) - (more + part)
    if -1e-9 < rest < 1e-9:
        more = n * _C  # exact, too
        once = rest - more
        part = once - rest
        low = low + (((rest - (once - part)) - (more + part)) - n * _D)
        rest = once
    else:
        low = low - n * _C_AND_D
    whole = rest + low
    return whole, (rest - whole) + low, int(n) & 3


def sin_cos(x: float) -> tuple[float, float]:
    """(sin x, cos x), ``x`` in radians.

    At most 1 ulp off for |x| ≤ 1e5. Beyond, ``x`` is first reduced modulo the double
    nearest to 2π, which moves it by up to 4e-17 |x|. NaN for what is not finite.
    """
    if not -math.inf < x < math.inf:
        return NAN, NAN
    if -1e-8 < x < 1e-8:  # also −0.0
        return x, 1.0
    r, low, quadrant = _reduced(x)
    y = r * r
    half = 0.5 * y
    sine = r + (r * (y * (S1 + y * (S2 + y * (S3 + y * (S4 + y * (S5 + y * S6)))))) + low)
    near = 1.0 - half
    cosine = near + (
        ((1.0 - near) - half)
        + (y * y * (C1 + y * (C2 + y * (C3 + y * (C4 + y * (C5 + y * C6))))) - r * low)
    )
    if quadrant == 0:
        return sine, cosine
    if quadrant == 1:
        return cosine, -sine
    if quadrant == 2:
        return -sine, -cosine
    return -cosine, sine


def sin(x: float) -> float:
    """sin x; accuracy as :func:`sin_cos`."""
    return sin_cos(x)[0]


def cos(x: float) -> float:
    """cos x; accuracy as :func:`sin_cos`."""
    return sin_cos(x)[1]


def tan(x: float) -> float:
    """tan x: at most 2 ulp off for |x| ≤ 1e5, then as :func:`sin_cos`. NaN if not finite."""
    if not -math.inf < x < math.inf:
        return NAN
    if -1e-8 < x < 1e-8:
        return x
    r, low, quadrant = _reduced(x)
    y = r * r
    half = 0.5 * y
    more = r * (y * (S1 + y * (S2 + y * (S3 + y * (S4 + y * (S5 + y * S6)))))) + low * (1.0 - half)
    sine, sine_low = add(r, more)
    near = 1.0 - half
    more = ((1.0 - near) - half) + (
        y * y * (C1 + y * (C2 + y * (C3 + y * (C4 + y * (C5 + y * C6))))) - r * low
    )
    cosine, cosine_low = add(near, more)
    if quadrant & 1:
        quotient, rest = divide(-cosine, -cosine_low, sine, sine_low)
    else:
        quotient, rest = divide(sine, sine_low, cosine, cosine_low)
    return quotient + rest


# atan(k/8), k = 0 to 8, each as a double and what is left.
_ATAN: Final[tuple[float, ...]] = (
    0.0,
    0.12435499454676144,
    0.24497866312686414,
    0.35877067027057225,
    0.4636476090008061,
    0.5585993153435624,
    0.6435011087932844,
    0.7188299996216245,
    0.7853981633974483,
)
_ATAN_LOW: Final[tuple[float, ...]] = (
    0.0,
    -3.1253241424539383e-18,
    1.0698755618734451e-17,
    -2.4623815582638635e-17,
    2.2698777452961687e-17,
    -5.4556305485916264e-18,
    1.5834785051444286e-17,
    -2.1478388444456983e-17,
    3.061616997868383e-17,
)
A1: Final = -0.3333333333333332
A2: Final = 0.1999999999982517
A3: Final = -0.14285713928246127
A4: Final = 0.11110855188250911
A5: Final = -0.09016051576672393


def _angle(a: float, b: float) -> Pair:
    """atan(a/b), 0 ≤ a ≤ b, b > 0 and finite."""
    if b > 1e300:
        a, b = a * 9.5367431640625e-07, b * 9.5367431640625e-07  # 2⁻²⁰
    elif b < 1e-290:
        a, b = a * 1.157920892373162e77, b * 1.157920892373162e77  # 2²⁵⁶
    k = int(8.0 * (a / b) + 0.5)
    c = 0.125 * k
    t = (a - c * b) / (b + c * a) if k else a / b
    y = t * t
    return _ATAN[k], _ATAN_LOW[k] + (t + t * (y * (A1 + y * (A2 + y * (A3 + y * (A4 + y * A5))))))


def atan2(y: float, x: float) -> float:
    """The angle of (x, y) in radians, in [−π, π]: at most 2 ulp off; special values as in C99."""
    if x != x or y != y:
        return NAN
    a, b = abs(y), abs(x)
    if a == math.inf and b == math.inf:
        a = b = 1.0
    elif b == math.inf:
        a, b = 0.0, 1.0
    elif a == math.inf:
        a, b = 1.0, 0.0
    if a == 0.0 and b == 0.0:
        high, low = 0.0, 0.0
    elif a <= b:
        high, low = _angle(a, b)
    else:
        before, low = _angle(b, a)
        high, rest = add(_HALF_PI, -before)
        low = (rest + _HALF_PI_LOW) - low
    if math.copysign(1.0, x) < 0.0:
        high, rest = add(2.0 * _HALF_PI, -high)
        low = (rest + 2.0 * _HALF_PI_LOW) - low
    return math.copysign(high + low, y)


def atan(x: float) -> float:
    """atan x in radians, at most 2 ulp off; ±π/2 for ±∞."""
    return atan2(x, 1.0)


def hypot(x: float, y: float) -> float:
    """√(x² + y²) without undue overflow, at most 2 ulp off; ∞ if x or y is, even beside NaN."""
    a, b = abs(x), abs(y)
    if a == math.inf or b == math.inf:
        return math.inf
    if a < b:
        a, b = b, a
    if a != a or b != b:
        return NAN
    if a == 0.0:
        return 0.0
    if 1e-140 < a < 1e150:
        return math.sqrt(a * a + b * b)
    ratio = b / a
    return a * math.sqrt(1.0 + ratio * ratio)
