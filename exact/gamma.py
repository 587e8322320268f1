"""The quantile of the gamma distribution.

Up to shape 100 by Newton's method, in the logarithm of the share below (a series) or above (a
continued fraction). Beyond, from the uniform expansion of N. M. Temme, SIAM Journal on
Mathematical Analysis 10 (1979) 757-766: with ½η² = λ − 1 − ln λ and λ = x/a, the share above is
that of a normal distribution at η√a, less a correction of known coefficients.
"""

import math
from typing import Final

from formnet.exact.exponentials import exp, log, log1p
from formnet.exact.normal import normal_quantile

_WIDE: Final = 100.0
_MOST_STEPS: Final = 200
_ENOUGH: Final = 1e-10
_HALF_LOG_TWO_PI: Final = 0.9189385332046728

# ln Γ(1 + a)/a in a − ½ on [0, 1], the highest power first (near-minimax, worked out with 60
# digits); λ − 1 in η, and Temme's C0, C1, C2 in η, their Taylor series likewise.
_LOG_GAMMA: Final[tuple[float, ...]] = (
    1.602033816023013e-05,
    -2.5095987621487964e-05,
    1.736355700889447e-05,
    -2.745883110986524e-05,
    5.6628518010402673e-05,
    -8.978104586758229e-05,
    0.00013842580494958799,
    -0.00022115249961823173,
    0.0003557726493907142,
    -0.0005737092124506384,
    0.0009305156049133655,
    -0.0015201690251150674,
    0.0025051236051560222,
    -0.004173532502969839,
    0.007052494875983705,
    -0.012148851359561978,
    0.02150990985553706,
    -0.03970703681678438,
    0.07856564482506971,
    -0.17741559645158742,
    0.5561088984981339,
    -0.24156447527049044,
)
_LAMBDA: Final[tuple[float, ...]] = (
    5.2401866818838735e-15,
    -2.513834640057088e-13,
    1.2822077905614429e-12,
    -3.239317851416903e-12,
    -1.5008349408791911e-12,
    5.717312238897994e-11,
    -2.921357345635569e-10,
    7.32986413160022e-10,
    5.159887341078076e-10,
    -1.47216272806884e-08,
    7.542464855411896e-08,
    -1.85406221071516e-07,
    -2.428276122977769e-07,
    4.899078973153047e-06,
    -2.553644914756026e-05,
    5.878894767783657e-05,
    0.0002314814814814815,
    -0.003703703703703704,
    0.027777777777777776,
    0.3333333333333333,
    1.0,
)
_C0: Final[tuple[float, ...]] = (
    2.4361948020667415e-11,
    -5.830772132550426e-11,
    -2.5514193994946248e-11,
    9.14769958223679e-10,
    -4.382036018453353e-09,
    1.0261809784240309e-08,
    6.707853543401498e-09,
    -1.7665952736826078e-07,
    8.296711340953087e-07,
    -1.85406221071516e-06,
    -2.185448510679992e-06,
    3.919263178522438e-05,
    -0.0001787551440329218,
    0.0003527336860670194,
    0.0011574074074074073,
    -0.014814814814814815,
    0.08333333333333333,
    -0.3333333333333333,
)
_C1: Final[tuple[float, ...]] = (
    -1.7543241719747647e-11,
    1.1951628599778148e-08,
    -5.752545603517705e-08,
    1.378633446915721e-07,
    4.647127802807434e-09,
    -1.6120900894563446e-06,
    7.64916091608111e-06,
    -1.8098550334489977e-05,
    -4.018775720164609e-07,
    0.00020576131687242798,
    -0.0009902263374485596,
    0.0026455026455026454,
    -0.003472222222222222,
    -0.001851851851851852,
)
_C2: Final[tuple[float, ...]] = (
    -6.298992138380055e-07,
    1.3721957309062934e-06,
    3.423578734096138e-08,
    -1.2760635188618728e-05,
    5.2923448829120125e-05,
    -0.0001073665322636516,
    2.0093878600823047e-06,
    0.0007716049382716049,
    -0.0026813271604938273,
    0.004133597883597883,
)


def gamma_quantile(shape: float, share: float) -> float:
    """The ``x`` below which a ``share`` of the gamma distribution of scale 1 lies.

    Relative error below 1e-9 for shapes from 1e-4 to 1e6 and shares from 2⁻⁵⁴ to 1 − 2⁻⁵³; it
    rises with the share, but for the last places. 0 where it is below all numbers.
    NaN for a shape that is not positive and finite, or a share outside 0 to 1.
    """
    if not (0.0 < shape < math.inf and 0.0 <= share <= 1.0):
        return math.nan
    if share == 0.0:
        return 0.0
    if share == 1.0:
        return math.inf
    return _wide(shape, share) if shape >= _WIDE else _narrow(shape, share)


def _polynomial(coefficients: tuple[float, ...], t: float) -> float:
    """A polynomial; coefficients from the highest power on."""
    total = coefficients[0]
    for index in range(1, len(coefficients)):
        total = total * t + coefficients[index]
    return total


def log_gamma(a: float) -> float:
    """ln Γ(1 + a) for a > 0, absolute error below 1e-15 (1 + a ln a); relative where a is small."""
    if a < 9.0:
        product = 1.0
        while a > 1.0:
            product = product * a
            a = a - 1.0
        return log(product) + a * _polynomial(_LOG_GAMMA, a - 0.5)
    y = 1.0 / (a * a)
    series = 1.0 / 156.0 - y * (3617.0 / 122400.0)
    series = 1.0 / 1188.0 - y * (691.0 / 360360.0 - y * series)
    series = 1.0 / 12.0 - y * (1.0 / 360.0 - y * (1.0 / 1260.0 - y * (1.0 / 1680.0 - y * series)))
    return (a + 0.5) * log(a) - a + _HALF_LOG_TWO_PI + series / a


def _narrow(a: float, share: float) -> float:
    log_share, above = log(share), 1.0 - share
    log_above = log(above)
    log_factor = log_gamma(a)
    bound = (log_share + log_factor) / a  # of ln x, from below: the share is at most xᵃ/Γ(1 + a)
    if bound < -746.0:
        return 0.0
    log_x = bound
    if a >= 1.0:
        root = 3.0 * math.sqrt(a)
        guess = 1.0 - 1.0 / (9.0 * a) + normal_quantile(share) / root  # Wilson and Hilferty
        if guess > 0.2:
            log_x = log(a) + 3.0 * log(guess)
    middle = log(a + 1.0)
    if a < 1.0 and log_x > middle:
        log_x = middle
    for _ in range(_MOST_STEPS):
        x = exp(log_x)
        log_front = a * log_x - x - log_factor
        if x < a + 1.0:
            total = _series(a, x)
            step = (log_share - log_front - log(total)) * total / a
        else:
            ratio = _fraction(a, x)  # of the share above to x times the density
            step = (log(a * ratio) + log_front - log_above) * ratio
            step = log1p(step) if step > -0.5 else -0.6931471805599453
        log_x = log_x + step
        if abs(step) < _ENOUGH:
            break
    return exp(log_x)


def _series(a: float, x: float) -> float:
    """Σ xⁿ/((a + 1)…(a + n)): the share below x, divided by xᵃ exp(−x)/Γ(1 + a)."""
    total = term = 1.0
    n = a
    while term > 1e-17 * total:
        n = n + 1.0
        term = term * x / n
        total = total + term
    return total


def _fraction(a: float, x: float) -> float:
    """The share above x, divided by xᵃ exp(−x)/Γ(a); x > a + 1 (Legendre; Lentz's method)."""
    b = x + 1.0 - a
    c, d = 1e300, 1.0 / b
    h = d
    for n in range(1, 1000):
        numerator = n * (a - n)
        b = b + 2.0
        d = 1.0 / (numerator * d + b)
        c = b + numerator / c
        change = c * d
        h = h * change
        if abs(change - 1.0) < 1e-16:
            break
    return h


def _wide(a: float, share: float) -> float:
    root = math.sqrt(a)
    z0 = normal_quantile(share)
    delta = 0.0
    for _ in range(_MOST_STEPS):
        z = z0 + delta
        eta = z / root
        s = _polynomial(_C0, eta) + (_polynomial(_C1, eta) + _polynomial(_C2, eta) / a) / a
        # ∫₀^δ exp(z t − t²/2) dt = Σ Heₙ(z) δⁿ⁺¹/(n + 1)! should be S/√a.
        before, hermite, power, total = 0.0, 1.0, delta, delta
        for n in range(1, 24):
            before, hermite = hermite, z * hermite - (n - 1.0) * before
            power = power * delta / (n + 1.0)
            total = total + hermite * power
        step = (s / root - total) * exp(delta * (0.5 * delta - z))
        delta = delta + step
        if abs(step) < 1e-14:
            break
    eta = (z0 + delta) / root
    return a * (1.0 + eta * _polynomial(_LAMBDA, eta))
