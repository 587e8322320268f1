"""Laplacian, connectivity and components against networkx, numpy and closed forms."""

import itertools
import math
from random import Random

import networkx as nx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formnet.formation.paper.graph import (
    algebraic_connectivity,
    components,
    laplacian,
    smallest_eigenvalue,
)


@st.composite
def weighted_graphs(draw, connected=None):
    """(ids in the file's order, coupling) of a graph of 2 to 8 robots, ids with gaps."""
    ids = draw(st.lists(st.integers(0, 50), min_size=2, max_size=8, unique=True))
    pairs = [(min(a, b), max(a, b)) for i, a in enumerate(ids) for b in ids[i + 1 :]]
    chosen = draw(st.lists(st.sampled_from(pairs), unique=True))
    if connected:
        chain = [(min(a, b), max(a, b)) for a, b in itertools.pairwise(ids)]
        chosen = list(dict.fromkeys([*chain, *chosen]))
    return ids, {edge: draw(st.floats(0.01, 100.0)) for edge in chosen}


def networkx_graph(ids, coupling):
    graph = nx.Graph()
    graph.add_nodes_from(ids)
    graph.add_weighted_edges_from((a, b, weight) for (a, b), weight in coupling.items())
    return graph


def uniform(graph, weight=1.0):
    return sorted(graph), {(min(edge), max(edge)): weight for edge in graph.edges}


@given(weighted_graphs())
def test_laplacian_is_networkx_s(graph):
    ids, coupling = graph
    expected = nx.laplacian_matrix(networkx_graph(ids, coupling), nodelist=ids).toarray()
    found = laplacian(ids, coupling)
    np.testing.assert_allclose(found, expected, rtol=1e-14, atol=0)
    assert (found == found.T).all()
    np.testing.assert_allclose(found.sum(axis=1), 0.0, atol=1e-12)


@given(weighted_graphs())
def test_algebraic_connectivity_is_the_second_smallest_eigenvalue(graph):
    ids, coupling = graph
    spectrum = np.sort(nx.laplacian_spectrum(networkx_graph(ids, coupling)))
    found = algebraic_connectivity(laplacian(ids, coupling))
    assert found == pytest.approx(max(0.0, spectrum[1]), rel=1e-9, abs=1e-9)


@given(weighted_graphs())
def test_algebraic_connectivity_is_positive_if_and_only_if_connected(graph):
    ids, coupling = graph
    found = algebraic_connectivity(laplacian(ids, coupling))
    assert (found > 0.0) == nx.is_connected(networkx_graph(ids, coupling))


def test_algebraic_connectivity_tells_connected_from_not_for_any_weights():
    wrong = []
    for seed in range(60):
        random = Random(seed)
        graph = nx.gnp_random_graph(random.randint(3, 8), 0.35, seed=seed)
        coupling = {edge: random.uniform(0.1, 10.0) for edge in graph.edges}
        found = algebraic_connectivity(laplacian(sorted(graph), coupling))
        if (found > 0.0) != nx.is_connected(graph):
            wrong.append((seed, found))
    assert wrong == []


def test_algebraic_connectivity_of_a_disconnected_graph_is_zero_exactly():
    """Rounding must not make it look connected."""
    coupling = {
        (0, 4): 3.741516842003104,
        (1, 2): 9.96555498341083,
        (1, 3): 4.0870673060433464,
        (1, 4): 7.242241442086289,
    }
    for robots in range(6, 9):  # robot 5 and up have no edge
        assert algebraic_connectivity(laplacian(range(robots), coupling)) == 0.0


def test_algebraic_connectivity_of_a_weak_chain_is_not_lost():
    """Three robots, weights b: λ₂ of a path is 2b (1 - cos π/3) = b."""
    for b in (1e-6, 1.0, 1e6):
        found = algebraic_connectivity(laplacian([1, 2, 3], {(1, 2): b, (2, 3): b}))
        assert found == pytest.approx(b, rel=1e-9)


def test_one_robot_is_connected():
    assert algebraic_connectivity(laplacian([4], {})) == math.inf


@pytest.mark.parametrize("n", range(3, 9))
@pytest.mark.parametrize("b", [0.5, 2.0])
def test_closed_forms_of_the_algebraic_connectivity(n, b):
    cases = {
        "ring": (nx.cycle_graph(n), 2 * b * (1 - math.cos(2 * math.pi / n))),
        "star": (nx.star_graph(n - 1), b),
        "complete": (nx.complete_graph(n), n * b),
        "path": (nx.path_graph(n), 2 * b * (1 - math.cos(math.pi / n))),
    }
    for name, (graph, expected) in cases.items():
        found = algebraic_connectivity(laplacian(*uniform(graph, b)))
        assert found == pytest.approx(expected, rel=1e-12), name


@given(weighted_graphs(), st.data())
def test_smallest_eigenvalue_is_the_least_rayleigh_quotient(graph, data):
    ids, coupling = graph
    damping = data.draw(
        st.lists(st.floats(0.0, 10.0), min_size=len(ids), max_size=len(ids)), label="mu"
    )
    matrix = laplacian(ids, coupling)
    found = smallest_eigenvalue(matrix, damping)
    expected = np.linalg.eigvals(matrix + np.diag(damping)).real.min()
    assert found == pytest.approx(max(0.0, expected), rel=1e-9, abs=1e-9)
    assert found >= 0.0
    assert found <= sum(damping) / len(ids) + 1e-9  # the quotient of (1, ..., 1)


@given(weighted_graphs(connected=True), st.floats(0.001, 10.0))
def test_equal_damping_is_the_smallest_eigenvalue(graph, mu):
    ids, coupling = graph
    found = smallest_eigenvalue(laplacian(ids, coupling), [mu] * len(ids))
    assert found == pytest.approx(mu, abs=1e-10)


@given(weighted_graphs(connected=True), st.integers(0, 7), st.floats(0.1, 10.0))
def test_damping_of_one_robot_reaches_all_of_a_connected_graph(graph, which, mu):
    ids, coupling = graph
    damping = [0.0] * len(ids)
    assert smallest_eigenvalue(laplacian(ids, coupling), damping) < 1e-9
    damping[which % len(ids)] = mu
    assert smallest_eigenvalue(laplacian(ids, coupling), damping) > 1e-6


def test_smallest_eigenvalue_of_two_robots_in_closed_form():
    """[[b+mu, -b], [-b, b]]: (2b + mu - sqrt(4b² + mu²)) / 2."""
    b, mu = 2.0, 4.0
    found = smallest_eigenvalue(laplacian([1, 2], {(1, 2): b}), [mu, 0.0])
    assert found == pytest.approx((2 * b + mu - math.sqrt(4 * b * b + mu * mu)) / 2, rel=1e-12)


@given(weighted_graphs())
def test_components_are_networkx_s(graph):
    ids, coupling = graph
    expected = sorted(sorted(group) for group in nx.connected_components(networkx_graph(*graph)))
    assert components(ids, list(coupling)) == expected
    flipped = [(b, a) for a, b in reversed(list(coupling))]
    assert components(ids[::-1], flipped) == expected
