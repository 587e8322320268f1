"""The claims of the paper, and what lies beside them, as runs of the shipped scenarios.

Everything here is data: which scenario, what is changed in it, how it must end. Where the
paper leaves a choice open (graphs, starts, times), it is made here.
"""

import random
from collections.abc import Iterator
from itertools import combinations
from math import cos, pi, sin

import networkx as nx

from formnet.formation.paper.graph import components
from formnet.lab.claims.beyond import networks, remark_6, remark_9
from formnet.lab.claims.building import DELAYED, EXACT, SECTION5, claim_of, with_edges
from formnet.lab.claims.claim import ALL_HOLD, APART, NEVER_RISES, NOT_HOME, Case, Claim


def catalogue() -> list[Claim]:
    """All claims, in the order of the paper."""
    return [
        *_theorems(),
        *_corrections(),
        *_lyapunov(),
        *_delays(),
        *_graphs(),
        *_parameters(),
        *remark_6(),
        *remark_9(),
        *networks(),
    ]


# --- Theorems 1 to 6 -------------------------------------------------------------------


def _theorems() -> Iterator[Claim]:
    words = {
        1: "kinematic, no damping: formation and headings converge, the centroid need not",
        2: "kinematic, some μ > 0: the centroid converges too",
        3: "dynamic, uncertain mass and inertia, no damping: as Theorem 1",
        4: "dynamic, uncertain mass and inertia, some μ > 0: as Theorem 2",
        5: "kinematic, constant delays: as Theorem 2",
        6: "dynamic, uncertain mass and inertia, constant delays: as Theorem 4",
    }
    for number, says in words.items():
        expected = NOT_HOME if number in (1, 3) else ALL_HOLD
        case = Case(f"theorem{number}", f"paper/theorem{number}.toml", (), expected)
        yield claim_of(f"theorem-{number}", says, f"Theorem {number}", [case])
    for key, name, figures in (("figures-4-5", SECTION5, "4, 5"), ("figures-6-7", DELAYED, "6, 7")):
        says = "five robots reach the pattern with equal headings"
        says += ", delays of 0.1 s" if name == DELAYED else ""
        cases = [Case(key, name, (), ALL_HOLD)]
        yield claim_of(key, says, f"Section 5, Figures {figures}", cases)


def _corrections() -> Iterator[Claim]:
    printed = ("law.delta=printed", "duration_s=1.0")
    yield Claim(
        "printed-eq-19",
        "Δ with the sign printed in Eq. 19 (docs/corrections.md)",
        "Eq. 19, an error of the paper",
        "diverges",
        (
            Case("theorem-4", SECTION5, printed, APART, diverges=True),
            Case("theorem-6", DELAYED, printed, APART, diverges=True),
        ),
    )
    yield claim_of(
        "w1-zero",
        "w1 = 0 at all times",
        "Assumption 2 broken",
        [Case("w1-zero", SECTION5, ("law.w1.bias=0.0",))],
    )


def _lyapunov() -> Iterator[Claim]:
    equations = {1: 22, 2: 22, 3: 34, 4: 34, 5: 40, 6: 43}
    yield Claim(
        "lyapunov",
        "V never rises, with exact parameters and the compensated cross term "
        "(docs/corrections.md), beyond ρ ε exp(−γt) and the sampling error",
        "Eqs. 22, 34, 40, 43",
        "no rise",
        tuple(
            Case(
                f"eq-{equation}-theorem-{number}",
                f"paper/theorem{number}.toml",
                (*EXACT, "duration_s=20"),
                NEVER_RISES,
            )
            for number, equation in equations.items()
        ),
    )


# --- delays, graphs, parameters ----------------------------------------------------------


def _delays() -> Iterator[Claim]:
    durations_s = {0.0: 40, 0.05: 40, 0.1: 40, 0.2: 40, 0.5: 60, 1.0: 100, 2.0: 200}
    yield claim_of(
        "delay-independence",
        "any constant delay: δ = 0, 0.05, 0.1, 0.2, 0.5, 1, 2 s",
        "Theorem 6",
        [
            Case(
                f"{delay_s:g}s",
                DELAYED,
                (f"network.default.delay.mean_s={delay_s}", f"duration_s={duration_s}"),
                ALL_HOLD,
            )
            for delay_s, duration_s in durations_s.items()
        ],
    )
    delays_s = {1: 0.05, 2: 0.4, 3: 0.1, 4: 0.3, 5: 0.2}
    links = ",".join(
        f'{{from={robot}, to="*", delay={{distribution="constant", mean_s={delay_s}}}}}'
        for robot, delay_s in delays_s.items()
    )
    yield claim_of(
        "delays-differ",
        "a delay for each robot: δ = 0.05, 0.4, 0.1, 0.3, 0.2 s",
        "Theorem 6",
        [Case("delays-differ", DELAYED, (f"network.links=[{links}]", "duration_s=60"), ALL_HOLD)],
    )


def _graphs() -> Iterator[Claim]:
    graphs = [
        sorted((a + 1, b + 1) for a, b in graph.edges)
        for graph in nx.graph_atlas_g()
        if len(graph) == 5 and nx.is_connected(graph)
    ]
    yield claim_of(
        "five-robots",
        f"all {len(graphs)} connected graphs of five robots, up to renumbering",
        "Assumption 1",
        [
            Case(
                f"{number:02}-edges-{len(edges)}",
                DELAYED,
                (with_edges(edges), "duration_s=60"),
                ALL_HOLD,
            )
            for number, edges in enumerate(graphs, start=1)
        ],
    )
    for robots, probability in ((10, 0.3), (20, 0.2)):
        yield claim_of(
            f"{robots}-robots",
            f"random connected graphs of {robots} robots, one in five damped",
            "Assumption 1",
            [_random_group(robots, probability, seed) for seed in (1, 2, 3)],
        )


def _random_group(robots: int, probability: float, seed: int) -> Case:
    """A connected graph of Gilbert's model G(n, p), robots anywhere within 40 m, a circle to form.

    b = 1, since the law is the stiffer the more neighbours a robot has.
    """
    draw = random.Random(f"{robots} robots, seed {seed}").random  # the same in every Python
    ids = range(1, robots + 1)
    edges: list[tuple[int, int]] = []
    while len(components(ids, edges)) > 1:
        edges = [pair for pair in combinations(ids, 2) if draw() < probability]
    tables = []
    for k in range(robots):
        angle = 2.0 * pi * k / robots
        x, y = 0.4 * robots * cos(angle), 0.4 * robots * sin(angle)
        start = f"{80 * draw() - 40:.1f}", f"{80 * draw() - 40:.1f}"
        tables.append(
            f"{{id={k + 1}, offset_m=[{x:.3f}, {y:.3f}], damping={4.0 if k % 5 == 0 else 0.0}, "
            f"start={{x_m={start[0]}, y_m={start[1]}, heading_rad={(2 * draw() - 1) * pi:.2f}}}}}"
        )
    overrides = (
        f"robots=[{', '.join(tables)}]",
        with_edges(edges),
        "formation.coupling=1.0",
        "duration_s=80",
    )
    return Case(f"seed-{seed}", DELAYED, overrides, ALL_HOLD)


def _parameters() -> Iterator[Claim]:
    signals = {
        "constant-and-sine": "{bias=0.5, amplitude=0.3, frequency_radps=1.0}",
        "sine": "{bias=0.0, amplitude=0.7, frequency_radps=0.5}",
    }
    yield claim_of(
        "w1-varies",
        "w1 varies with time: 0.5 + 0.3 sin t, and 0.7 sin 0.5 t",
        "Assumption 2, Remark 3",
        [
            Case(name, DELAYED, (f"law.w1={w1}", "duration_s=60"), ALL_HOLD)
            for name, w1 in signals.items()
        ],
    )
    yield claim_of(
        "w1-varies-long",
        "w1 = 0.5 + 0.3 sin t for 200 s, mass and inertia uncertain, sampled at "
        "1 ms: ε exp(−γt) of Eq. 31 falls below what the sampling can follow",
        "Eq. 31 on a sampled loop",
        [
            Case(
                "w1-varies-long",
                DELAYED,
                (f"law.w1={signals['constant-and-sine']}", "duration_s=200"),
            )
        ],
    )
    factors = ((0.5, 0.5), (0.5, 4.0), (1.0, 1.0), (2.0, 0.5), (4.0, 0.5), (4.0, 4.0))
    yield claim_of(
        "wrong-estimates",
        "estimated mass and inertia 0.5 to 4 times the true values",
        "Theorem 6",
        [
            Case(
                f"mass-{mass:g}-inertia-{inertia:g}",
                DELAYED,
                (
                    f"robot_defaults.mass_estimate_kg={mass}",
                    f"robot_defaults.inertia_estimate_kgm2={inertia}",
                ),
                ALL_HOLD,
            )
            for mass, inertia in factors
        ],
    )
