"""Lines between robots, straight, bent or dashed, as Rerun draws them: in straight parts."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from formnet.lab.figures.canvas import bowed

Array = NDArray[Any]

DASHES = 7
"""Of a link that is cut."""
BENDS = 5
"""Straight parts of a link that bends around others."""


def beside(lines: Array, gap: float) -> Array:
    """Lines (..., 2, 2) moved to the side, so that the two directions of a link are two."""
    along = lines[..., 1, :] - lines[..., 0, :]
    length = np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    side = np.stack([-along[..., 1], along[..., 0]], axis=-1) / length
    return lines + gap * side[..., None, :]  # type: ignore[no-any-return]


def line_strips(lines: Array, bows: Array, parts: Array, gaps: Array) -> Array:
    """Lines (n, 2, 2) that bend by ``bows``, each in so many straight parts: (sum of parts, 2, 2).

    Where ``gaps``, every part is followed by a gap as long.
    """
    number = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    of, step = np.repeat(parts, parts), np.repeat(gaps + 1, parts)
    length = 1.0 / (step * (of - 1) + 1)
    begin = step * number * length
    line, bow = np.repeat(lines, parts, axis=0), np.repeat(bows, parts)
    ends = [bowed(line, bow, at) for at in (begin, begin + length)]
    return np.stack(ends, axis=1)
