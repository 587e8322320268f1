"""Claims about failures (Remarks 6 and 9), and about networks beyond the theorems."""

from collections.abc import Iterator

from formnet.formation.paper.graph import components
from formnet.lab.claims.building import (
    DELAYED,
    FOLLOWING,
    PATH,
    RING,
    SECTION5,
    STAR,
    Edges,
    claim_of,
    with_damping,
    with_edges,
    with_kill,
)
from formnet.lab.claims.claim import ALL_HOLD, APART, NOT_HOME, Case, Claim

DAMPED = {1}
"""The robots of Section 5 with μ > 0."""
COMPARED = ("cooperative-robot-4-at-30s", "leader-follower-robot-4-at-30s")
"""The cases of "leader-follower" that Remark 9's figure shows."""


def remark_6() -> Iterator[Claim]:
    yield claim_of(
        "no-links",
        "no communication, all μ > 0",
        "Remark 6",
        [Case("no-links", DELAYED, (with_edges(()), *with_damping(1, 2, 3, 4, 5)), ALL_HOLD)],
    )
    two_parts = with_edges(((1, 2), (3, 4), (4, 5)))
    yield claim_of(
        "two-parts",
        "a graph with two components, some μ > 0 in each",
        "Remark 6",
        [Case("two-parts", DELAYED, (two_parts, *with_damping(1, 3)), ALL_HOLD)],
    )
    yield claim_of(
        "too-little-damping",
        "no communication, or two components, and one robot with μ > 0",
        "Remark 6, converse",
        [
            Case("no-links", DELAYED, (with_edges(()),), APART),
            Case("two-parts", DELAYED, (two_parts,), APART),
        ],
    )


def remark_9() -> Iterator[Claim]:
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
        "each robot killed in turn at 2 s, on a path and on a star, unless it is a cut vertex "
        "(the damped one without delays)",
        "Remark 9",
        "Eqs. 3, 4 hold for the rest, which is connected; Eq. 5 if damping remains",
        tuple(case for case in cases if case.expected != APART),
    )
    yield Claim(
        "killed-cut-vertex",
        "a cut vertex killed at 2 s, on the path and the star",
        "Remark 9, converse",
        "Eqs. 3, 4, 5 do not",
        tuple(case for case in cases if case.expected == APART),
    )
    yield claim_of(
        "killed-held",
        "each robot killed at 2 s, neighbours hold its last state for ever",
        "not covered by Remark 9",
        [
            Case(f"robot-{robot}", DELAYED, (with_kill(robot, 2), "neighbours.on_silence=hold"))
            for robot in range(1, 6)
        ],
    )
    yield claim_of(
        "killed-restarted",
        "each robot killed at 2 s and restarted at 7 s",
        "Theorem 6 from the restart on",
        [
            Case(f"robot-{robot}", DELAYED, (with_kill(robot, 2, restart_after_s=5),), ALL_HOLD)
            for robot in range(1, 6)
        ],
    )
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
        name, overrides = f"robot-{robot}-at-{at_s}s", (with_kill(robot, at_s), "duration_s=60")
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
    return Case(
        f"{name}-robot-{robot}-at-{at_s:g}s",
        scenario,
        (with_edges(edges), with_kill(robot, at_s)),
        expected,
    )


# --- networks beyond the theorems, and back within them ------------------------------------


def networks() -> Iterator[Claim]:
    uniform = 'network.default.delay={distribution="uniform", low_s=0.0, high_s=0.3}'
    yield claim_of(
        "random-delay-fixed",
        "random delay of 0 to 0.3 s, played out at 0.3 s",
        "Theorem 6",
        [
            Case(
                "fixed",
                DELAYED,
                (uniform, "network.default.playout_s=0.3"),
                ALL_HOLD,
            )
        ],
    )
    yield claim_of(
        "random-delay",
        "random delay of 0 to 0.3 s, the latest used on arrival",
        "beyond the theorems",
        [Case("latest", DELAYED, (uniform,))],
    )
    for percent in (10, 50, 90):
        yield claim_of(
            f"loss-{percent}",
            f"{percent} % of all messages lost",
            "beyond the theorems",
            [
                Case(
                    f"loss-{percent}",
                    DELAYED,
                    (f"network.default.loss.probability={percent / 100}", "duration_s=60"),
                )
            ],
        )
    bursts = 'network.default.loss={model="gilbert_elliott", p=0.02, r=0.02}'
    yield claim_of(
        "loss-bursts",
        "half of all messages lost, in bursts of 0.5 s on average",
        "beyond the theorems",
        [Case("loss-bursts", DELAYED, (bursts, "duration_s=60"))],
    )
    cut = '{action="cut", at_s=2.0, links=[%s], both_ways=true, heal_after_s=5.0}'
    yield claim_of(
        "cut",
        "links cut for 5 s and healed: one, two, all",
        "Theorem 6 from the healing on",
        [
            Case(name, DELAYED, (f"timeline=[{cut % links}]",), ALL_HOLD)
            for name, links in (("one", "[1, 2]"), ("two", "[1, 2], [3, 4]"), ("all", '["*", "*"]'))
        ],
    )
    halves = 'timeline=[{action="partition", at_s=2.0, shape="halves", heal_after_s=5.0}]'
    isolate = halves.replace('"halves"', '"isolate", robot=1')
    yield claim_of(
        "partition",
        "a partition for 5 s and healed: halves, and the damped robot alone",
        "Theorem 6 from the healing on",
        [
            Case("halves", DELAYED, (halves,), ALL_HOLD),
            Case("isolate", DELAYED, (isolate,), ALL_HOLD),
        ],
    )
