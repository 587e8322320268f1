"""V* = V + ζ2ᵀN⁻¹ζ2 / (2β), N = L + diag μ: it never rises though w1 z2 z3 is as printed.

V̇* = −SᵀNS − z2ᵀNz2 − ‖ζ2‖²/β − w1² ζ2ᵀN⁻¹ζ2, and at the dynamic level ζ2ᵀN⁻¹ũ2/β − ũᵀKũ besides
(docs/corrections.md): for constant w1 ≠ 0, without delays, where N is positive definite.
"""

import numpy as np

from formnet.formation.paper.graph import smallest_eigenvalue
from formnet.formation.scenario.model import Scenario
from formnet.lab.judge.closed_loop import Array, ClosedLoop


def is_defined(scenario: Scenario) -> bool:
    """Whether V* is a Lyapunov function of the law and the network; N is :func:`lean`'s."""
    law = scenario.law
    return (
        law.w1.constant
        and law.w1.bias != 0.0
        and law.cross_term == "printed"
        and law.delta == "corrected"
        and all(scenario.link_settings(*link).constant_ns == 0 for link in scenario.directed_links)
    )


def lean(loop: ClosedLoop) -> Array:
    """N⁻¹ζ2/β, the derivative of ζ2ᵀN⁻¹ζ2/(2β) by ζ2, (n, robots), of the robots that are up.

    N is that of the links between them; NaN at instants at which it is not positive definite.
    """
    found = np.zeros_like(loop.robots.z2)
    zeta2 = zeta(loop)
    patterns, which = np.unique(loop.up, axis=0, return_inverse=True)
    for k, up in enumerate(patterns):
        at = np.flatnonzero(which.ravel() == k)
        matrix = np.zeros((len(up), len(up)))
        for link in loop.links:
            if up[link.source] and up[link.destination]:
                matrix[link.destination, link.destination] += link.weight
                matrix[link.destination, link.source] -= link.weight
        matrix, damping = matrix[np.ix_(up, up)], loop.damping[up]
        if not len(matrix):
            continue
        rows = np.ix_(at, np.flatnonzero(up))
        if smallest_eigenvalue(matrix, damping) > 0.0:
            n = matrix + np.diag(damping)
            found[rows] = np.linalg.solve(n, zeta2[rows].T).T / loop.law.beta
        else:
            found[rows] = np.nan
    return found


def zeta(loop: ClosedLoop) -> Array:
    """ζ2, (n, robots)."""
    return loop.robots.z2 - loop.law.beta * loop.w.w1 * loop.robots.z3
