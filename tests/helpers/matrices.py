"""The matrices of Eqs. 1 and 7, written as the paper writes them.

The plant integrates the scalar equations of :mod:`plant.body`; these matrices are
their source, for tests of the structure itself (Properties 1-4, energy).
"""

import numpy as np
from numpy.typing import NDArray

from formnet.plant.body import Body

Matrix = NDArray[np.float64]


def inertia(body: Body, heading_rad: float) -> Matrix:
    """M(q) of Eq. 1, (3, 3), for q = (x, y, θ) at the middle of the axle."""
    m, md = body.mass_kg, body.mass_kg * body.com_offset_m
    s, c = np.sin(heading_rad), np.cos(heading_rad)
    return np.array([[m, 0, -md * s], [0, m, md * c], [-md * s, md * c, body.axle_inertia_kgm2]])


def coriolis(body: Body, heading_rad: float, turn_rate_radps: float) -> Matrix:
    """C(q, q̇) of Eq. 1, (3, 3), such that Ṁ − 2C is skew-symmetric (Property 1)."""
    mdw = body.mass_kg * body.com_offset_m * turn_rate_radps
    s, c = np.sin(heading_rad), np.cos(heading_rad)
    return np.array([[0, 0, -mdw * c], [0, 0, -mdw * s], [0, 0, 0]])


def input_matrix(body: Body, heading_rad: float) -> Matrix:
    """B(q) of Eq. 1, (3, 2), for τ = (right, left) wheel torques."""
    s, c, half = np.sin(heading_rad), np.cos(heading_rad), body.half_axle_m
    return np.array([[c, c], [s, s], [half, -half]]) / body.wheel_radius_m


def reduction(heading_rad: float) -> Matrix:
    """g(q) of Eq. 6, (3, 2): q̇ = g (v, ω)."""
    return np.array([[np.cos(heading_rad), 0], [np.sin(heading_rad), 0], [0, 1]])


def reduction_rate(heading_rad: float, turn_rate_radps: float) -> Matrix:
    """ġ(q) of Eq. 7, (3, 2)."""
    w = turn_rate_radps
    return np.array([[-w * np.sin(heading_rad), 0], [w * np.cos(heading_rad), 0], [0, 0]])


def reduced_inertia(body: Body, heading_rad: float) -> Matrix:
    """M̃ = gᵀ M g of Eq. 7, (2, 2)."""
    g = reduction(heading_rad)
    return g.T @ inertia(body, heading_rad) @ g


def reduced_coriolis(body: Body, heading_rad: float, turn_rate_radps: float) -> Matrix:
    """C̃ = gᵀ M ġ + gᵀ C g of Eq. 7, (2, 2)."""
    g, g_dot = reduction(heading_rad), reduction_rate(heading_rad, turn_rate_radps)
    m, c = inertia(body, heading_rad), coriolis(body, heading_rad, turn_rate_radps)
    return g.T @ (m @ g_dot + c @ g)


def reduced_input(body: Body, heading_rad: float) -> Matrix:
    """B̃ = gᵀ B of Eq. 7, (2, 2)."""
    return reduction(heading_rad).T @ input_matrix(body, heading_rad)
