"""What things are coloured by in the scene, as 0xRRGGBBAA."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from formnet.lab.figures.canvas import SCREEN_COLOURS, colours

Array = NDArray[Any]

GREY = 0x9A9A9AFF
"""A robot that is down, a link on which nothing was heard yet."""


def rgba(count: int) -> Array:
    """The colours of ``count`` things beside each other, (count,)."""
    shown = [int(colour[1:], 16) << 8 | 0xFF for colour in colours(count, SCREEN_COLOURS)]
    return np.array(shown, dtype=np.uint32)


def by_age(share: Array) -> Array:
    """Green for what was just said, red for what is as old as a silence.

    ``share`` is the age as a share of ``neighbours.silence_s``, of any shape, which is the
    result's.
    """
    x = np.clip(share, 0.0, 1.0)
    red = np.round(255 * np.minimum(1.0, 2 * x)).astype(np.int64)
    green = np.round(190 * np.minimum(1.0, 2 - 2 * x)).astype(np.int64)
    return red << 24 | green << 16 | 0x30 << 8 | 0xFF  # type: ignore[no-any-return]
