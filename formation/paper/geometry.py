"""How far a group of robots is from its formation: the errors of Eqs. 3, 4 and 5.

All functions take arrays whose last axes are robots and coordinates and work on
any number of leading axes (time).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Errors(NamedTuple):
    """The three errors, each with the leading shape of the input."""

    formation_m: Array
    heading_rad: Array
    centroid_m: Array


def fitted_rotation(positions_m: Array, offsets_m: Array) -> Array:
    """ψ of Eq. 3, fitted by least squares over all pairs.

    Least squares over pairs equals least squares over positions about their
    mean, whose optimum is closed-form (the planar Procrustes problem).
    ``positions_m``: (..., n, 2), ``offsets_m``: (n, 2).
    """
    x = positions_m - positions_m.mean(axis=-2, keepdims=True)
    p = offsets_m - offsets_m.mean(axis=0)
    # Eq. 3's matrix is [[cos ψ, sin ψ], [-sin ψ, cos ψ]].
    cosine = (x * p).sum(axis=(-2, -1))
    sine = (x[..., 0] * p[:, 1] - x[..., 1] * p[:, 0]).sum(axis=-1)
    return np.arctan2(sine, cosine)  # type: ignore[no-any-return]


def rotated(offsets_m: Array, rotation_rad: Array) -> Array:
    """``offsets_m`` (n, 2) turned by Eq. 3's matrix for each ψ: shape (..., n, 2)."""
    c, s = np.cos(rotation_rad)[..., None], np.sin(rotation_rad)[..., None]
    px, py = offsets_m[:, 0], offsets_m[:, 1]
    return np.stack([c * px + s * py, -s * px + c * py], axis=-1)


def formation_error(positions_m: Array, offsets_m: Array) -> Array:
    """Eq. 3: the largest ‖(x_l − x_j) − R(ψ)(p_l − p_j)‖ over all pairs, ψ fitted."""
    residual = positions_m - rotated(offsets_m, fitted_rotation(positions_m, offsets_m))
    gaps = residual[..., :, None, :] - residual[..., None, :, :]
    return np.linalg.norm(gaps, axis=-1).max(axis=(-2, -1))  # type: ignore[no-any-return]


def heading_error(headings_rad: Array) -> Array:
    """Eq. 4: the largest |θ_l − θ_j| over all pairs, differences taken on the circle."""
    gaps = headings_rad[..., :, None] - headings_rad[..., None, :]
    return np.abs((gaps + np.pi) % (2 * np.pi) - np.pi).max(axis=(-2, -1))  # type: ignore[no-any-return]


def centroid_error(positions_m: Array, offsets_m: Array) -> Array:
    """Eq. 5: ‖Σ x_j − Σ p_j‖ (the paper's sum, n times the centroid's distance)."""
    gap = (positions_m - offsets_m).sum(axis=-2)
    return np.linalg.norm(gap, axis=-1)  # type: ignore[no-any-return]


def errors(positions_m: Array, headings_rad: Array, offsets_m: Array) -> Errors:
    """All three errors; ``positions_m`` (..., n, 2), ``headings_rad`` (..., n)."""
    return Errors(
        formation_error(positions_m, offsets_m),
        heading_error(headings_rad),
        centroid_error(positions_m, offsets_m),
    )
