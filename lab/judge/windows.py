"""Integrals over what lies a constant time back, without cancellation.

A difference of two integrals from the beginning on loses what is smaller than their last place:
long after a run has settled, everything.
"""

import numpy as np
from numpy.typing import NDArray

from formnet.lab.judge.closed_loop import Array


def windowed(t_s: Array, values: Array, rates: Array, span_s: float) -> Array:
    """∫ of ``values`` from ``span_s`` before each instant (from the first one at most) to it, (n,).

    By the trapezoidal rule with its end correction, the piece at the beginning by a cubic (fourth
    order). Only numbers from within the window are added up, in pairs: the error is at most
    some 2 log2(n) units in the last place of the largest piece's sum.
    """
    h = np.diff(t_s)
    pieces = 0.5 * h * (values[1:] + values[:-1]) - h**2 / 12.0 * (rates[1:] - rates[:-1])
    begin = np.maximum(t_s - span_s, t_s[0])
    first = np.clip(np.searchsorted(t_s, begin, side="right") - 1, 0, len(h) - 1)
    now = np.arange(len(t_s))
    share = (begin - t_s[first]) / h[first]
    slopes = h[first] * values[first], h[first] * values[first + 1]
    before = share * (
        slopes[0]
        + share * (3.0 * pieces[first] - 2.0 * slopes[0] - slopes[1])
        + share**2 * (slopes[0] + slopes[1] - 2.0 * pieces[first])
    )
    part = np.where(first < now, pieces[first] - before, 0.0)
    return part + _sums(pieces, np.minimum(first + 1, now), now)


def _sums(pieces: Array, begin: NDArray[np.intp], end: NDArray[np.intp]) -> Array:
    """The sum of ``pieces[begin:end]`` for each pair, by sums of 1, 2, 4 ... of them."""
    total, left = np.zeros(len(end)), end - begin
    runs, length = np.concatenate(([0.0], pieces)), 1  # runs[k]: the sum of those up to k
    at = end.copy()
    while left.any():
        odd = left % 2 == 1
        total[odd] += runs[at[odd]]
        at[odd] -= length
        left //= 2
        runs[length:] = runs[length:] + runs[:-length]
        length *= 2
    return total
