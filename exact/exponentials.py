"""Exponential and logarithm, their forms near 0 and 1, and powers with a real exponent.

Arguments are reduced by ln 2 in two parts, the first of which has 32 bits, so that its products
with exponents are exact; then polynomials take over. A power needs its logarithm to twice the
precision (:mod:`formnet.exact.pairs`).
"""

import math
from typing import Final

from formnet.exact.pairs import Pair, add, divide, multiply

_LOG2_E: Final = 1.4426950408889634
_LN2: Final = 0.6931471803691238  # 32 bits
_LN2_LOW: Final = 1.9082149292705877e-10
_ROUND: Final = 6755399441055744.0  # 1.5 · 2⁵²
_MOST: Final = 709.782712893384
_LEAST: Final = -745.1332191019412
_ROOT_HALF: Final = 0.7071067811865476

# 2ᵏ, k = 0 to 63, and 2⁶⁴ᵏ, k = −16 to 15: quicker than ``ldexp``, and as exact.
_UNITS: Final[tuple[float, ...]] = tuple([math.ldexp(1.0, k) for k in range(64)])
_STEPS: Final[tuple[float, ...]] = tuple([math.ldexp(1.0, 64 * k) for k in range(-16, 16)])

# (eʳ − 1 − r − r²/2)/r³ on ±ln 2/2.
E3: Final = 0.16666666666666669
E4: Final = 0.041666666666666664
E5: Final = 0.008333333333330062
E6: Final = 0.0013888888888886552
E7: Final = 0.00019841269863053618
E8: Final = 2.4801587317144498e-05
E9: Final = 2.7557268459997064e-06
E10: Final = 2.755728296954995e-07
E11: Final = 2.510038549551032e-08
E12: Final = 2.0911236630261545e-09

# 2 artanh(s) = 2s + s·z·(L1 + z·(L2 + …)), z = s².
L1: Final = 0.6666666666666666
L1_LOW: Final = 3.700743415417188e-17
L2: Final = 0.4000000000000088
L3: Final = 0.2857142857080285
L4: Final = 0.22222222391887064
L5: Final = 0.18181795621632776
L6: Final = 0.15386240708969895
L7: Final = 0.13268746195591385
L8: Final = 0.13086907888012236


def beyond_one(r: float, low: float) -> Pair:
    """e^(r + low) − 1 for |r| ≤ 0.35, as r and what is to be added to it."""
    y = r * r
    p = E5 + r * (E6 + r * (E7 + r * (E8 + r * (E9 + r * (E10 + r * (E11 + r * E12))))))
    rest = 0.5 * y + y * r * (E3 + r * (E4 + r * p))
    return r, rest + (low + low * (r + rest))


def reduced(x: float) -> tuple[float, float, int]:
    """``x`` less a multiple of ln 2, as a pair, and which multiple; |x| below 2000."""
    n = (x * _LOG2_E + _ROUND) - _ROUND
    near = x - n * _LN2  # exact
    more = n * _LN2_LOW
    r = near - more
    return r, (near - r) - more, int(n)


def scaled(x: float, exponent: int) -> float:
    """x · 2^exponent for x between ½ and 4; infinite where it overflows."""
    if -1022 <= exponent <= 1023:
        return x * _UNITS[exponent & 63] * _STEPS[(exponent >> 6) + 16]
    return math.ldexp(x, exponent) if exponent < 0 else math.ldexp(x, exponent - 2) * 4.0


def exp(x: float) -> float:
    """eˣ, at most 1 ulp off; ∞ where it overflows."""
    if x != x:
        return x
    if x > _MOST:
        return math.inf
    if x < _LEAST:
        return 0.0
    r, low, k = reduced(x)
    r, more = beyond_one(r, low)
    return scaled(1.0 + (r + more), k)


def expm1(x: float) -> float:
    """eˣ − 1, at most 2 ulp off also where x is small."""
    if x != x:
        return x
    if x > _MOST:
        return math.inf
    if x < -40.0:
        return -1.0
    if -1e-17 < x < 1e-17:  # also −0.0
        return x
    r, low, k = reduced(x)
    r, more = beyond_one(r, low)
    if k == 0:
        return r + more
    if k > 60:
        return scaled(1.0 + (r + more), k)
    unit = math.ldexp(1.0, -k)
    high, rest = add(1.0 - unit, r)
    return math.ldexp(high + (rest + more), k)


def _logarithm(f: float, more: float, k: int) -> float:
    """ln(1 + f) + more + k ln 2, for 1 + f between √½ and √2."""
    s = f / (2.0 + f)
    z = s * s
    r = z * (L1 + z * (L2 + z * (L3 + z * (L4 + z * (L5 + z * (L6 + z * (L7 + z * L8)))))))
    half = 0.5 * f * f
    if k == 0:
        return f - (half - (s * (half + r) + more))
    return k * _LN2 - ((half - (s * (half + r) + (k * _LN2_LOW + more))) - f)


def log(x: float) -> float:
    """ln x, at most 1 ulp off; −∞ at 0, NaN below."""
    if x == math.inf or x != x:
        return x
    if x <= 0.0:
        return -math.inf if x == 0.0 else math.nan
    m, k = math.frexp(x)
    if m < _ROOT_HALF:
        m, k = 2.0 * m, k - 1
    return _logarithm(m - 1.0, 0.0, k)


def log1p(x: float) -> float:
    """ln(1 + x), at most 2 ulp off also where x is small; −∞ at −1, NaN below."""
    if x == math.inf or x != x:
        return x
    if x <= -1.0:
        return -math.inf if x == -1.0 else math.nan
    if -1e-17 < x < 1e-17:  # also −0.0
        return x
    if -0.29 < x < 0.41:
        return _logarithm(x, 0.0, 0)
    u, rest = add(1.0, x)
    m, k = math.frexp(u)
    if m < _ROOT_HALF:
        m, k = 2.0 * m, k - 1
    return _logarithm(m - 1.0, rest / u, k)


def _exact_logarithm(x: float) -> Pair:
    """ln x to twice the precision, relative error below 2⁻⁶⁴; x > 0 and finite."""
    m, k = math.frexp(x)
    if m < _ROOT_HALF:
        m, k = 2.0 * m, k - 1
    f = m - 1.0
    if f == 0.0:
        s, s_low = 0.0, 0.0
    else:
        below, below_low = add(2.0, f)
        s, s_low = divide(f, 0.0, below, below_low)
    z, z_low = multiply(s, s)
    z_low = z_low + 2.0 * s * s_low
    tail = z * (L2 + z * (L3 + z * (L4 + z * (L5 + z * (L6 + z * (L7 + z * L8))))))
    u, u_low = add(L1, tail)
    u_low = u_low + L1_LOW
    w, w_low = multiply(z, u)
    w_low = w_low + (z * u_low + z_low * u)
    v, v_low = multiply(s, w)
    v_low = v_low + (s * w_low + s_low * w)
    high, low = add(2.0 * s, v)
    low = low + (v_low + 2.0 * s_low)
    if k:
        part, part_low = multiply(float(k), _LN2_LOW)
        near, near_low = add(k * _LN2, part)
        near, rest = add(near, high)
        high, low = near, rest + (near_low + part_low + low)
    return add(high, low)


def power(x: float, y: float) -> float:
    """x^y, at most 2 ulp off; special values as C99's ``pow``, so NaN for a real root of x < 0."""
    if y == 0.0 or x == 1.0:
        return 1.0
    if x != x or y != y:
        return math.nan
    size = abs(x)
    whole = abs(y) >= 4503599627370496.0 or y == math.floor(y)
    odd = whole and abs(y) < 9007199254740992.0 and abs(y) % 2.0 == 1.0
    if size == 1.0 and abs(y) == math.inf:
        return 1.0
    if size == 0.0 or size == math.inf or abs(y) == math.inf:
        result = math.inf if (size > 1.0) == (y > 0.0) else 0.0
    elif x < 0.0 and not whole:
        return math.nan
    else:
        result = _power(size, y)
    return -result if odd and math.copysign(1.0, x) < 0.0 else result


def _power(x: float, y: float) -> float:
    """x^y for x > 0, both finite."""
    high, low = _exact_logarithm(x)
    if abs(y) > 1e20:  # so |ln x| > 1e-16 decides
        y = math.copysign(1e20, y)
    elif abs(y) < 1e-25:
        return 1.0
    exponent, rest = multiply(high, y)
    if exponent > 710.0:
        return math.inf
    if exponent < -746.0:
        return 0.0
    r, r_low, k = reduced(exponent)
    r, more = beyond_one(r, r_low + (rest + low * y))
    return scaled(1.0 + (r + more), k)
