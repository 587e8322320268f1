"""The ρ of a Gaussian copula for which delays have the correlation that was asked for.

With z and z' standard normal of correlation ρ, the correlation of Q(Φ(z)) and Q(Φ(z')) grows
from 0 to 1 with ρ, in a way that depends on the quantile function Q. Two ways lead from the
one to the other: Mehler's formula by Gauss-Hermite quadrature, which converges where Q∘Φ is
smooth, and a staircase in the place of Q∘Φ, which converges for any Q, with jumps and all.
What the first one finds is taken where the second confirms it.
"""

import math
from bisect import bisect_right
from collections.abc import Callable
from functools import cache, lru_cache
from itertools import pairwise
from typing import TypeAlias

from formnet.exact.exponentials import exp
from formnet.exact.normal import normal_share
from formnet.exact.trigonometry import atan2, cos, sin_cos
from formnet.netem.delays.copula import clipped
from formnet.netem.delays.distributions import Distribution, Known
from formnet.netem.delays.hermite import HALF

Quantile: TypeAlias = Callable[[float], float]

_TERMS = 120
_CONFIRMED = 2.5e-3
"""By how much the correlation that a staircase has may differ from the one that was asked for:
half of the 0.005 that are promised. What the staircase itself is off by is below 0.001."""
_WIDEST = 8.3
"""Beyond this normal score a copula's uniform number is the least or the largest that it draws."""
_FIRST_STEPS = 64
_SHARE = 1e-4
"""A step of a staircase that hides more of the variance is halved; makes some hundred steps."""
_PANELS = 26
"""Each half as wide as the one before: the last begins at π/2 / 2²⁶, whose cosine is just < 1."""
_LEGENDRE = (
    (-0.9602898564975362, 0.10122853629037706),
    (-0.7966664774136267, 0.22238103445337443),
    (-0.525532409916329, 0.3137066458778869),
    (-0.18343464249564978, 0.36268378337836166),
    (0.18343464249564978, 0.36268378337836166),
    (0.525532409916329, 0.3137066458778869),
    (0.7966664774136267, 0.22238103445337443),
    (0.9602898564975362, 0.10122853629037706),
)
"""Gauss-Legendre quadrature of 8 nodes on (-1, 1): each node with its weight."""
_NEGLIGIBLE = 40.0  # e^-40


def calibrated(distribution: Distribution, offset_s: float, correlation: float) -> float:
    """The ρ for delays of ``offset_s`` plus what ``distribution`` says (s), in whole nanoseconds.

    Raises:
        ValueError: the delays are all the same.
    """
    if isinstance(distribution, Known):
        return _remembered(distribution, offset_s, correlation)
    return _calibrated(distribution, offset_s, correlation)


@lru_cache(maxsize=256)
def _remembered(distribution: Known, offset_s: float, correlation: float) -> float:
    return _calibrated(distribution, offset_s, correlation)


def _calibrated(distribution: Distribution, offset_s: float, correlation: float) -> float:
    quantile = distribution.quantile
    stairs = Staircase(lambda u: round((offset_s + quantile(u)) * 1e9))
    return stairs.confirmed(latent_correlation(quantile, correlation), correlation)


def latent_correlation(quantile: Quantile, correlation: float) -> float:
    """The ρ for which Q(Φ(z_n)) has lag-1 ``correlation`` (Pearson), 0 ≤ correlation < 1.

    Mehler's formula: corr = Σ_{k≥1} c_k² ρᵏ / Σ_{k≥1} c_k², with the coefficients
    c_k of Q∘Φ in normalised Hermite polynomials, by Gauss-Hermite quadrature, so Q∘Φ
    must be smooth. It grows from 0 to 1 with ρ, so bisection finds it.
    """
    nodes, weights, polynomials = _hermite()
    values = [quantile(clipped(normal_share(z))) for z in nodes]
    weighted = [w * value for w, value in zip(weights, values, strict=True)]
    coefficients = [
        math.fsum(w * p for w, p in zip(weighted, polynomial, strict=True))
        for polynomial in polynomials
    ]
    powers = [coefficient * coefficient for coefficient in coefficients]
    total = math.fsum(powers)
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2.0
        reached = 0.0
        for share in reversed(powers):
            reached = (reached + share) * middle
        reached = reached / total
        low, high = (middle, high) if reached < correlation else (low, middle)
    return (low + high) / 2.0


@cache
def _hermite() -> tuple[list[float], list[float], list[list[float]]]:
    """Nodes, weights (sum 1) and the normalised polynomials of degree 1, 2, ... at the nodes."""
    half = list(HALF)
    nodes = [-node for node, _ in reversed(half)] + [node for node, _ in half]
    weights = [weight for _, weight in reversed(half)] + [weight for _, weight in half]
    before, current = [0.0] * len(nodes), [1.0] * len(nodes)
    polynomials = []
    for k in range(_TERMS):
        root, divisor = math.sqrt(k), math.sqrt(k + 1)
        following = [
            (z * now - root * last) / divisor
            for z, now, last in zip(nodes, current, before, strict=True)
        ]
        before, current = current, following
        polynomials.append(current)
    return nodes, weights, polynomials


def _angle(rho: float) -> float:
    """The angle whose cosine is ``rho``."""
    return atan2(math.sqrt((1.0 - rho) * (1.0 + rho)), rho)


class Staircase:
    """Correlations of a function that goes up in steps, close to ``quantile`` of Φ.

    With steps Δ_i up at the normal scores a_i, and ρ = cos t, Cov(ρ) is the sum over i and j of
    Δ_i Δ_j (P(z > a_i, z' > a_j) − P(z > a_i) P(z' > a_j)). The derivative of a bivariate normal
    probability with respect to ρ is its density (Plackett 1954; Drezner and Wesolowsky 1990), so

        Var − Cov(cos t) = Σ_ij Δ_i Δ_j / 2π ∫_0^t exp(−(a_i − a_j)² / (2 sin² s)
                                                       − a_i a_j / (1 + cos s)) ds.

    Every jump of ``quantile`` is between two scores that are near: a step that hides more than
    1e-4 of the variance is halved. ``quantile`` must not descend.

    Raises:
        ValueError: ``quantile`` is constant.
    """

    def __init__(self, quantile: Quantile) -> None:
        if quantile(clipped(0.0)) == quantile(clipped(1.0)):
            raise ValueError("all delays are the same, so a correlation means nothing")
        scores, heights, variance = _steps(quantile)
        rises = [
            (score, above - below)
            for score, (below, above) in zip(scores[1:-1], pairwise(heights), strict=True)
            if above > below
        ]
        pairs = []
        for i, (score, rise) in enumerate(rises):
            pairs.append((0.0, score * score, rise * rise))
            for other, another in rises[i + 1 :]:
                apart = score - other
                pairs.append((apart * apart / 2.0, score * other, 2.0 * rise * another))
        pairs.sort(key=lambda pair: pair[0])
        self._apart = [apart for apart, _, _ in pairs]
        self._together = [together for _, together, _ in pairs]
        self._weights = [weight / (2.0 * math.pi * variance) for _, _, weight in pairs]

    def confirmed(self, rho: float, correlation: float) -> float:
        """``rho`` if ``correlation`` comes of it, else the ρ of which it does.

        Any correlation can be had: the largest ρ below 1 gives all but some 1e-7.
        """
        if rho < 1.0 and abs(self.correlation(_angle(rho)) - correlation) < _CONFIRMED:
            return rho
        return cos(self.angle(correlation))

    def correlation(self, angle: float) -> float:
        """The correlation for ρ = cos ``angle``, 0 < ``angle`` ≤ π/2."""
        lost, high = 0.0, angle
        for _ in range(_PANELS):
            lost += self._lost(high / 2.0, high)
            high /= 2.0
        return 1.0 - lost - high * self._density(high)

    def angle(self, correlation: float) -> float:
        """The least ``angle`` for which cos ``angle`` < 1, or that of ``correlation`` if larger."""
        low = math.ldexp(math.pi / 2.0, -_PANELS)
        left = 1.0 - correlation - low * self._density(low)
        if left <= 0.0:
            return low
        for _ in range(_PANELS - 1):
            lost = self._lost(low, 2.0 * low)
            if lost > left:
                break
            low, left = 2.0 * low, left - lost
        least, most = low, 2.0 * low
        for _ in range(40):
            middle = (least + most) / 2.0
            least, most = (middle, most) if self._lost(low, middle) < left else (least, middle)
        return (least + most) / 2.0

    def _lost(self, low: float, high: float) -> float:
        """By how much the correlation at ``high`` is less than at ``low``, by Gauss-Legendre."""
        half, middle = (high - low) / 2.0, (high + low) / 2.0
        return half * math.fsum([w * self._density(middle + half * x) for x, w in _LEGENDRE])

    def _density(self, angle: float) -> float:
        sine, cosine = sin_cos(angle)
        square, wide = sine * sine, 1.0 + cosine
        total = 0.0
        for k in range(bisect_right(self._apart, _NEGLIGIBLE * square)):
            total += self._weights[k] * exp(-self._apart[k] / square - self._together[k] / wide)
        return total


def _steps(quantile: Quantile) -> tuple[list[float], list[float], float]:
    """Normal scores, ascending, the heights of the steps between each two, and their variance.

    Heights are in units of the range of ``quantile``, from 0 to 1.
    """
    low, high = quantile(clipped(0.0)), quantile(clipped(1.0))

    def height(score: float) -> float:
        return (quantile(clipped(_above(-score))) - low) / (high - low)

    scores = [_WIDEST * (2.0 * k / _FIRST_STEPS - 1.0) for k in range(_FIRST_STEPS + 1)]
    ends = [0.0, *(height(score) for score in scores[1:-1]), 1.0]
    while True:
        shares = [_between(a, b) for a, b in pairwise(scores)]
        heights = [(a + b) / 2.0 for a, b in pairwise(ends)]
        mean = math.fsum(p * h for p, h in zip(shares, heights, strict=True))
        gaps = [height - mean for height in heights]
        variance = math.fsum(p * (gap * gap) for p, gap in zip(shares, gaps, strict=True))
        finer_scores, finer_ends = scores[:1], ends[:1]
        for k, share in enumerate(shares):
            middle = (scores[k] + scores[k + 1]) / 2.0
            rise = ends[k + 1] - ends[k]
            hidden = share * (rise * rise)
            if hidden > _SHARE * variance and scores[k] < middle < scores[k + 1]:
                finer_scores.append(middle)
                finer_ends.append(height(middle))
            finer_scores.append(scores[k + 1])
            finer_ends.append(ends[k + 1])
        if len(finer_scores) == len(scores):
            return scores, heights, variance
        scores, ends = finer_scores, finer_ends


def _above(score: float) -> float:
    """P(z > score)."""
    return normal_share(-score)


def _between(low: float, high: float) -> float:
    """P(low < z < high); the first and the last step go on to infinity."""
    if low + high < 0.0:  # by symmetry, as digits are in the upper tail
        low, high = -high, -low
    return _above(low) - (0.0 if high >= _WIDEST else _above(high))
