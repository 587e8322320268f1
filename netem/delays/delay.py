"""Delay: how long a message travels."""

import math
from bisect import bisect_right
from collections.abc import Sequence
from random import Random

from formnet.exact.trigonometry import sin
from formnet.netem.core.checks import correlation as checked_correlation
from formnet.netem.core.link import Impairment
from formnet.netem.core.transit import Transit
from formnet.netem.delays.calibration import Staircase, calibrated
from formnet.netem.delays.copula import GaussianCopula, clipped
from formnet.netem.delays.distributions import Distribution, Pareto

_MANY = 4096
"""So many equally likely values in a row, or more, are correlated as a continuum is."""


class ConstantDelay:
    """Every message travels ``delay_ns`` nanoseconds (Theorems 5 and 6)."""

    name = "delay"

    def __init__(self, delay_ns: int) -> None:
        if delay_ns < 0:
            raise ValueError(f"delay_ns must be >= 0, got {delay_ns}")
        self._delay_ns = delay_ns

    def twin(self) -> "ConstantDelay":
        return self

    def inherit(self, before: Impairment) -> None:
        """Nothing: no message depends on another."""

    def apply(self, copy: Transit, random: Random) -> None:
        if not copy.hurried:
            copy.due_ns += self._delay_ns


class UniformDelay:
    """Travel time uniform on the whole nanoseconds from ``low_ns`` to ``high_ns``, both included.

    ``low`` and ``high`` are the ends of the range, not tc-netem's half-range
    "jitter". Later messages may overtake earlier ones. ``correlation`` is the
    lag-1 correlation of the travel times, within 0.005; it leaves their distribution as it is.

    Raises:
        ValueError: the range is none, or a correlation where there is only one value.
    """

    name = "delay"

    def __init__(self, low_ns: int, high_ns: int, correlation: float = 0.0) -> None:
        if not 0 <= low_ns <= high_ns:
            raise ValueError(f"need 0 <= low_ns <= high_ns, got low_ns={low_ns}, high_ns={high_ns}")
        self._low_ns = low_ns
        count = self._count = high_ns - low_ns + 1
        rho = 2.0 * sin(math.pi / 6.0 * checked_correlation(correlation))  # of a continuum
        if correlation and count < _MANY:
            rho = Staircase(lambda u: int(u * count)).confirmed(rho, correlation)
        self._copula = GaussianCopula(rho) if rho else None

    def twin(self) -> "UniformDelay":
        twin = UniformDelay(self._low_ns, self._low_ns + self._count - 1)
        twin._copula = _twin(self._copula)
        return twin

    def inherit(self, before: Impairment) -> None:
        if isinstance(before, UniformDelay | RandomDelay):
            _go_on(self._copula, before._copula)

    def apply(self, copy: Transit, random: Random) -> None:
        u = random.random() if self._copula is None else self._copula.uniform(random)
        if not copy.hurried:
            copy.due_ns += self._low_ns + int(u * self._count)


class RandomDelay:
    """Travel time = ``offset_s`` plus a number drawn from ``distribution`` (seconds), rounded
    to the nearest nanosecond. ``correlation`` as for :class:`UniformDelay`.

    Raises:
        ValueError: a negative offset, or a correlation where there is no variance: none that
            is finite, or one value.
    """

    name = "delay"

    def __init__(
        self, distribution: Distribution, offset_s: float = 0.0, correlation: float = 0.0
    ) -> None:
        if not 0.0 <= offset_s < math.inf:
            raise ValueError(f"offset_s must be >= 0 and finite, got {offset_s}")
        if (
            checked_correlation(correlation)
            and isinstance(distribution, Pareto)
            and not distribution.has_variance
        ):
            raise ValueError(
                f"shape = {distribution.shape} has no variance, so correlation = {correlation} "
                "means nothing: needs shape > 2"
            )
        self._distribution = distribution
        self._quantile = distribution.quantile
        self._offset_s = offset_s
        self._copula = (
            GaussianCopula(calibrated(distribution, offset_s, correlation)) if correlation else None
        )

    def twin(self) -> "RandomDelay":
        twin = RandomDelay(self._distribution, self._offset_s)
        twin._copula = _twin(self._copula)
        return twin

    def inherit(self, before: Impairment) -> None:
        if isinstance(before, UniformDelay | RandomDelay):
            _go_on(self._copula, before._copula)

    def apply(self, copy: Transit, random: Random) -> None:
        u = clipped(random.random()) if self._copula is None else self._copula.uniform(random)
        if not copy.hurried:
            copy.due_ns += round((self._offset_s + self._quantile(u)) * 1e9)


class TraceDelay:
    """Replays a recorded delay: at time t the one of the latest row not after t, looping.

    ``times_ns`` ascend from 0; ``delays_ns`` stand beside them; the trace starts
    anew every ``period_ns``, which is longer than the last time.
    """

    name = "delay"

    def __init__(self, times_ns: Sequence[int], delays_ns: Sequence[int], period_ns: int) -> None:
        if not times_ns or times_ns[0] != 0 or len(times_ns) != len(delays_ns):
            raise ValueError("a trace needs rows, the first at time 0, and a delay for each time")
        if any(a >= b for a, b in zip(times_ns, [*times_ns[1:], period_ns], strict=True)):
            raise ValueError("the times of a trace must ascend, and its period exceed the last")
        if min(delays_ns) < 0:
            raise ValueError(f"delays must be >= 0, got {min(delays_ns)}")
        self._times_ns = list(times_ns)
        self._delays_ns = list(delays_ns)
        self._period_ns = period_ns

    def twin(self) -> "TraceDelay":
        return self

    def inherit(self, before: Impairment) -> None:
        """Nothing: a trace goes by the clock."""

    def apply(self, copy: Transit, random: Random) -> None:
        if not copy.hurried:
            row = bisect_right(self._times_ns, copy.sent_ns % self._period_ns) - 1
            copy.due_ns += self._delays_ns[row]


def _twin(copula: GaussianCopula | None) -> GaussianCopula | None:
    """One that is calibrated alike and has drawn nothing."""
    return None if copula is None else GaussianCopula(copula.rho)


def _go_on(copula: GaussianCopula | None, before: GaussianCopula | None) -> None:
    """Have the first delay of a changed distribution correlate with the last one before."""
    if copula is not None and before is not None:
        copula.go_on_from(before)
