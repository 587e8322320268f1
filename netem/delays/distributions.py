"""Distributions of delay, each by its quantile function. Seconds.

None is ever negative. What the parameters mean is in their names: tc-netem's
"jitter" is a half-range for one distribution and a standard deviation for
another.
"""

import math
from collections.abc import Sequence
from typing import Protocol

from formnet.exact.exponentials import exp, log, log1p, power
from formnet.exact.gamma import gamma_quantile
from formnet.exact.normal import normal_quantile, normal_share


class Distribution(Protocol):
    """A distribution of non-negative numbers."""

    def quantile(self, u: float) -> float:
        """The value below which a share ``u`` lies, 0 < u < 1."""
        ...


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name} must be > 0 and finite, got {value}")


class Known:
    """A distribution that ``numbers`` determine: equal ones of one class are equal."""

    def __init__(self, numbers: Sequence[float]) -> None:
        self._numbers = tuple(numbers)

    def quantile(self, u: float) -> float:
        raise NotImplementedError

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Known)
            and type(self) is type(other)
            and self._numbers == other._numbers
        )

    def __hash__(self) -> int:
        return hash((type(self).__name__, self._numbers))


class Normal(Known):
    """Normal, truncated at zero: only what lies above zero is drawn.

    ``mean`` and ``stddev`` are those before the truncation, which moves the
    mean up by stddev · φ(a)/Φ(a), a = mean/stddev (below 0.03 % of the standard
    deviation from a = 3.6 on). Nothing piles up at zero and no tail is clipped.
    """

    def __init__(self, mean: float, stddev: float) -> None:
        _positive(mean=mean, stddev=stddev)
        super().__init__((mean, stddev))
        self._mean, self._stddev = mean, stddev
        self._above = normal_share(mean / stddev)

    def quantile(self, u: float) -> float:
        share = self._above * (1.0 - u)  # of the untruncated normal above the value
        if share < 0.5:
            score = -normal_quantile(share)
        else:
            score = normal_quantile(1.0 - self._above + self._above * u)
        return max(0.0, self._mean + self._stddev * score)


class LogNormal(Known):
    """Log-normal with this ``mean`` and ``stddev`` of the delay itself (not of its logarithm)."""

    def __init__(self, mean: float, stddev: float) -> None:
        _positive(mean=mean, stddev=stddev)
        super().__init__((mean, stddev))
        spread = stddev / mean
        variance = log1p(spread * spread)
        self._mu, self._sigma = log(mean) - variance / 2.0, math.sqrt(variance)

    def quantile(self, u: float) -> float:
        return exp(self._mu + self._sigma * normal_quantile(u))


class Gamma(Known):
    """Gamma with this ``mean`` and ``stddev``: shape (mean/stddev)², scale stddev²/mean.

    ``stddev`` is at most 100 ``mean``: beyond, nearly every draw is below any number there is.
    """

    def __init__(self, mean: float, stddev: float) -> None:
        _positive(mean=mean, stddev=stddev)
        if stddev > 100.0 * mean:
            raise ValueError(f"stddev must be at most 100 mean, got {stddev} and {mean}")
        super().__init__((mean, stddev))
        root = mean / stddev
        self._shape, self._scale = root * root, stddev / root

    def quantile(self, u: float) -> float:
        return self._scale * gamma_quantile(self._shape, u)


class Weibull(Known):
    """Weibull: P(X > x) = exp(−(x/scale)^shape)."""

    def __init__(self, scale: float, shape: float) -> None:
        _positive(scale=scale, shape=shape)
        super().__init__((scale, shape))
        self._scale, self._power = scale, 1.0 / shape

    def quantile(self, u: float) -> float:
        return self._scale * power(-log1p(-u), self._power)


class Pareto(Known):
    """Pareto (type I): P(X > x) = (minimum/x)^shape for x ≥ ``minimum``.

    The mean is finite for shape > 1, the standard deviation for shape > 2.
    """

    def __init__(self, minimum: float, shape: float) -> None:
        _positive(minimum=minimum, shape=shape)
        super().__init__((minimum, shape))
        self._minimum, self._power = minimum, -1.0 / shape
        self.shape = shape
        self.has_variance = shape > 2.0

    def quantile(self, u: float) -> float:
        return self._minimum * power(1.0 - u, self._power)


class Exponential(Known):
    """Exponential with this ``mean``."""

    def __init__(self, mean: float) -> None:
        _positive(mean=mean)
        super().__init__((mean,))
        self._mean = mean

    def quantile(self, u: float) -> float:
        return -self._mean * log1p(-u)


class Empirical(Known):
    """One of ``samples``, each equally likely: the inverse of their empirical distribution."""

    def __init__(self, samples: Sequence[float]) -> None:
        if not samples:
            raise ValueError("samples must not be empty")
        for index, sample in enumerate(samples):
            if not 0.0 <= sample < math.inf:
                raise ValueError(f"samples[{index}] must be >= 0 and finite, got {sample}")
        self._sorted = sorted(samples)
        super().__init__(self._sorted)

    def quantile(self, u: float) -> float:
        return self._sorted[int(u * len(self._sorted))]
