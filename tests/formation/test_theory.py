"""Which theorem a scenario falls under, and that every broken assumption is named."""

import math

import pytest

from formnet.formation.paper.theory import assess
from formnet.formation.scenario.expect import ERRORS
from formnet.formation.scenario.loading import load

UNIFORM = 'network.default.delay={distribution="uniform", low_s=0.05, high_s=0.3}'
DELAYED = 'network.default.delay={distribution="constant", mean_s=0.1}'
SPLIT = "formation.edges=[[1, 2], [3, 4], [4, 5]]"
THEOREMS = {f"theorem{n}": n for n in range(1, 7)} | {"section5": 4, "section5-delay": 6}


def without_expect(scenario):
    return scenario.model_copy(update={"expect": None})


def warning_with(assessment, start, *words):
    """There is exactly one warning that begins with ``start``, and it has all of ``words``."""
    found = [text for text in assessment.warnings if text.startswith(start)]
    assert len(found) == 1, assessment.warnings
    for word in words:
        assert word in found[0]


def no_theorem(assessment, *words):
    """No theorem applies, and ``why`` says so in these words."""
    assert assessment.theorem is None
    assert assessment.claims == {}
    assert assessment.proof == "not covered"
    assert assessment.why.startswith("not covered by a theorem: ")
    for word in words:
        assert word in assessment.why


# --- the paper's own scenarios --------------------------------------------------------


@pytest.mark.parametrize(("name", "theorem"), THEOREMS.items())
def test_scenario_of_the_paper_is_its_theorem_and_proved_but_for_theorem_3(paper, name, theorem):
    scenario = paper(name)
    assessment = assess(scenario)
    assert assessment.theorem == theorem
    assert assessment.proof == ("proved with compensation" if theorem == 3 else "proved")
    assert assessment.warnings[1:] == []
    if theorem == 3:
        warning_with(assessment, "[expect]", "not proved with w1 z2 z3 as printed", "Theorem 3")
    else:
        assert assessment.warnings == []
    assert assessment.why.startswith(f"Theorem {theorem}, {assessment.proof}: ")
    assert scenario.expect.centroid is (theorem not in (1, 3))
    assert assessment.claims == {
        "formation": True,
        "heading": True,
        "centroid": theorem not in (1, 3),
    }


def test_every_scenario_of_the_paper_is_tested_here(root):
    files = sorted((root / "configs" / "paper").glob("*.toml"))
    assert {file.stem for file in files} == set(THEOREMS)
    assert [load(file).name for file in files] == [file.stem for file in files]


def test_numbers_of_the_graph_are_the_ring_s(paper):
    """λ₂ of a ring of five with weights 2 is 2·2 (1 - cos 72°)."""
    assessment = assess(paper("theorem1"))
    expected = 4.0 * (1.0 - math.cos(2.0 * math.pi / 5.0))
    assert assessment.algebraic_connectivity == pytest.approx(expected)
    assert assessment.smallest_eigenvalue == pytest.approx(0.0, abs=1e-12)


# --- classification -------------------------------------------------------------------


@pytest.mark.parametrize("level", ["kinematic", "dynamic"])
@pytest.mark.parametrize("damped", [False, True])
@pytest.mark.parametrize("delayed", [False, True])
def test_level_damping_and_delay_decide_the_theorem(paper, level, damped, delayed):
    overrides = [f"law.level={level}", f"robots.1.damping={4.0 if damped else 0.0}"]
    assessment = assess(
        without_expect(paper("theorem4", *overrides, *([DELAYED] if delayed else [])))
    )
    dynamic = level == "dynamic"
    if delayed and not damped:
        no_theorem(assessment, "μ > 0")
    elif delayed:
        assert assessment.theorem == (6 if dynamic else 5)
    else:
        assert (
            assessment.theorem
            == {(False, False): 1, (False, True): 2, (True, False): 3, (True, True): 4}[
                dynamic, damped
            ]
        )
    assert assessment.warnings == []


def test_damping_of_any_robot_will_do(paper):
    assert assess(paper("theorem2", "robots.1.damping=0.0", "robots.4.damping=4.0")).theorem == 2
    others = assess(paper("theorem2", "robots.1.damping=0.0", "robot_defaults.damping=1.0"))
    assert others.theorem == 2
    assert 0.5 < others.smallest_eigenvalue < 0.8  # the quotient of (1, ..., 1) is 4/5


def test_zero_delay_written_out_on_one_link_is_no_delay(paper):
    rule = 'network.links=[{from=[1], to=[2], delay={distribution="constant", mean_s=0.0}}]'
    assert assess(paper("theorem4", rule)).theorem == 4


def test_delay_of_one_sender_alone_is_a_delay(paper):
    rule = 'network.links=[{from=[1], to=[2, 5], delay={distribution="constant", mean_s=0.1}}]'
    assert assess(paper("theorem4", rule)).theorem == 6
    assert assess(paper("theorem2", rule)).theorem == 5


def test_rule_on_a_link_that_carries_nothing_changes_nothing(paper):
    """Robots 1 and 3 are not neighbours on the ring."""
    rule = "network.links=[{from=[1], to=[3], loss={probability=0.5}}]"
    assert assess(paper("theorem4", rule)).theorem == 4


# --- broken assumptions ---------------------------------------------------------------


def test_disconnected_graph_is_named_with_its_parts(paper):
    assessment = assess(paper("theorem4", SPLIT))
    warning_with(assessment, "Assumption 1", "{1, 2}", "{3, 4, 5}")
    no_theorem(assessment, "Assumption 1")
    assert assessment.algebraic_connectivity == pytest.approx(0.0, abs=1e-12)


def test_robot_without_an_edge_is_a_part_of_its_own(paper):
    assessment = assess(paper("theorem4", "formation.edges=[[1, 2], [2, 3], [3, 5]]"))
    warning_with(assessment, "Assumption 1", "{1, 2, 3, 5}", "{4}")


@pytest.mark.parametrize(
    "w1",
    [
        "{bias=0.0}",
        "{bias=0.0, amplitude=0.0, frequency_radps=2.0}",
        "{bias=0.0, amplitude=3.0, frequency_radps=0.0}",
        "{bias=-0.0, amplitude=0.0, frequency_radps=0.0}",
    ],
)
def test_w1_that_is_always_zero_is_named(paper, w1):
    assessment = assess(paper("theorem4", f"law.w1={w1}"))
    warning_with(assessment, "Assumption 2", "w1")
    no_theorem(assessment, "Assumption 2")


@pytest.mark.parametrize(
    "w1", ["{bias=-0.5}", "{bias=0.0, amplitude=0.3, frequency_radps=2.0}", "{bias=1e-6}"]
)
def test_w1_that_is_not_always_zero_is_persistent(paper, w1):
    assessment = assess(paper("theorem4", f"law.w1={w1}"))
    assert assessment.theorem == 4
    assert assessment.warnings == []


def test_both_assumptions_broken_are_both_named(paper):
    assessment = assess(without_expect(paper("theorem4", SPLIT, "law.w1={bias=0.0}")))
    assert len(assessment.warnings) == 2
    warning_with(assessment, "Assumption 1")
    warning_with(assessment, "Assumption 2")


# --- what no theorem covers -----------------------------------------------------------

IMPERFECT = [
    ("theorem6", [UNIFORM], ["not constant", "from 2 to 1"]),
    ("theorem4", ["network.default.loss={probability=0.01}"], ["loses messages"]),
    (
        "theorem4",
        ["network.links=[{from=[3], to=[4], loss={probability=0.01}}]"],
        ["from 3 to 4 loses messages"],
    ),
    (
        "theorem4",
        [
            'timeline=[{at_s=1.0,action="kill",robots=2},{at_s=2.0,action="cut",links="*",heal_after_s=1.0}]'
        ],
        ["robot 2 fails at 1 s; the network changes at 2 s (cut", "the first of 2 changes"],
    ),
    (
        "theorem4",
        [
            'timeline=[{at_s=1.0,action="kill",robots=2,restart_after_s=1.0},'
            '{at_s=3.0,action="pause",robots=4},{at_s=3e3,action="kill",robots=5}]'
        ],
        ["robots 2, 4 fail, the first at 1 s"],
    ),
    (
        "theorem4",
        ['timeline=[{at_s=1.0,action="cut",links="*",heal_after_s=1.0}]'],
        ["network changes at 1 s"],
    ),
]
CUT = '{at_s=1.0,action="cut",links=[[4,5]]}'
KILL = '{at_s=2.0,action="kill",robots=2}'


@pytest.mark.parametrize(
    ("timeline", "groups"),
    [
        (f"{CUT},{KILL}", "from 2 s on, the graph of the robots that are up"),
        (
            f'{CUT},{KILL},{{at_s=3.0,action="cut",links=[[5,1]]}}',
            "at the end the components are {1}, {3, 4}, {5}",
        ),
        (f'{CUT},{KILL},{{at_s=3.0,action="heal"}}', None),
        (f'{CUT},{KILL},{{at_s=9.0,action="restart",robots=2}}', None),
        (f'{CUT},{KILL},{{at_s=3e3,action="restart",robots=2}}', "{1, 5}, {3, 4}"),
        ('{at_s=1.0,action="partition",shape="halves"}', "from 1 s on"),
        (f"{CUT}", None),
        (f"{KILL}", None),
        ('{at_s=1.0,action="kill",robots=[1,2,3,4,5]}', None),
    ],
)
def test_a_plan_that_leaves_robots_out_of_touch_is_warned_of(paper, timeline, groups):
    """On the ring of Section 5: nothing is said where they are together at the end."""
    scenario = paper("section5", f"timeline=[{timeline}]")
    assert assess(without_expect(scenario)).warnings == []
    warnings = assess(scenario).warnings
    found = [warning for warning in warnings if "may be unattainable" in warning]
    if groups is None:
        assert found == []
    else:
        assert groups in found[0]


GAPS = [
    ("theorem4", ["law.delta=printed"], ["Eq. 19"]),
    ("theorem4", ["law.kind=leader_follower"], ["leader_follower"]),
    ("theorem6", ["robots.1.damping=0.0"], ["μ > 0"]),
    ("theorem4", ["robot_defaults.wheel_torque_limit_nm=5.0"], ["wheel_torque_limit_nm"]),
    ("theorem4", ["robots.2.linear_friction_nspm=0.1"], ["linear_friction_nspm"]),
    ("theorem4", ["robots.2.angular_friction_nmsprad=0.1"], ["angular_friction_nmsprad"]),
    ("theorem4", ["robots.2.disturbance_force_n=-0.1"], ["disturbance_force_n"]),
    ("theorem4", ["robots.2.disturbance_torque_nm=0.1"], ["disturbance_torque_nm"]),
    ("theorem4", ["law.robust=false"], ["robot 1", "law.robust"]),
]


@pytest.mark.parametrize(("name", "overrides", "words"), GAPS)
def test_expecting_what_no_theorem_covers_is_warned_of(paper, name, overrides, words):
    scenario = paper(name, *overrides)
    assert scenario.expect.formation
    assessment = assess(scenario)
    no_theorem(assessment, *words)
    warning_with(assessment, "[expect]", "no theorem covers", *words)
    silent = assess(without_expect(scenario))
    assert silent.theorem is None
    assert silent.warnings == []


@pytest.mark.parametrize("wrong", ["law.delta=printed", "law.w1.bias=0.0", "robots.1.damping=0.0"])
def test_of_a_law_that_is_not_the_paper_s_no_theorem_is_expected(paper, wrong):
    """Each alone is warned of with the paper's law."""
    assert assess(paper("theorem4", wrong)).warnings
    other = assess(paper("theorem4", wrong, "law.kind=bang-bang"))
    no_theorem(other, "bang-bang")
    assert other.warnings == []


def test_that_robots_do_not_hear_of_each_other_concerns_every_law(paper):
    edges, kind = "formation.edges=[[1, 2], [3, 4], [4, 5]]", "law.kind=bang-bang"
    assert assess(paper("theorem4", edges, kind)).warnings == [
        "formation.edges: the graph has components {1, 2}, {3, 4, 5}"
    ]
    halves = 'timeline=[{at_s=1.0,action="partition",shape="halves"}]'
    assert assess(without_expect(paper("section5", halves, kind))).warnings == []
    (warning,) = assess(paper("section5", halves, kind)).warnings
    assert warning.startswith("[expect] may be unattainable: from 1 s on")


@pytest.mark.parametrize(("name", "overrides", "words"), IMPERFECT)
def test_an_imperfect_network_is_what_runs_are_for(paper, name, overrides, words):
    assessment = assess(paper(name, *overrides))
    no_theorem(assessment, *words)
    assert assessment.warnings == []


def test_an_imperfect_network_hides_nothing_else(paper):
    assessment = assess(paper("theorem3", "expect.centroid=true", UNIFORM))
    warning_with(assessment, "expect.centroid", "positive damping")
    assert len(assessment.warnings) == 1
    assessment = assess(paper("theorem6", UNIFORM, "law.delta=printed"))
    no_theorem(assessment, "not constant", "Eq. 19")
    warning_with(assessment, "[expect]", "no theorem covers", "Eq. 19")


@pytest.mark.parametrize(("name", "overrides", "words"), [*GAPS, *IMPERFECT])
def test_expecting_nothing_true_claims_nothing(paper, name, overrides, words):
    denied = [f"expect.{claim}=false" for claim in ERRORS]
    assert assess(paper(name, *overrides, *denied)).warnings == []


def test_gap_of_the_dynamic_model_does_not_concern_the_kinematic_level(paper):
    assessment = assess(paper("theorem2", "robots.2.linear_friction_nspm=0.1", "law.robust=false"))
    assert assessment.theorem == 2
    assert assessment.warnings == []


def test_right_estimates_need_no_robust_term(paper):
    right = ["robot_defaults.mass_estimate_kg=1.0", "robot_defaults.inertia_estimate_kgm2=1.0"]
    assert assess(paper("theorem4", "law.robust=false", *right)).theorem == 4


# --- [expect] against the theorem -----------------------------------------------------


@pytest.mark.parametrize("name", ["theorem1", "theorem3"])
def test_centroid_expected_without_damping_is_warned_of_once(paper, name):
    assessment = assess(paper(name, "expect.centroid=true"))
    warning_with(assessment, "expect.centroid", "positive damping")
    assert len(assessment.warnings) == (2 if name == "theorem3" else 1)  # 3 is not proved


def test_centroid_expected_without_damping_is_warned_of_beside_a_gap(paper):
    assessment = assess(paper("theorem1", "expect.centroid=true", "law.delta=printed"))
    warning_with(assessment, "expect.centroid", "positive damping")
    warning_with(assessment, "[expect]", "no theorem covers")


@pytest.mark.parametrize("name", ["theorem2", "theorem4", "theorem5", "theorem6"])
@pytest.mark.parametrize("claim", ERRORS)
def test_denying_what_the_theorem_claims_is_warned_of(paper, name, claim):
    assessment = assess(paper(name, f"expect.{claim}=false"))
    warning_with(assessment, f"expect.{claim} = false", f"Theorem {name[-1]}")
    assert len(assessment.warnings) == 1


@pytest.mark.parametrize("name", THEOREMS)
def test_without_expect_there_is_nothing_to_warn_of(paper, name):
    assert assess(without_expect(paper(name))).warnings == []


def test_empty_expect_claims_nothing(paper):
    assert assess(paper("theorem4", "expect={}", UNIFORM)).warnings == []


def test_broken_assumption_is_named_without_expect(paper):
    assessment = assess(without_expect(paper("theorem4", SPLIT)))
    assert len(assessment.warnings) == 1
    warning_with(assessment, "Assumption 1")
