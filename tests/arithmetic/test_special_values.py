"""Signed zeros, infinities, NaN and subnormals, as C99's Annex F has them."""

import math
from itertools import product

import pytest

from formnet.exact.exponentials import exp, expm1, log, log1p, power
from formnet.exact.gamma import gamma_quantile
from formnet.exact.normal import erfc, normal_quantile
from formnet.exact.trigonometry import atan, atan2, cos, hypot, sin, sin_cos, tan

INF, NAN, LEAST = math.inf, math.nan, 5e-324
VALUES = (0.0, -0.0, 1.0, -1.0, 0.5, -0.5, 2.0, -2.0, 3.0, -3.0, 1e300, -1e300, INF, -INF, NAN)
SMALL = (LEAST, -LEAST, 1e-310, -1e-310)


def same(found, wanted):
    if wanted != wanted:
        return found != found
    return found == wanted and math.copysign(1.0, found) == math.copysign(1.0, wanted)


@pytest.mark.parametrize(
    ("function", "cases"),
    [
        (
            sin,
            [(0.0, 0.0), (-0.0, -0.0), (INF, NAN), (-INF, NAN), (LEAST, LEAST), (-1e-310, -1e-310)],
        ),
        (cos, [(0.0, 1.0), (-0.0, 1.0), (INF, NAN), (NAN, NAN), (LEAST, 1.0)]),
        (tan, [(0.0, 0.0), (-0.0, -0.0), (INF, NAN), (1e-310, 1e-310)]),
        (
            atan,
            [(0.0, 0.0), (-0.0, -0.0), (INF, math.pi / 2), (-INF, -math.pi / 2), (LEAST, LEAST)],
        ),
        (
            exp,
            [
                (0.0, 1.0),
                (-0.0, 1.0),
                (INF, INF),
                (-INF, 0.0),
                (NAN, NAN),
                (710.0, INF),
                (-746.0, 0.0),
            ],
        ),
        (exp, [(-745.1, LEAST), (709.782712893384, 1.7976931348622732e308), (1e-320, 1.0)]),
        (expm1, [(0.0, 0.0), (-0.0, -0.0), (INF, INF), (-INF, -1.0), (NAN, NAN), (LEAST, LEAST)]),
        (
            log,
            [
                (0.0, -INF),
                (-0.0, -INF),
                (1.0, 0.0),
                (-1.0, NAN),
                (INF, INF),
                (-INF, NAN),
                (NAN, NAN),
            ],
        ),
        (log, [(LEAST, -744.4400719213812)]),
        (
            log1p,
            [
                (0.0, 0.0),
                (-0.0, -0.0),
                (-1.0, -INF),
                (-2.0, NAN),
                (INF, INF),
                (NAN, NAN),
                (LEAST, LEAST),
            ],
        ),
        (
            erfc,
            [
                (0.0, 1.0),
                (-0.0, 1.0),
                (INF, 0.0),
                (-INF, 2.0),
                (NAN, NAN),
                (30.0, 0.0),
                (LEAST, 1.0),
            ],
        ),
        (
            normal_quantile,
            [(0.0, -INF), (1.0, INF), (-0.1, NAN), (1.1, NAN), (NAN, NAN), (0.5, 0.0)],
        ),
    ],
)
def test_one_argument(function, cases):
    for x, wanted in cases:
        assert same(function(x), wanted), (x, function(x), wanted)


@pytest.mark.parametrize(
    ("function", "oracle"), [(atan2, math.atan2), (hypot, math.hypot), (power, math.pow)]
)
def test_two_arguments_as_the_c_library(function, oracle):
    """Where Python's ``math`` raises instead, see below."""
    compared = 0
    for x, y in product((*VALUES, *SMALL), repeat=2):
        try:
            wanted = oracle(x, y)
        except (ValueError, OverflowError):
            continue
        found = function(x, y)
        if wanted and math.isfinite(wanted):
            assert found == pytest.approx(wanted, rel=1e-15, abs=LEAST), (x, y)
        else:
            assert same(found, wanted), (x, y, found, wanted)
        compared += 1
    assert compared > 250


def test_powers_where_python_raises():
    assert same(power(0.0, -1.0), INF)
    assert same(power(-0.0, -1.0), -INF)
    assert same(power(-0.0, -2.0), INF)
    assert same(power(-2.0, 0.5), NAN)
    assert same(power(1e300, 2.0), INF)
    assert same(power(-1e300, 3.0), -INF)


def test_gamma_s_ends():
    assert same(gamma_quantile(2.0, 0.0), 0.0)
    assert same(gamma_quantile(2.0, 1.0), INF)
    assert gamma_quantile(1e-4, 0.5) == 0.0  # e^−6931
    for shape, share in ((0.0, 0.5), (-1.0, 0.5), (INF, 0.5), (NAN, 0.5), (1.0, -0.1), (1.0, NAN)):
        assert math.isnan(gamma_quantile(shape, share))


def test_an_angle_far_out_is_reduced_and_has_a_sine():
    for x in (1e6, 1e15, 1e300, 1.7e308):
        s, c = sin_cos(x)
        assert s * s + c * c == pytest.approx(1.0, abs=1e-15)
        assert same(sin(-x), -s)
    for x in (2e5, 1e6, 1e7):
        assert sin(x) == pytest.approx(math.sin(x), abs=5e-17 * x + 1e-15)
