"""The exact functions against mpmath."""

import re
from pathlib import Path
from random import Random

import pytest
from arithmetic.accuracy import CASES, worst
from hypothesis import given
from hypothesis import strategies as st

from formnet.exact.gamma import gamma_quantile
from formnet.exact.normal import normal_quantile, normal_share


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.name}({case.domain})")
def test_no_point_is_further_off_than_promised(case):
    off, where = worst(case, 10 if case.relative else 250, Random(20261128))
    assert 0.0 <= off <= case.bound, f"{off} at {where}, seed 20261128"


def test_shapes_from_1e3_to_1e6_differ_from_the_normal_limit_as_they_should():
    """Cornish and Fisher's expansion, whose error falls with the shape squared."""
    for shape in (1e3, 1e4, 1e5, 1e6):
        for share in (0.001, 0.3, 0.5, 0.9, 0.9999):
            z = normal_quantile(share)
            root = shape**0.5
            expansion = (
                shape
                + root * z
                + (z * z - 1.0) / 3.0
                + (z**3 - 7.0 * z) / (36.0 * root)
                - (3.0 * z**4 + 7.0 * z * z - 16.0) / (810.0 * shape)
            )
            assert gamma_quantile(shape, share) == pytest.approx(expansion, rel=30.0 / shape**2.5)


def test_the_table_of_the_docs_has_every_case_within_its_promise():
    text = (Path(__file__).resolve().parents[2] / "docs" / "arithmetic.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \| ([^|]+) \| \d+ \| ([\d.e-]+)", text, re.MULTILINE)
    assert [(name, domain) for name, domain, _ in rows] == [(c.name, c.domain) for c in CASES]
    assert all(float(off) <= case.bound for (_, _, off), case in zip(rows, CASES, strict=True))


SHARES = st.floats(2.0**-54, 1.0 - 2.0**-53)


@given(st.floats(1e-4, 1e6), SHARES, SHARES)
def test_the_gamma_quantile_rises(shape, one, other):
    low, high = sorted((one, other))
    below, above = gamma_quantile(shape, low), gamma_quantile(shape, high)
    assert below <= above * (1.0 + 1e-13)
    assert round(below / shape * 1e9) <= round(above / shape * 1e9) or high - low < 1e-12


@given(SHARES, SHARES)
def test_the_normal_quantile_rises(one, other):
    low, high = sorted((one, other))
    assert normal_quantile(low) <= normal_quantile(high) + 1e-15


@given(st.floats(1e-300, 1.0 - 2.0**-53))
def test_the_normal_share_is_the_inverse(share):
    assert normal_share(normal_quantile(share)) == pytest.approx(share, rel=1e-12)
