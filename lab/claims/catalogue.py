"""The claims of the paper, and what lies beside them, as runs of the shipped scenarios.

Everything here is data: which scenario, what is changed in it, how it must end. Where the
paper leaves a choice open (graphs, starts, times), it is made here.
"""

import random
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations
from math import cos, pi, sin

import networkx as nx

from formnet.formation.paper.graph import components
from formnet.lab.claims.claim import ALL_HOLD, APART, NEVER_RISES, NOT_HOME, Case, Claim
from formnet.lab.judge.claim_words import EQUATIONS

SECTION5, DELAYED = "paper/section5.toml", "paper/section5-delay.toml"
FOLLOWING = "faults/leader-follower.toml"
EXACT = (
    "law.cross_term=compensated", "robot_defaults.mass_estimate_kg=1.0",
    "robot_defaults.inertia_estimate_kgm2=1.0",
)  # fmt: skip
"""What makes V of the proofs fall at every instant: all terms cancelled, nothing uncertain."""
RING = ((1, 2), (2, 3), (3, 4), (4, 5), (5, 1))
STAR = ((1, 2), (1, 3), (1, 4), (1, 5))
PATH = ((1, 2), (2, 3), (3, 4), (4, 5))
DAMPED = {1}
"""The robots of Section 5 with μ > 0."""

COMPARED = ("cooperative-robot-4-at-30s", "leader-follower-robot-4-at-30s")
"""The cases of "leader-follower" that Remark 9's figure shows."""

Edges = Iterable[tuple[int, int]]


def catalogue() -> list[Claim]:
    """All claims, in the order of the paper."""
    return [
        *_theorems(), *_corrections(), *_lyapunov(), *_delays(), *_graphs(), *_parameters(),
        *_remark_6(), *_remark_9(), *_networks(),
    ]  # fmt: skip


# --- Theorems 1 to 6 -------------------------------------------------------------------


def _theorems() -> Iterator[Claim]:
    words = {
        1: "kinematic, no damping: formation and headings agree, the centroid need not come home",
        2: "kinematic, some μ > 0: the centroid comes home too",
        3: "dynamic, uncertain mass and inertia, no damping: as Theorem 1",
        4: "dynamic, uncertain mass and inertia, some μ > 0: as Theorem 2",
        5: "kinematic, constant delays: as Theorem 2",
        6: "dynamic, uncertain mass and inertia, constant delays: as Theorem 4",
    }
    for number, says in words.items():
        expected = NOT_HOME if number in (1, 3) else ALL_HOLD
        case = Case(f"theorem{number}", f"paper/theorem{number}.toml", (), expected)
        yield _claim(f"theorem-{number}", says, f"Theorem {number}", [case])
    for key, name, figures in (("figures-4-5", SECTION5, "4, 5"), ("figures-6-7", DELAYED, "6, 7")):
        says = "five robots come into the pattern and their headings agree"
        says += ", delays of 0.1 s" if name == DELAYED else ""
        cases = [Case(key, name, (), ALL_HOLD)]
        yield _claim(key, says, f"Section 5, Figures {figures}", cases)


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
    yield _claim(
        "w1-zero", "w1 = 0 at all times", "Assumption 2 broken",
        [Case("w1-zero", SECTION5, ("law.w1.bias=0.0",))],
    )  # fmt: skip


def _lyapunov() -> Iterator[Claim]:
    equations = {1: 22, 2: 22, 3: 34, 4: 34, 5: 40, 6: 43}
    yield Claim(
        "lyapunov",
        "V never rises, with exact parameters and the compensated cross term "
        "(docs/corrections.md), beyond ρ ε exp(−γt) and the sampling error",
        "Eqs. 22, 34, 40, 43",
        "no rise",
        tuple(
            Case(f"eq-{equation}-theorem-{number}", f"paper/theorem{number}.toml",
                 (*EXACT, "duration_s=20"), NEVER_RISES)
            for number, equation in equations.items()
        ),
    )  # fmt: skip


# --- delays, graphs, parameters ----------------------------------------------------------


def _delays() -> Iterator[Claim]:
    durations_s = {0.0: 40, 0.05: 40, 0.1: 40, 0.2: 40, 0.5: 60, 1.0: 100, 2.0: 200}
    yield _claim(
        "delay-independence", "any constant delay: δ = 0, 0.05, 0.1, 0.2, 0.5, 1, 2 s",
        "Theorem 6",
        [
            Case(f"{delay_s:g}s", DELAYED,
                 (f"network.default.delay.mean_s={delay_s}", f"duration_s={duration_s}"), ALL_HOLD)
            for delay_s, duration_s in durations_s.items()
        ],
    )  # fmt: skip
    delays_s = {1: 0.05, 2: 0.4, 3: 0.1, 4: 0.3, 5: 0.2}
    links = ",".join(
        f'{{from={robot}, to="*", delay={{distribution="constant", mean_s={delay_s}}}}}'
        for robot, delay_s in delays_s.items()
    )
    yield _claim(
        "delays-differ", "a delay for each robot: δ = 0.05, 0.4, 0.1, 0.3, 0.2 s", "Theorem 6",
        [Case("delays-differ", DELAYED, (f"network.links=[{links}]", "duration_s=60"), ALL_HOLD)],
    )  # fmt: skip


def _graphs() -> Iterator[Claim]:
    graphs = [
        sorted((a + 1, b + 1) for a, b in graph.edges)
        for graph in nx.graph_atlas_g()
        if len(graph) == 5 and nx.is_connected(graph)
    ]
    yield _claim(
        "five-robots", f"all {len(graphs)} connected graphs of five robots, up to renumbering",
        "Assumption 1",
        [
            Case(f"{number:02}-edges-{len(edges)}", DELAYED, (_edges(edges), "duration_s=60"),
                 ALL_HOLD)
            for number, edges in enumerate(graphs, start=1)
        ],
    )  # fmt: skip
    for robots, probability in ((10, 0.3), (20, 0.2)):
        yield _claim(
            f"{robots}-robots", f"random connected graphs of {robots} robots, one in five damped",
            "Assumption 1",
            [_random_group(robots, probability, seed) for seed in (1, 2, 3)],
        )  # fmt: skip


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
        f"robots=[{', '.join(tables)}]", _edges(edges), "formation.coupling=1.0", "duration_s=80"
    )  # fmt: skip
    return Case(f"seed-{seed}", DELAYED, overrides, ALL_HOLD)


def _parameters() -> Iterator[Claim]:
    signals = {
        "constant-and-sine": "{bias=0.5, amplitude=0.3, frequency_radps=1.0}",
        "sine": "{bias=0.0, amplitude=0.7, frequency_radps=0.5}",
    }
    yield _claim(
        "w1-varies", "w1 varies with time: 0.5 + 0.3 sin t, and 0.7 sin 0.5 t",
        "Assumption 2, Remark 3",
        [Case(name, DELAYED, (f"law.w1={w1}", "duration_s=60"), ALL_HOLD)
         for name, w1 in signals.items()],
    )  # fmt: skip
    yield _claim(
        "w1-varies-long", "w1 = 0.5 + 0.3 sin t for 200 s, mass and inertia uncertain, sampled at "
        "1 ms: ε exp(−γt) of Eq. 31 falls below what the sampling can follow",
        "Eq. 31 on a sampled loop",
        [Case("w1-varies-long", DELAYED,
              (f"law.w1={signals['constant-and-sine']}", "duration_s=200"))],
    )  # fmt: skip
    factors = ((0.5, 0.5), (0.5, 4.0), (1.0, 1.0), (2.0, 0.5), (4.0, 0.5), (4.0, 4.0))
    yield _claim(
        "wrong-estimates", "mass and inertia believed to be 0.5 to 4 times what they are",
        "Theorem 6",
        [
            Case(f"mass-{mass:g}-inertia-{inertia:g}", DELAYED,
                 (f"robot_defaults.mass_estimate_kg={mass}",
                  f"robot_defaults.inertia_estimate_kgm2={inertia}"), ALL_HOLD)
            for mass, inertia in factors
        ],
    )  # fmt: skip


# --- Remarks 6 and 9 ---------------------------------------------------------------------


def _remark_6() -> Iterator[Claim]:
    yield _claim(
        "no-links", "no communication, all μ > 0", "Remark 6",
        [Case("no-links", DELAYED, (_edges(()), *_damping(1, 2, 3, 4, 5)), ALL_HOLD)],
    )  # fmt: skip
    two_parts = _edges(((1, 2), (3, 4), (4, 5)))
    yield _claim(
        "two-parts", "a graph of two parts, some μ > 0 in each", "Remark 6",
        [Case("two-parts", DELAYED, (two_parts, *_damping(1, 3)), ALL_HOLD)],
    )  # fmt: skip
    yield _claim(
        "too-little-damping", "no communication, or two parts, and one robot with μ > 0",
        "Remark 6, converse",
        [
            Case("no-links", DELAYED, (_edges(()),), APART),
            Case("two-parts", DELAYED, (two_parts,), APART),
        ],
    )  # fmt: skip


def _remark_9() -> Iterator[Claim]:
    yield Claim(
        "killed-ring",
        "each robot killed in turn, at 2 s and at 10 s, on the ring (the damped one without "
        "delays)",
        "Remark 9",
        "Eqs. 3, 4 hold for the rest, which is connected; Eq. 5 if damping remains",
        tuple(_killed(RING, robot, at_s) for at_s in (2, 10) for robot in range(1, 6)),
    )
    cases = [_killed(edges, robot, 2) for edges in (PATH, STAR) for robot in range(1, 6)]
    yield Claim(
        "killed-path-star",
        "each robot killed in turn at 2 s, on a path and on a star, unless it holds the graph "
        "together (the damped one without delays)",
        "Remark 9",
        "Eqs. 3, 4 hold for the rest, which is connected; Eq. 5 if damping remains",
        tuple(case for case in cases if case.expected != APART),
    )
    yield Claim(
        "killed-cut-vertex",
        "a robot that holds the graph together killed at 2 s, on the path and the star",
        "Remark 9, converse",
        "Eqs. 3, 4, 5 do not",
        tuple(case for case in cases if case.expected == APART),
    )
    yield _claim(
        "killed-held", "each robot killed at 2 s, neighbours hold its last state for ever",
        "Remark 9 says nothing of it",
        [
            Case(f"robot-{robot}", DELAYED, (_kill(robot, 2), "neighbours.on_silence=hold"))
            for robot in range(1, 6)
        ],
    )  # fmt: skip
    yield _claim(
        "killed-restarted", "each robot killed at 2 s and restarted at 7 s",
        "Theorem 6 from the restart on",
        [Case(f"robot-{robot}", DELAYED, (_kill(robot, 2, restart_after_s=5),), ALL_HOLD)
         for robot in range(1, 6)],
    )  # fmt: skip
    yield Claim(
        "leader-follower",
        "the leader killed at 2 s, a middle robot at 2 s and at 30 s",
        "Remark 9",
        "the cooperative law keeps Eqs. 3, 4; leader-follower control loses the formation",
        tuple(_compared()),
    )


def _compared() -> Iterator[Case]:
    """The same ring and kills under both laws, without delays; robot 5 leads 1 and 4."""
    lost = {"formation": False}
    for robot, at_s in ((5, 2), (4, 2), (4, 30)):
        name, overrides = f"robot-{robot}-at-{at_s}s", (_kill(robot, at_s), "duration_s=60")
        yield Case(f"cooperative-{name}", SECTION5, overrides, ALL_HOLD)
        yield Case(f"leader-follower-{name}", FOLLOWING, overrides, lost)
    yield Case("leader-follower-nobody", FOLLOWING, (), NOT_HOME)


def _killed(edges: Edges, robot: int, at_s: float) -> Case:
    """One robot of Section 5 killed; Remark 9 says how it ends from the graph that remains.

    Without damping only Theorem 3 says something, and it knows no delays.
    """
    rest = [other for other in range(1, 6) if other != robot]
    kept = [(a, b) for a, b in edges if robot not in (a, b)]
    expected = NOT_HOME if robot in DAMPED else ALL_HOLD
    if len(components(rest, kept)) > 1:
        expected = APART
    name = {RING: "ring", PATH: "path", STAR: "star"}[tuple(edges)]
    scenario = SECTION5 if robot in DAMPED else DELAYED
    return Case(f"{name}-robot-{robot}-at-{at_s:g}s", scenario,
                (_edges(edges), _kill(robot, at_s)), expected)  # fmt: skip


# --- networks beyond the theorems, and back within them ------------------------------------


def _networks() -> Iterator[Claim]:
    uniform = 'network.default.delay={distribution="uniform", low_s=0.0, high_s=0.3}'
    yield _claim(
        "random-delay-fixed", "random delay of 0 to 0.3 s, played out at 0.3 s", "Theorem 6",
        [Case("fixed", DELAYED,
              (uniform, "neighbours.playout=fixed", "neighbours.playout_s=0.3"), ALL_HOLD)],
    )  # fmt: skip
    yield _claim(
        "random-delay", "random delay of 0 to 0.3 s, the latest used as it comes",
        "beyond the theorems",
        [Case("latest", DELAYED, (uniform,))],
    )  # fmt: skip
    for percent in (10, 50, 90):
        yield _claim(
            f"loss-{percent}", f"{percent} % of all messages lost", "beyond the theorems",
            [Case(f"loss-{percent}", DELAYED, (f"network.default.loss.probability={percent / 100}",
                                               "duration_s=60"))],
        )  # fmt: skip
    bursts = 'network.default.loss={model="gilbert_elliott", p=0.02, r=0.02}'
    yield _claim(
        "loss-bursts", "half of all messages lost, in bursts of 0.5 s on average",
        "beyond the theorems",
        [Case("loss-bursts", DELAYED, (bursts, "duration_s=60"))],
    )  # fmt: skip
    cut = '{action="cut", at_s=2.0, links=[%s], both_ways=true, heal_after_s=5.0}'
    yield _claim(
        "cut", "links cut for 5 s and healed: one, two, all", "Theorem 6 from the healing on",
        [
            Case(name, DELAYED, (f"timeline=[{cut % links}]",), ALL_HOLD)
            for name, links in (
                ("one", "[1, 2]"), ("two", "[1, 2], [3, 4]"), ("all", '["*", "*"]')
            )
        ],
    )  # fmt: skip
    halves = 'timeline=[{action="partition", at_s=2.0, shape="halves", heal_after_s=5.0}]'
    isolate = halves.replace('"halves"', '"isolate", robot=1')
    yield _claim(
        "partition", "a partition for 5 s and healed: halves, and the damped robot alone",
        "Theorem 6 from the healing on",
        [
            Case("halves", DELAYED, (halves,), ALL_HOLD),
            Case("isolate", DELAYED, (isolate,), ALL_HOLD),
        ],
    )  # fmt: skip


# --- in words ------------------------------------------------------------------------------


def _claim(key: str, says: str, where: str, cases: Sequence[Case]) -> Claim:
    """A claim whose runs all end alike, so that ``should`` follows from the first."""
    asked = cases[0].asked
    hold = [EQUATIONS[claim] for claim, value in asked.items() if value]
    fail = [EQUATIONS[claim] for claim, value in asked.items() if not value]
    words = [f"{_and(hold)} hold" + ("s" if len(hold) == 1 else "")] if hold else []
    if fail:
        words.append(f"{_and(fail)} " + ("does not" if len(fail) == 1 else "do not"))
    should = ", ".join(words) or "not claimed"
    return Claim(key, says, where, should, tuple(cases))


def _and(equations: Sequence[str]) -> str:
    numbers = [equation.removeprefix("Eq. ") for equation in equations]
    return ("Eq. " if len(numbers) == 1 else "Eqs. ") + ", ".join(numbers)


def _edges(edges: Edges) -> str:
    return f"formation.edges={[list(edge) for edge in edges]}"


def _kill(robot: int, at_s: float, restart_after_s: float | None = None) -> str:
    after = "" if restart_after_s is None else f", restart_after_s={restart_after_s}"
    return f'timeline=[{{action="kill", at_s={at_s}, robots={robot}{after}}}]'


def _damping(*robots: int) -> Iterator[str]:
    yield from (f"robots.{robot}.damping=4.0" for robot in robots)
