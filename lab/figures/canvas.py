"""What all figures share, and scenes; matplotlib is loaded for the first figure."""

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from formnet.lab.runs import files

if TYPE_CHECKING:
    from formnet.lab.figures.plotting import Figure

# Okabe and Ito's palette: told apart with any kind of colour vision.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999933")
SCREEN_COLOURS = tuple("#AA4499" if colour == "#000000" else colour for colour in COLOURS)
"""The palette of what is drawn on dark and on light grounds alike: without black."""
MOST_COLOURS = 512
"""How many colours differ; beyond, they repeat."""
DASHES = ("-", "--", "-.", ":")
"""Line styles, the next one after as many lines as the palette has colours."""
_LIGHTNESS = (35.0, 80.0)
"""CIELAB L* of the colours beyond the palette: seen on white, on black and under white letters."""

HALF_IN = (6.4, 4.6)
"""The size (inches) of what stands beside another in the report."""
MOST_NAMED = 20
"""How many robots a legend names."""
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


def curves(points: NDArray[np.float64], edges: Sequence[tuple[int, int]]) -> NDArray[np.float64]:
    """Edges between points (n, 2), as they bend (see :func:`bows`): (edges, 41, 2), end to end."""
    share = np.linspace(0.0, 1.0, 41)
    found = [
        bowed(points[list(edge)], bow, share)
        for edge, bow in zip(edges, bows(points, edges), strict=True)
    ]
    return np.array(found).reshape(-1, len(share), 2)


def _left(ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Edges (..., 2, 2) turned to the left: (..., 2)."""
    along = ends[..., 1, :] - ends[..., 0, :]
    return np.stack([-along[..., 1], along[..., 0]], axis=-1)


def colours(count: int, palette: tuple[str, ...] = COLOURS) -> list[str]:
    """``count`` colours as ``#RRGGBB``, the first ones those of ``palette``.

    Each further one is, of a lattice in sRGB, the colour whose least distance to all before it is
    greatest (farthest-first traversal; distances are CIE 1976 ΔE*ab), so that who has which
    colour does not depend on ``count``. Up to MOST_COLOURS all differ.
    """
    some = palette if count <= len(palette) else _apart(palette)
    return [some[k % len(some)] for k in range(count)]


def dashes(count: int) -> list[str]:
    """Line styles for ``count`` lines: solid for as many as the palette has colours, then others.

    Colours of two lines that cross may look alike; the palette's do not, nor do their styles.
    """
    return [DASHES[k // len(COLOURS) % len(DASHES)] for k in range(count)]


def cielab(srgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """CIELAB L*, a*, b* (n, 3) of sRGB colours (n, 3) in [0, 1]; white is D65.

    IEC 61966-2-1 (sRGB to CIE XYZ) and CIE 15 (XYZ to L*a*b*).
    """
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    xyz = linear @ _TO_XYZ.T / _TO_XYZ.sum(axis=1)  # over that of white
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    x, y, z = f.T
    return np.stack([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)], axis=1)


_TO_XYZ = np.array(
    [
        [0.4124, 0.3576, 0.1805],
        [0.2126, 0.7152, 0.0722],
        [0.0193, 0.1192, 0.9505],
    ]
)


@cache
def _apart(palette: tuple[str, ...]) -> list[str]:
    """MOST_COLOURS colours (see :func:`colours`)."""
    levels = np.arange(16) * 17
    lattice = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    places = cielab(lattice / 255.0)
    fit = (places[:, 0] >= _LIGHTNESS[0]) & (places[:, 0] <= _LIGHTNESS[1])
    lattice, places = lattice[fit], places[fit]
    taken = [[int(one[k : k + 2], 16) for k in (1, 3, 5)] for one in ("#FFFFFF", *palette)]
    gaps = places[:, None] - cielab(np.array(taken) / 255.0)  # white is the ground
    least = np.linalg.norm(gaps, axis=-1).min(axis=1)
    found = list(palette)
    while len(found) < MOST_COLOURS:
        best = int(np.argmax(least))
        found.append("#{:02X}{:02X}{:02X}".format(*lattice[best]))
        least = np.minimum(least, np.linalg.norm(places - places[best], axis=1))
    return found


@contextmanager
def plain_style() -> Iterator[None]:
    """Figures are made and saved in matplotlib's own style here.

    Else it obeys the user's settings, with which pictures differ from machine to machine.
    """
    from formnet.lab.figures.plotting import style

    with style.context("default"):
        yield


def blank(width: float, height: float) -> "Figure":
    """An empty figure, in inches, that needs no display."""
    from formnet.lab.figures.plotting import Figure, FigureCanvasAgg

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def as_label(text: str) -> str:
    """A stranger's text in a figure: no formula, which could be wrong, and not left out.

    To matplotlib, ``$`` begins a formula, and a label that begins with ``_`` stands in no legend.
    """
    return ("\u2009" if text.startswith("_") else "") + text.replace("$", r"\$")


def save(
    figure: "Figure", folder: Path, name: str, kinds: Sequence[str] = ("png", "svg"), dpi: int = 130
) -> None:
    """A figure as the files ``name.png`` and ``name.svg``, each whole; raises OSError."""
    for kind in kinds:
        image = io.BytesIO()
        figure.savefig(image, format=kind, dpi=dpi)
        figure.set_layout_engine("none")  # it is laid out now, which takes as long as drawing
        files.replace(folder / f"{name}.{kind}", image.getvalue())


def line_or_point(t_s: NDArray[np.float64]) -> str:
    """matplotlib's format of a series over ``t_s`` (n,): a point where there is but one instant."""
    return "-" if len(t_s) > 1 else "o"
