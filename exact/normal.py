"""The complementary error function, and the normal distribution's share and quantile.

erfc(x) = exp(−x²) · g(x), where g is a polynomial on each of seven pieces (near-minimax, worked
out with 50 digits) and x² is known to twice the precision. The quantile is Algorithm AS 241 of
M. J. Wichura, Applied Statistics 37 (1988) 477-484.
"""

import math
from typing import Final

from formnet.exact.exponentials import beyond_one, log, reduced, scaled
from formnet.exact.pairs import add, multiply

_ROOT_HALF: Final = 0.7071067811865476
# erf(x) = x · (2/√π + x² · polynomial in x²) up to 0.5; the highest power first.
_TWO_BY_ROOT_PI: Final = 1.1283791670955126
_TWO_BY_ROOT_PI_LOW: Final = 1.533545961316588e-17
_NEAR: Final[tuple[float, ...]] = (
    -1.4786787853196564e-07,
    1.6389390291204785e-06,
    -1.4923827486228928e-05,
    0.00012055306252594571,
    -0.0008548326792781157,
    0.0052239776243227015,
    -0.026866170645104014,
    0.112837916709551,
    -0.37612638903183754,
)
# exp(x²) · erfc(x) about the middles of the pieces between these ends.
_ENDS: Final[tuple[float, ...]] = (0.9, 1.4, 2.0, 2.8, 3.8)
_MIDDLE: Final[tuple[float, ...]] = (0.7, 1.15, 1.7, 2.4, 3.3, 4.4)
_FIRST_LOW: Final[tuple[float, ...]] = (
    1.23410463046887e-17,
    2.0129185520706365e-19,
    -2.4717797251464176e-17,
    -2.612695377386918e-18,
    -1.1006964123117308e-17,
    -8.097426278984597e-18,
)
_SCALED: Final[tuple[tuple[float, ...], ...]] = (
    (
        5.838546636761502e-06,
        -1.795057287938695e-05,
        5.2644785924345195e-05,
        -0.00015172806311589143,
        0.0004221206665425862,
        -0.0011300802852567452,
        0.0029016583960898624,
        -0.0071165198745775995,
        0.01658819751259907,
        -0.03651955784893299,
        0.0753282830319371,
        -0.14402869274451394,
        0.2514766509850343,
        -0.39207669480629526,
        0.525930337349441,
    ),
    (
        7.546796553304147e-07,
        -2.5220079170442172e-06,
        8.020905660163174e-06,
        -2.528116250890028e-05,
        7.721259399471991e-05,
        -0.00022786751930574373,
        0.0006481100230584261,
        -0.0017707293229468778,
        0.004628778827130173,
        -0.011520648302197945,
        0.027135082028762948,
        -0.06000696508837841,
        0.12327817390916183,
        -0.23178034762810437,
        0.38982557368148185,
    ),
    (
        7.636976481716129e-08,
        -2.8190794021359853e-07,
        9.898317863793707e-07,
        -3.470642581646117e-06,
        1.1842083584195925e-05,
        -3.922515513370574e-05,
        0.0001258929918283175,
        -0.00039053099861477186,
        0.0011674746713413139,
        -0.0033515654446072537,
        0.00920008526974708,
        -0.024019058569977856,
        0.05923257010845733,
        -0.13672395703934478,
        0.2916632970753435,
    ),
    (
        5.597124255881706e-09,
        -2.3344578976868397e-08,
        9.203190784739904e-08,
        -3.6746403727717307e-07,
        1.4348231422356066e-06,
        -5.465673666249188e-06,
        2.029165012727426e-05,
        -7.329538725818225e-05,
        0.00025707553496955623,
        -0.0008735151446500392,
        0.002867662951911193,
        -0.009066178946084379,
        0.02749415537442705,
        -0.07958524131775262,
        0.21849873453703333,
    ),
    (
        2.9251158910793405e-10,
        -1.4141857862061025e-09,
        6.451442503820258e-09,
        -3.011737821357172e-08,
        1.381903825113657e-07,
        -6.217894779096231e-07,
        2.742839972741016e-06,
        -1.1849406502134196e-05,
        5.0074403026356776e-05,
        -0.00020671845418000943,
        0.0008323941077893139,
        -0.003263696691100967,
        0.01243498729621366,
        -0.04593100311415727,
        0.16400729757293264,
    ),
    (
        1.3191519547868556e-11,
        -7.526307555446161e-11,
        4.0622129659732624e-10,
        -2.2564439535846618e-09,
        1.2374723702517109e-08,
        -6.686842402578161e-08,
        3.5609227640885905e-07,
        -1.8677118559162297e-06,
        9.64230161466429e-06,
        -4.8963118836997526e-05,
        0.00024436462770172817,
        -0.0011976121589673228,
        0.0057582227548604835,
        -0.027132598359837366,
        0.1251416555381449,
    ),
)
# From 5 on, x · exp(x²) · erfc(x) in 1/x².
_FAR_MIDDLE: Final = 0.020637755102040817
_FAR_LOW: Final = -2.5366749913173186e-17
_FAR: Final[tuple[float, ...]] = (
    3180017.1298172064,
    -399512.9955661881,
    49779.554348163,
    -7280.370364854233,
    1160.9977723994532,
    -203.7818316656131,
    40.123500709743574,
    -9.066671162055778,
    2.4286336001357025,
    -0.8101024262102378,
    0.3658545448341303,
    -0.2658642067013316,
    0.5585393207576458,
)


def _without_constant(coefficients: tuple[float, ...], t: float) -> float:
    """A polynomial less its constant; coefficients from the highest power on."""
    total = coefficients[0]
    for index in range(1, len(coefficients) - 1):
        total = total * t + coefficients[index]
    return total * t


def erfc(x: float) -> float:
    """2/√π ∫ₓ^∞ exp(−t²) dt, at most 2 ulp off; 0 where it is below all numbers."""
    if x != x:
        return x
    size = abs(x)
    if size < 1e-17:
        return 1.0
    if size < 0.5:
        y = x * x
        poly = _NEAR[0]
        for index in range(1, len(_NEAR)):
            poly = poly * y + _NEAR[index]
        high, low = multiply(x, _TWO_BY_ROOT_PI)
        one, rest = add(1.0, -high)
        return one + (rest - (low + x * (_TWO_BY_ROOT_PI_LOW + y * poly)))
    if size > 28.0:
        return 0.0 if x > 0.0 else 2.0
    high, low, k = _upper(size)
    if x > 0.0:
        return scaled(high + low, k)
    return 2.0 - scaled(high + low, k)


def _upper(x: float) -> tuple[float, float, int]:
    """erfc(x) for 0.5 ≤ x ≤ 28 as (high + low) · 2^k."""
    square, square_low = multiply(x, x)
    r, r_low, k = reduced(-square)
    r, more = beyond_one(r, r_low - square_low)
    power, power_low = add(1.0, r)
    power_low = power_low + more
    if x < 5.0:
        piece = 0
        while piece < 5 and x >= _ENDS[piece]:
            piece += 1
        polynomial = _SCALED[piece]
        rest = _without_constant(polynomial, x - _MIDDLE[piece])
        g, g_low = add(polynomial[len(polynomial) - 1], rest)
        g_low = g_low + _FIRST_LOW[piece]
    else:
        inverse = 1.0 / x
        product, error = multiply(inverse, x)
        inverse_low = ((1.0 - product) - error) * inverse
        rest = _without_constant(_FAR, inverse * inverse - _FAR_MIDDLE)
        h, h_low = add(_FAR[len(_FAR) - 1], rest)
        h_low = h_low + _FAR_LOW
        g, g_low = multiply(h, inverse)
        g_low = g_low + (h * inverse_low + h_low * inverse)
    high, low = multiply(power, g)
    low = low + (power * g_low + power_low * g)
    return high, low, k


def normal_share(z: float) -> float:
    """Φ(z), the share of the standard normal distribution below ``z``.

    Its relative error is below 3e-16 (1 + z²).
    """
    return 0.5 * erfc(-z * _ROOT_HALF)


def normal_quantile(share: float) -> float:
    """The ``z`` with Φ(z) = ``share``, relative error below 2e-15; ∓∞ at 0 and 1, NaN outside."""
    q = share - 0.5
    if -0.425 <= q <= 0.425:
        r = 0.180625 - q * q
        over = (
            (2509.0809287301227 * r + 33430.57558358813) * r + 67265.7709270087
        ) * r + 45921.95393154987
        over = (
            ((over * r + 13731.69376550946) * r + 1971.5909503065513) * r + 133.14166789178438
        ) * r + 3.3871328727963665
        under = (
            (5226.495278852854 * r + 28729.085735721943) * r + 39307.89580009271
        ) * r + 21213.794301586597
        under = (
            ((under * r + 5394.196021424751) * r + 687.1870074920579) * r + 42.31333070160091
        ) * r + 1.0
        return q * over / under
    tail = share if q < 0.0 else 1.0 - share
    if not tail > 0.0:  # also NaN
        return math.copysign(math.inf, q) if tail == 0.0 else math.nan
    r = math.sqrt(-log(tail))
    if r <= 5.0:
        r = r - 1.6
        over = (
            (0.0007745450142783414 * r + 0.022723844989269184) * r + 0.2417807251774506
        ) * r + 1.2704582524523684
        over = (
            ((over * r + 3.6478483247632045) * r + 5.769497221460691) * r + 4.630337846156546
        ) * r + 1.4234371107496835
        under = (
            (1.0507500716444169e-09 * r + 0.0005475938084995345) * r + 0.015198666563616457
        ) * r + 0.14810397642748008
        under = (
            ((under * r + 0.6897673349851) * r + 1.6763848301838038) * r + 2.053191626637759
        ) * r + 1.0
    else:
        r = r - 5.0
        over = (
            (2.0103343992922881e-07 * r + 2.7115555687434876e-05) * r + 0.0012426609473880784
        ) * r + 0.026532189526576124
        over = (
            ((over * r + 0.29656057182850487) * r + 1.7848265399172913) * r + 5.463784911164114
        ) * r + 6.657904643501103
        under = (
            (2.0442631033899397e-15 * r + 1.421511758316446e-07) * r + 1.8463183175100548e-05
        ) * r + 0.0007868691311456133
        under = (
            ((under * r + 0.014875361290850615) * r + 0.1369298809227358) * r + 0.599832206555888
        ) * r + 1.0
    return math.copysign(over / under, q)
