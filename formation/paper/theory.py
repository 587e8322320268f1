"""What is proved about a scenario: graph numbers, the theorem it falls under, warnings.

A broken assumption is a warning, not an error: an experiment may break it on
purpose.
"""

from typing import NamedTuple

from formnet.formation.paper.graph import (
    algebraic_connectivity,
    components,
    laplacian,
    smallest_eigenvalue,
)
from formnet.formation.paper.proof import Margin, proof_of
from formnet.formation.paper.status import NOT_COVERED, WITH_COMPENSATION, Status
from formnet.formation.scenario.expect import ERRORS
from formnet.formation.scenario.model import Scenario
from formnet.netem.settings.actions import Cut, Heal
from formnet.netem.settings.links import LinkSettings

LAWS = ("cooperative", "leader_follower")
"""The laws that the paper speaks of: that of its theorems, and the one Remark 9 holds beside it."""


class Assessment(NamedTuple):
    """The theory's view of one scenario.

    ``theorem`` is 1-6 or None, ``proof`` what is proved of it with the scenario's cross term
    (:mod:`formation.paper.proof`); ``why`` says how both follow. ``claims`` maps
    the name of each of Eqs. 3-5 to whether the theorem claims it (empty without a theorem).
    ``smallest_eigenvalue`` is λ_min(L + diag μ), ``margin`` that of V in the theorem, if any.
    """

    algebraic_connectivity: float
    smallest_eigenvalue: float
    margin: Margin | None
    theorem: int | None
    proof: Status
    why: str
    claims: dict[str, bool]
    warnings: list[str]


def of_the_paper(scenario: Scenario) -> bool:
    """Whether the paper speaks of the scenario's law (see LAWS)."""
    return scenario.law.kind in LAWS


def assess(scenario: Scenario) -> Assessment:
    """Classify a valid scenario and name every assumption it breaks.

    Of a law that the paper does not speak of, no theorem is expected: the only warnings are that
    robots do not hear of each other.
    """
    matrix = laplacian(scenario.ids, scenario.formation.weights)
    damping = [scenario.vehicles[robot].damping for robot in scenario.ids]
    connectivity = algebraic_connectivity(matrix)
    smallest = smallest_eigenvalue(matrix, damping)
    broken = _broken_assumptions(scenario)
    gaps, apart = _uncovered(scenario), _split(scenario)
    disturbances = [*_planned(scenario), *apart, *_imperfect_link(scenario)]
    theorem: int | None = None
    status: Status = NOT_COVERED
    margin: Margin | None = None
    because = "; ".join([*broken, *gaps, *disturbances])
    if because:
        why = f"{NOT_COVERED} by a theorem: {because}"
    else:
        theorem, reasons = _theorem(scenario, any(mu > 0 for mu in damping))
        status, because, margin = proof_of(scenario, theorem)
        why = f"Theorem {theorem}, {status}: {', '.join(reasons)}; {because}"
    claims = (
        {} if theorem is None else dict.fromkeys(ERRORS, True) | {"centroid": theorem not in (1, 3)}
    )
    if not of_the_paper(scenario):
        warnings = _out_of_touch(scenario, apart)
    else:
        # To see what holds on an imperfect network, with failures, is what a run is for.
        beyond = bool(broken or gaps)
        warnings = [
            *broken,
            *_expectation_warnings(scenario, theorem, claims, gaps, apart, beyond=beyond),
        ]
        if status == WITH_COMPENSATION and _claims_something(scenario):
            warnings.append(
                f"[expect] makes claims that are not proved with w1 z2 z3 as printed: {because}; "
                f'law.cross_term = "compensated" makes Theorem {theorem} proved'
            )
    return Assessment(connectivity, smallest, margin, theorem, status, why, claims, warnings)


def _claims_something(scenario: Scenario) -> bool:
    """Whether ``[expect]`` says that one of Eqs. 3-5 holds."""
    expect = scenario.expect
    return expect is not None and any(expect.claims[name] for name in ERRORS)


def _broken_assumptions(scenario: Scenario) -> list[str]:
    broken = []
    if (groups := _parts(scenario)) is not None:
        broken.append(f"Assumption 1 (connected graph): the graph has components {groups}")
    w1 = scenario.law.w1
    if w1.bias == 0.0 and w1.constant:
        broken.append("Assumption 2 (persistent excitation): w1 is zero at all times")
    return broken


def _parts(scenario: Scenario) -> str | None:
    """What the graph falls into; None if it is connected."""
    groups = components(scenario.ids, scenario.formation.edges)
    return _in_braces(groups) if len(groups) > 1 else None


def _out_of_touch(scenario: Scenario, apart: list[str]) -> list[str]:
    """That robots do not hear of each other, from the start or, if anything is claimed, later."""
    groups = _parts(scenario)
    found = [] if groups is None else [f"formation.edges: the graph has components {groups}"]
    return found + _not_coming_about(scenario, apart)


def _not_coming_about(scenario: Scenario, apart: list[str]) -> list[str]:
    if not _claims_something(scenario):
        return []
    return [f"[expect] may be unattainable: {since}" for since in apart]


def _uncovered(scenario: Scenario) -> list[str]:
    """What no theorem speaks of although no assumption forbids it."""
    gaps = []
    law = scenario.law
    if law.kind != "cooperative":
        gaps.append(f"the theorems are about the cooperative law, not {law.kind!r}")
    if law.delta == "printed":
        gaps.append("with the sign of Δ printed in Eq. 19 the proofs fail")
    delays = [delay_ns for _, delay_ns in scenario.of_links(_constant_ns)]
    damped = any(scenario.vehicles[robot].damping > 0.0 for robot in scenario.ids)
    if not damped and any(delays):
        gaps.append("with delays, Theorems 5 and 6 require some μ > 0")
    if law.level == "dynamic":
        gaps.extend(outside_model(scenario))
    return gaps


def _planned(scenario: Scenario) -> list[str]:
    """What happens to robots and to the network that no theorem allows."""
    found = []
    falls = [
        some
        for some in scenario.roster().happenings()
        if some.verb in ("kill", "pause") and some.tick <= scenario.ticks
    ]
    if falls:
        who = sorted({robot for fall in falls for robot in fall.robots})
        several, first = len(who) > 1, ", the first " if len(falls) > 1 else " "
        found.append(
            f"robot{'s' * several} {', '.join(map(str, who))} fail{'s' * (not several)}"
            f"{first}at {falls[0].tick * scenario.clock.control_period_s:g} s"
        )
    changes = [
        entry for entry in scenario.plan if not entry.robots and entry.at_s <= scenario.duration_s
    ]
    if changes:
        more = f", the first of {len(changes)} changes" if len(changes) > 1 else ""
        found.append(f"the network changes at {changes[0].at_s:g} s ({changes[0].what}{more})")
    return found


def _split(scenario: Scenario) -> list[str]:
    """Since when the robots that are up at the end have been out of touch, if a plan does it."""
    period_ns = scenario.clock.control_period_ns
    end_ns = scenario.ticks * period_ns
    roster = scenario.roster()
    if not scenario.timeline or len(components(scenario.ids, scenario.formation.edges)) > 1:
        return []
    instants = {some.tick * period_ns for some in roster.happenings()}
    changes: list[tuple[int, tuple[int, int], bool]] = []  # when, on which link, whether it cuts
    for link in scenario.directed_links:
        for at_ns, action in scenario.effects.on(*link):
            if isinstance(action, Cut | Heal):
                changes.append((at_ns, link, isinstance(action, Cut)))
                instants.add(at_ns)
    changes.sort(key=lambda change: change[0])  # of one link, those at once in the file's order
    cut: set[tuple[int, int]] = set()
    since_ns, groups, done = 0, [[0]], 0
    for now_ns in sorted(instant for instant in instants if instant <= end_ns):
        while done < len(changes) and changes[done][0] <= now_ns:
            _, link, cuts = changes[done]
            (cut.add if cuts else cut.discard)(link)
            done += 1
        up = {robot: None for robot in scenario.ids if roster.up(robot, now_ns // period_ns)}
        before = len(groups)
        groups = components(
            list(up),
            [
                (a, b)
                for a, b in scenario.formation.edges
                if a in up and b in up and cut.isdisjoint(((a, b), (b, a)))
            ],
        )
        if len(groups) > 1 and before < 2:
            since_ns = now_ns
    if len(groups) < 2:
        return []
    return [
        f"from {since_ns / 1e9:g} s on, the graph of the robots that are up is not connected; at "
        f"the end the components are {_in_braces(groups)}"
    ]


def _in_braces(groups: list[list[int]]) -> str:
    return ", ".join("{" + ", ".join(map(str, group)) + "}" for group in groups)


def _imperfect_link(scenario: Scenario) -> list[str]:
    for (source, destination), flaw in scenario.of_links(_flaw):
        if flaw is not None:
            return [flaw.format(f"the link from {source} to {destination}")]
    return []


def _flaw(settings: LinkSettings) -> str | None:
    if settings.constant_ns is None:
        return "the delay on {} is not constant"
    return None if settings.lossless else "{} loses messages"


def _constant_ns(settings: LinkSettings) -> int | None:
    return settings.constant_ns


def outside_model(scenario: Scenario) -> list[str]:
    fields = (
        "wheel_torque_limit_nm",
        "linear_friction_nspm",
        "angular_friction_nmsprad",
        "disturbance_force_n",
        "disturbance_torque_nm",
    )
    names = [
        field
        for field in fields
        if any(getattr(vehicle, field) for vehicle in scenario.vehicles.values())
    ]
    gaps = [f"{name} is not part of Eq. 7's model" for name in names]
    inexact = [
        r for r in scenario.ids if scenario.vehicles[r].estimate() != scenario.vehicles[r].truth()
    ]
    if inexact and not scenario.law.robust:
        gaps.append(f"the estimates of robot {inexact[0]} are wrong and law.robust is off")
    return gaps


def _theorem(scenario: Scenario, damped: bool) -> tuple[int, list[str]]:
    delayed = any(delay_ns != 0 for _, delay_ns in scenario.of_links(_constant_ns))
    kinematic = scenario.law.level == "kinematic"
    theorem = (5 if kinematic else 6) if delayed else (1 if kinematic else 3) + damped
    reasons = [
        f"{scenario.law.level} level",
        "constant delays" if delayed else "no delays",
        "some μ > 0" if damped else "all μ = 0",
        "connected graph",
        "persistent w1",
    ]
    return theorem, reasons


def _expectation_warnings(
    scenario: Scenario,
    theorem: int | None,
    claims: dict[str, bool],
    gaps: list[str],
    apart: list[str],
    *,
    beyond: bool,
) -> list[str]:
    expect = scenario.expect
    if expect is None:
        return []
    warnings = []
    damped = any(scenario.vehicles[robot].damping > 0.0 for robot in scenario.ids)
    if expect.centroid and not damped:
        warnings.append(
            "expect.centroid = true, but no robot has positive damping (Theorem 2 requires Σμ > 0)"
        )
    stated = {name: expect.claims[name] for name in ERRORS}
    warnings += _not_coming_about(scenario, apart)
    if beyond and any(stated.values()):
        warnings.append(
            "[expect] makes claims that no theorem covers"
            + (f": {'; '.join(gaps)}" if gaps else "")
        )
    elif theorem is not None:
        warnings += [
            f"expect.{claim} = true, but Theorem {theorem} does not claim it"
            if value
            else f"expect.{claim} = false contradicts Theorem {theorem}"
            for claim, value in stated.items()
            if value is not None
            and value != claims[claim]
            and not (claim == "centroid" and value and not damped)
        ]
    return warnings
