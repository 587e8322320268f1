"""Successive numbers that are correlated although each follows its distribution exactly.

A Gaussian copula: z_n = ρ z_{n−1} + √(1 − ρ²) ε_n is standard normal for every
n, so Φ(z_n) is uniform, and a quantile function of it has exactly that
distribution. (tc-netem mixes uniform numbers instead, which are then no longer
uniform.) The correlation of what comes out is not ρ but a function of ρ that
depends on the distribution; :func:`latent_correlation` inverts it.
"""

import math
from collections.abc import Callable
from random import Random
from statistics import NormalDist

import numpy as np

_NORMAL = NormalDist()
_LEAST, _MOST = 2.0**-54, 1.0 - 2.0**-53
_NODES = 180
_TERMS = 120


def latent_correlation(quantile: Callable[[float], float], correlation: float) -> float:
    """The ρ for which Q(Φ(z_n)) has lag-1 ``correlation`` (Pearson), 0 ≤ correlation < 1.

    Mehler's formula: corr = Σ_{k≥1} c_k² ρᵏ / Σ_{k≥1} c_k², with the coefficients
    c_k of Q∘Φ in normalised Hermite polynomials, by Gauss-Hermite quadrature.
    It grows from 0 to 1 with ρ, so bisection finds it.
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
    weights = weights / math.sqrt(2.0 * math.pi)
    values = np.array([quantile(clipped(_NORMAL.cdf(float(z)))) for z in nodes])
    before, current = np.zeros(_NODES), np.ones(_NODES)
    powers = []
    for k in range(_TERMS):
        before, current = current, (nodes * current - math.sqrt(k) * before) / math.sqrt(k + 1)
        powers.append(float(np.sum(weights * values * current)) ** 2)
    total = math.fsum(powers)
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2.0
        reached = math.fsum(p * middle ** (k + 1) for k, p in enumerate(powers)) / total
        low, high = (middle, high) if reached < correlation else (low, middle)
    return (low + high) / 2.0


def clipped(u: float) -> float:
    """``u`` as a number strictly between 0 and 1."""
    return min(max(u, _LEAST), _MOST)


class GaussianCopula:
    """Uniform numbers whose normal scores have lag-1 correlation ``rho``; one draw each."""

    def __init__(self, rho: float) -> None:
        self._rho = rho
        self._innovation = math.sqrt(1.0 - rho * rho)
        self._z: float | None = None

    def uniform(self, random: Random) -> float:
        """The next number, strictly between 0 and 1."""
        score = _NORMAL.inv_cdf(clipped(random.random()))
        z = score if self._z is None else self._rho * self._z + self._innovation * score
        self._z = z
        return clipped(0.5 * math.erfc(-z / math.sqrt(2.0)))

    def go_on_from(self, before: "GaussianCopula") -> None:
        """Correlate the next number with the last one of ``before``."""
        self._z = before._z
