"""The exact functions of arrays, element by element, with the bits of the scalar ones.

For laws and metrics of one's own that use NumPy, which must be installed. Arguments are
broadcast; every result is an array of float64 of their common shape.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from formnet.exact import exponentials, gamma, normal, trigonometry

Array = NDArray[np.float64]


def _each(function: Callable[..., float], *arguments: ArrayLike) -> Array:
    """``function`` of each element of the arguments, as Python's floats."""
    given = [np.asarray(argument, dtype=np.float64) for argument in arguments]
    with np.errstate(all="ignore"):  # the scalar functions do not warn either
        found: Any = np.frompyfunc(function, len(given), 1)(*(x.astype(object) for x in given))
    return np.asarray(found, dtype=np.float64)


def sin_cos(x: ArrayLike) -> tuple[Array, Array]:
    """(sin x, cos x), radians."""
    return sin(x), cos(x)


def sin(x: ArrayLike) -> Array:
    """sin x, radians."""
    return _each(trigonometry.sin, x)


def cos(x: ArrayLike) -> Array:
    """cos x, radians."""
    return _each(trigonometry.cos, x)


def tan(x: ArrayLike) -> Array:
    """tan x, radians."""
    return _each(trigonometry.tan, x)


def atan(x: ArrayLike) -> Array:
    """atan x, radians."""
    return _each(trigonometry.atan, x)


def atan2(y: ArrayLike, x: ArrayLike) -> Array:
    """The angles of (x, y), radians."""
    return _each(trigonometry.atan2, y, x)


def hypot(x: ArrayLike, y: ArrayLike) -> Array:
    """√(x² + y²)."""
    return _each(trigonometry.hypot, x, y)


def exp(x: ArrayLike) -> Array:
    """eˣ."""
    return _each(exponentials.exp, x)


def expm1(x: ArrayLike) -> Array:
    """eˣ − 1."""
    return _each(exponentials.expm1, x)


def log(x: ArrayLike) -> Array:
    """ln x."""
    return _each(exponentials.log, x)


def log1p(x: ArrayLike) -> Array:
    """ln(1 + x)."""
    return _each(exponentials.log1p, x)


def power(x: ArrayLike, y: ArrayLike) -> Array:
    """x^y."""
    return _each(exponentials.power, x, y)


def erfc(x: ArrayLike) -> Array:
    """The complementary error function."""
    return _each(normal.erfc, x)


def normal_share(z: ArrayLike) -> Array:
    """Φ(z)."""
    return _each(normal.normal_share, z)


def normal_quantile(share: ArrayLike) -> Array:
    """The inverse of Φ."""
    return _each(normal.normal_quantile, share)


def gamma_quantile(shape: ArrayLike, share: ArrayLike) -> Array:
    """The quantile of the gamma distribution of scale 1."""
    return _each(gamma.gamma_quantile, shape, share)
