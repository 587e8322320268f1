"""Successive numbers that are correlated although each follows its distribution exactly.

A Gaussian copula: z_n = ρ z_{n−1} + √(1 − ρ²) ε_n is standard normal for every
n, so Φ(z_n) is uniform, and a quantile function of it has exactly that
distribution. (tc-netem mixes uniform numbers instead, which are then no longer
uniform.) The correlation of what comes out is not ρ but a function of ρ that
depends on the distribution; :mod:`netem.delays.calibration` inverts it.
"""

import math
from random import Random

from formnet.exact.normal import normal_quantile, normal_share

_LEAST, _MOST = 5.551115123125783e-17, 0.9999999999999999  # 2⁻⁵⁴, 1 − 2⁻⁵³


def clipped(u: float) -> float:
    """``u`` as a number strictly between 0 and 1."""
    return min(max(u, _LEAST), _MOST)


class GaussianCopula:
    """Uniform numbers whose normal scores have lag-1 correlation ``rho``; one draw each."""

    def __init__(self, rho: float) -> None:
        self.rho = rho
        self._innovation = math.sqrt(1.0 - rho * rho)
        self._z: float | None = None

    def uniform(self, random: Random) -> float:
        """The next number, strictly between 0 and 1."""
        score = normal_quantile(clipped(random.random()))
        z = score if self._z is None else self.rho * self._z + self._innovation * score
        self._z = z
        return clipped(normal_share(z))

    def go_on_from(self, before: "GaussianCopula") -> None:
        """Correlate the next number with the last one of ``before``."""
        self._z = before._z
