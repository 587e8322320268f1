"""What all figures share, and scenes; matplotlib is loaded for the first figure."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab import files

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito's palette: told apart with any kind of colour vision.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999933")

MOST_BENT = 40
"""Among more robots no edge bends: there is no room."""
_BOWS = (0.0, 0.12, -0.12, 0.24, -0.24, 0.36, -0.36)
_CLEAR = 0.07
"""How near an edge may come to a robot that is none of its ends, as a share of the extent."""


def bows(points: NDArray[np.float64], edges: Sequence[tuple[int, int]]) -> NDArray[np.float64]:
    """How far each edge between points (n, 2) bends so that it runs through no third point.

    ``edges`` are pairs of indices. A bow is the greatest distance from the straight line, as a
    share of its length, to the left of the way from the first end to the second; 0 if that is
    well. Outwards is tried first.
    """
    found = np.zeros(len(edges))
    if len(points) > MOST_BENT:
        return found
    clear = _CLEAR * float(np.ptp(points, axis=0).max())
    centre = points.mean(axis=0)
    for k, (first, second) in enumerate(edges):
        others = np.delete(points, [first, second], axis=0)
        ends = points[[first, second]]
        outwards = 1.0 if _left(ends) @ (ends.mean(axis=0) - centre) >= 0.0 else -1.0
        best = -1.0
        for bow in outwards * np.array(_BOWS):
            gaps = bowed(ends, bow, np.linspace(0.0, 1.0, 41))[:, None] - others
            nearest = float(np.linalg.norm(gaps, axis=-1).min(initial=np.inf))
            if nearest > best:
                found[k], best = bow, nearest
            if nearest > clear:
                break
    return found


def bowed(
    ends: NDArray[np.float64], bow: NDArray[np.float64] | float, at: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Points of edges that bend: a parabola's, each at the share ``at`` of the way.

    ``ends`` (2, 2) of one edge and ``at`` (k,), or of k edges (k, 2, 2) and ``at`` (k,): (k, 2).
    """
    share, bend = at[:, None], np.asarray(bow)[..., None]
    first, second = ends[..., 0, :], ends[..., 1, :]
    aside = 4.0 * share * (1.0 - share) * bend * _left(ends)
    return first + share * (second - first) + aside  # type: ignore[no-any-return]


def _left(ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Edges (..., 2, 2) turned to the left: (..., 2)."""
    along = ends[..., 1, :] - ends[..., 0, :]
    return np.stack([-along[..., 1], along[..., 0]], axis=-1)


def around(points: NDArray[np.float64]) -> NDArray[np.intp]:
    """Indices that go once around the mean of points (n, 2), and back to the first."""
    centred = points - points.mean(axis=0)
    order = np.argsort(np.arctan2(centred[:, 1], centred[:, 0]))
    return np.append(order, order[:1])


def blank(width: float, height: float) -> "Figure":
    """An empty figure, in inches, that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: "Figure", folder: Path, name: str) -> None:
    """A figure as the files ``name.png`` and ``name.svg``, each whole; raises OSError."""
    for kind in ("png", "svg"):
        image = io.BytesIO()
        figure.savefig(image, format=kind, dpi=130)
        files.replace(folder / f"{name}.{kind}", image.getvalue())
