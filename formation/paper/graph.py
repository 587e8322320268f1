"""The communication graph: Laplacian, connectivity, eigenvalues (Section 3.1 of the paper)."""

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray


def laplacian(
    robots: Sequence[int], coupling: Mapping[tuple[int, int], float]
) -> NDArray[np.float64]:
    """Weighted Laplacian L of Section 3.1, shape (n_robots, n_robots), in the order of ``robots``.

    ``coupling`` holds b_ji = b_ij once per undirected edge.
    """
    index = {robot: i for i, robot in enumerate(robots)}
    matrix = np.zeros((len(robots), len(robots)))
    for (first, second), weight in coupling.items():
        i, j = index[first], index[second]
        matrix[i, j] -= weight
        matrix[j, i] -= weight
        matrix[i, i] += weight
        matrix[j, j] += weight
    return matrix


def algebraic_connectivity(matrix: NDArray[np.float64]) -> float:
    """λ₂(L), the second smallest eigenvalue; > 0 if and only if the graph is connected.

    A single robot counts as connected; its λ₂ is infinite.
    """
    if len(matrix) < 2:
        return float("inf")
    return _eigenvalue(matrix, 1)


def smallest_eigenvalue(matrix: NDArray[np.float64], damping: Sequence[float]) -> float:
    """λ_min(L + diag μ); ``matrix`` is L, or what stands in its place with delays."""
    return _eigenvalue(matrix + np.diag(damping), 0)


def delayed_form(
    robots: Sequence[int],
    coupling: Mapping[tuple[int, int], float],
    delays_ns: Mapping[tuple[int, int], int],
) -> NDArray[np.float64]:
    """What Eq. 41 leaves of z2 at least in the place of L, (n_robots, n_robots).

    It is the minimum of ½ Σ b_ji (z2_j − y)² over what was sent before, y: one for all links on
    which a robot is heard with the same delay, z2_i itself on those without delay. With one delay
    δ_i > 0 for each sender it is ½ (D − A D⁻¹ A), D and A the degrees and weights; with another
    delay for each link, 0. ``delays_ns`` has both directions, (source, destination), of every edge
    in ``coupling``.
    """
    index = {robot: i for i, robot in enumerate(robots)}
    groups: dict[tuple[int, int], NDArray[np.float64]] = {}  # b of those who hear the same y
    for (source, destination), delay_ns in delays_ns.items():
        weight = coupling[min(source, destination), max(source, destination)]
        heard = groups.setdefault((source, delay_ns), np.zeros(len(robots)))
        heard[index[destination]] = weight
    matrix = np.zeros((len(robots), len(robots)))
    for (source, delay_ns), heard in groups.items():
        matrix += 0.5 * np.diag(heard)
        if delay_ns:
            matrix -= 0.5 * np.outer(heard, heard) / heard.sum()
        else:
            i = index[source]
            matrix[i, i] += 0.5 * heard.sum()
            matrix[i] -= 0.5 * heard
            matrix[:, i] -= 0.5 * heard
    return matrix


def _eigenvalue(matrix: NDArray[np.float64], index: int) -> float:
    """An eigenvalue of a positive semidefinite matrix; what is rounding error only is 0."""
    value = _spectrum(len(matrix), matrix.tobytes())[index]
    noise = 1e-13 * len(matrix) * float(np.abs(matrix).max())
    return value if value > noise else 0.0


@lru_cache(maxsize=4)
def _spectrum(count: int, content: bytes) -> list[float]:
    """All eigenvalues, ascending: the same matrix is asked for again and again."""
    matrix = np.frombuffer(content).reshape(count, count)
    return [float(value) for value in np.linalg.eigvalsh(matrix)]


def components(robots: Sequence[int], edges: Sequence[tuple[int, int]]) -> list[list[int]]:
    """Connected components, each sorted, ordered by their smallest robot."""
    group = {robot: [robot] for robot in robots}
    for first, second in edges:
        larger, smaller = group[first], group[second]
        if larger is smaller:
            continue
        if len(larger) < len(smaller):
            larger, smaller = smaller, larger
        larger += smaller
        for robot in smaller:
            group[robot] = larger
    return sorted(sorted(members) for members in {id(g): g for g in group.values()}.values())
