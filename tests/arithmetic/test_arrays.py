"""The exact functions of arrays have the bits of the scalar ones."""

import numpy as np
import pytest
from arithmetic import bits

from formnet.exact import arrays

NAMES = [(module, name, count) for module, name, count in bits.FUNCTIONS if name != "sin_cos"]


@pytest.mark.parametrize(("module", "name", "count"), [*NAMES, ("trigonometry", "sin", 1)])
def test_an_array_has_the_bits_of_its_elements(module, name, count):
    scalar = bits.installed()[module][name]
    points = bits.arguments(name, count)[-300:] + bits.arguments(name, count)[:12]
    found = getattr(arrays, name)(*map(np.array, zip(*points, strict=True)))
    assert found.dtype == np.float64
    assert found.tobytes() == np.array([scalar(*point) for point in points]).tobytes()


def test_shapes_are_broadcast():
    x, y = np.linspace(-1.0, 1.0, 12).reshape(3, 4), np.arange(1.0, 5.0)
    assert arrays.atan2(x, y).shape == (3, 4)
    assert arrays.power(abs(x), 2).shape == (3, 4)
    assert arrays.exp(1).shape == ()
    assert arrays.sin([]).shape == (0,)
    sine, cosine = arrays.sin_cos(x)
    assert np.array_equal(sine, arrays.sin(x))
    assert np.allclose(sine**2 + cosine**2, 1.0)
    with pytest.raises(ValueError, match="broadcast"):
        arrays.hypot([1.0, 2.0], [1.0, 2.0, 3.0])
