"""The errors of Eqs. 3 to 5 against closed forms, brute force and scipy."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import optimize

from formnet.formation.paper.geometry import (
    centroid_error,
    errors,
    fitted_rotation,
    formation_error,
    heading_error,
    rotated,
)

angles = st.floats(-10.0, 10.0)
lengths = st.floats(-100.0, 100.0)
seeds = st.integers(0, 2**32 - 1)
PENTAGON = np.array([[1.24, 3.8], [-3.24, 2.35], [-3.24, -2.35], [1.24, -3.8], [4.0, 0.0]])


def matrix(psi):
    """R of Eq. 3, in the paper's convention."""
    c, s = math.cos(psi), math.sin(psi)
    return np.array([[c, s], [-s, c]])


def pattern(seed, robots=None):
    random = np.random.default_rng(seed)
    return random.normal(scale=5.0, size=(robots or random.integers(2, 8), 2))


def turn(angle):
    """``angle`` on the circle, in (-pi, pi]."""
    return math.atan2(math.sin(angle), math.cos(angle))


# --- Eq. 3 ----------------------------------------------------------------------------


@given(seeds, angles, lengths, lengths)
def test_turned_and_moved_pattern_is_in_formation(seed, psi, x, y):
    offsets = pattern(seed)
    positions = offsets @ matrix(psi).T + [x, y]
    assert formation_error(positions, offsets) < 1e-10
    assert turn(fitted_rotation(positions, offsets) - psi) == pytest.approx(0.0, abs=1e-9)


def test_quarter_turn_has_the_sign_of_eq_3():
    """ψ = π/2 takes (1, 0) to (0, -1): clockwise, for the matrix is [[c, s], [-s, c]]."""
    offsets = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 2.0]])
    positions = np.array([[0.0, -1.0], [0.0, 1.0], [2.0, 0.0]])
    assert fitted_rotation(positions, offsets) == pytest.approx(math.pi / 2)
    assert rotated(offsets, np.array(math.pi / 2)) == pytest.approx(positions)


@given(seeds, angles)
def test_rotated_is_eq_3_s_matrix_times_each_offset(seed, psi):
    offsets = pattern(seed)
    by_hand = np.array([matrix(psi) @ p for p in offsets])
    np.testing.assert_allclose(rotated(offsets, np.array(psi)), by_hand, rtol=0, atol=1e-12)


def pair_residuals(positions, offsets, psi):
    return [
        (positions[i] - positions[j]) - matrix(psi) @ (offsets[i] - offsets[j])
        for i, j in itertools.combinations(range(len(offsets)), 2)
    ]


@pytest.mark.parametrize("seed", range(8))
def test_fitted_rotation_minimises_the_sum_of_squares_over_all_pairs(seed):
    """Against a global scan of Eq. 3's residuals, refined by scipy."""
    offsets = pattern(seed, robots=4)
    positions = pattern(seed + 1000, robots=4)

    def cost(psi):
        return sum(residual @ residual for residual in pair_residuals(positions, offsets, psi))

    start = min(np.linspace(-math.pi, math.pi, 73), key=cost)
    best = optimize.minimize_scalar(
        cost, bounds=(start - 0.1, start + 0.1), method="bounded", options={"xatol": 1e-10}
    ).x
    assert turn(fitted_rotation(positions, offsets) - best) == pytest.approx(0.0, abs=1e-6)


@given(seeds)
def test_formation_error_is_the_largest_residual_of_a_pair(seed):
    offsets = pattern(seed)
    positions = pattern(seed + 1, robots=len(offsets))
    psi = float(fitted_rotation(positions, offsets))
    by_hand = max(math.hypot(*r) for r in pair_residuals(positions, offsets, psi))
    assert formation_error(positions, offsets) == pytest.approx(by_hand, rel=1e-12)


@given(seeds, angles, lengths, lengths)
def test_formation_error_does_not_see_a_motion_of_the_whole_group(seed, psi, x, y):
    offsets = pattern(seed)
    positions = pattern(seed + 1, robots=len(offsets))
    moved = positions @ matrix(psi).T + [x, y]
    assert formation_error(moved, offsets) == pytest.approx(
        formation_error(positions, offsets), rel=1e-6, abs=1e-9
    )


@given(st.integers(0, 4), st.floats(0.001, 50.0), angles, angles)
def test_displaced_robot_is_seen(robot, distance, direction, psi):
    """By at least ‖e‖ / (1 + d/D), whatever ψ the fit takes.

    With all residuals at most ε, a pair of the others at distance D gives
    ‖R(ψ) - R‖ D <= ε; the displaced one and a neighbour at distance d then
    give ‖e‖ <= ε + ε d/D.
    """
    others = [i for i in range(5) if i != robot]
    big = max(math.dist(PENTAGON[i], PENTAGON[j]) for i, j in itertools.combinations(others, 2))
    near = min(math.dist(PENTAGON[i], PENTAGON[robot]) for i in others)
    positions = PENTAGON @ matrix(psi).T
    positions[robot] += distance * np.array([math.cos(direction), math.sin(direction)])
    assert formation_error(positions, PENTAGON) >= distance / (1 + near / big) * (1 - 1e-9)


def test_mirrored_pattern_is_not_in_formation():
    """Eq. 3 allows rotations only. Of the rhombus (±2, 0), (0, ±1) no mirror image shows;
    of an L it does."""
    ell = np.array([[0.0, 0.0], [0.0, 3.0], [1.0, 0.0]])
    assert formation_error(ell * [-1.0, 1.0], ell) > 0.5
    rhombus = np.array([[2.0, 0.0], [0.0, 1.0], [-2.0, 0.0], [0.0, -1.0]])
    assert formation_error(rhombus[[0, 3, 2, 1]] * [1.0, -1.0], rhombus) < 1e-12


def test_two_robots_exchanged_are_not_in_formation():
    assert formation_error(PENTAGON[[1, 0, 2, 3, 4]], PENTAGON) > 1.0


def test_all_robots_in_one_place_err_by_the_diameter_of_the_pattern():
    diameter = max(math.dist(p, q) for p in PENTAGON for q in PENTAGON)
    assert formation_error(np.full((5, 2), 7.0), PENTAGON) == pytest.approx(diameter)


@given(st.floats(0.1, 5.0))
def test_pattern_of_another_size_errs_by_the_difference_of_the_diameters(scale):
    diameter = max(math.dist(p, q) for p in PENTAGON for q in PENTAGON)
    assert formation_error(scale * PENTAGON, PENTAGON) == pytest.approx(
        abs(scale - 1) * diameter, abs=1e-12
    )


# --- Eq. 4 ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("headings", "expected"),
    [
        ([0.3], 0.0),
        ([0.3, 0.3, 0.3], 0.0),
        ([0.0, math.pi / 2], math.pi / 2),
        ([0.0, math.pi], math.pi),
        ([math.pi, 0.0], math.pi),
        ([math.pi - 0.1, 0.1 - math.pi], 0.2),
        ([0.0, 2 * math.pi + 0.3], 0.3),
        ([-20 * math.pi, 40 * math.pi - 0.25], 0.25),
        ([0.0, 0.1, 3.0], 3.0),
        ([0.0, 2 * math.pi / 3, -2 * math.pi / 3], 2 * math.pi / 3),
    ],
)
def test_heading_error_is_taken_on_the_circle(headings, expected):
    assert heading_error(np.array(headings)) == pytest.approx(expected, abs=1e-12)


@given(st.lists(st.tuples(st.floats(-50.0, 50.0), st.integers(-9, 9)), min_size=1, max_size=6))
def test_heading_error_is_the_largest_angle_between_two_headings(robots):
    """And full turns do not count."""
    headings = [heading for heading, _ in robots]
    by_hand = max(abs(turn(a - b)) for a, b in itertools.product(headings, repeat=2))
    turned = np.array([heading + 2 * math.pi * turns for heading, turns in robots])
    assert heading_error(np.array(headings)) == pytest.approx(by_hand, abs=1e-12)
    assert heading_error(turned) == pytest.approx(by_hand, abs=1e-11)


# --- Eq. 5 ----------------------------------------------------------------------------


@given(seeds, lengths, lengths)
def test_centroid_error_of_a_moved_pattern_is_n_times_the_distance(seed, x, y):
    offsets = pattern(seed)
    found = centroid_error(offsets + np.array([x, y]), offsets)
    assert found == pytest.approx(len(offsets) * math.hypot(x, y), abs=1e-9)


@given(seeds)
def test_centroid_error_is_the_sum_of_eq_5(seed):
    offsets = pattern(seed)
    positions = pattern(seed + 1, robots=len(offsets))
    dx = math.fsum(positions[:, 0]) - math.fsum(offsets[:, 0])
    dy = math.fsum(positions[:, 1]) - math.fsum(offsets[:, 1])
    assert centroid_error(positions, offsets) == pytest.approx(math.hypot(dx, dy), abs=1e-12)


@given(angles)
def test_turning_about_the_centroid_leaves_the_centroid(psi):
    centroid = PENTAGON.mean(axis=0)
    turned = (PENTAGON - centroid) @ matrix(psi).T + centroid
    assert centroid_error(turned, PENTAGON) < 1e-12


# --- shapes ---------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(), (1,), (0,), (17,), (3, 4)])
def test_errors_over_time_equal_those_of_every_instant(shape):
    random = np.random.default_rng(5)
    positions = random.normal(scale=10.0, size=(*shape, 5, 2))
    headings = random.normal(scale=5.0, size=(*shape, 5))
    found = errors(positions, headings, PENTAGON)
    for series in found:
        assert series.shape == shape
    for at in np.ndindex(shape):
        one = (
            formation_error(positions[at], PENTAGON),
            heading_error(headings[at]),
            centroid_error(positions[at], PENTAGON),
        )
        np.testing.assert_allclose([series[at] for series in found], one, rtol=1e-13)


def test_one_robot_is_always_in_formation():
    found = errors(np.array([[3.0, 4.0]]), np.array([2.0]), np.array([[0.0, 0.0]]))
    assert tuple(found) == (0.0, 0.0, 5.0)


def test_state_that_is_not_finite_gives_no_finite_formation_error():
    positions = PENTAGON.copy()
    positions[2, 0] = np.nan
    assert not np.isfinite(formation_error(positions, PENTAGON))
