"""Robots that fail: who is down when, what bodies and messages do, and what neighbours make of it."""

import math
from collections import Counter
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from in_process import collected
from scipy.integrate import solve_ivp

from formnet.formation.briefing.resolving import resolve
from formnet.formation.plan.fault import (
    FaultError,
    KillAction,
    PauseAction,
    RestartAction,
    ResumeAction,
    spans_of,
)
from formnet.formation.plan.roster import Roster, Span
from formnet.formation.scenario.loading import ScenarioError, load, loads
from formnet.formation.wire.messages import Drive
from formnet.formation.wire.state import State
from formnet.lab.runs.recording import trajectory_sha256
from formnet.netem import IN_FLIGHT
from formnet.netem.core.transit import LOST_DOWN
from formnet.netem.settings.timeline import NEVER
from formnet.plant.body import braked
from formnet.plant.world import World

MS = 1_000_000


def kill(at_s, robots, restart_after_s=None):
    after = "" if restart_after_s is None else f", restart_after_s={restart_after_s}"
    return f'{{action="kill", at_s={at_s}, robots={robots}{after}}}'


def pause(at_s, robots, resume_after_s=None):
    after = "" if resume_after_s is None else f", resume_after_s={resume_after_s}"
    return f'{{action="pause", at_s={at_s}, robots={robots}{after}}}'


def timeline(*actions):
    return f"timeline=[{', '.join(actions)}]"


# --- who is down when -----------------------------------------------------------------

spans = st.lists(
    st.tuples(st.integers(0, 60), st.booleans()), unique_by=lambda item: item[0], max_size=8
).map(
    lambda marks: [
        Span(begin, end, killed) for (begin, killed), (end, _) in list(pairwise(sorted(marks)))[::2]
    ]
)


@settings(max_examples=200)
@given(spans, st.integers(1, 7))
def test_a_roster_says_of_every_tick_what_its_spans_say(some, every):
    roster = Roster({7: some})
    up = [not any(s.begin <= tick < s.end for s in some) for tick in range(80)]
    for tick in range(80):
        assert roster.up(7, tick) == up[tick]
        assert roster.killed(7, tick) == any(s.begin <= tick < s.end and s.killed for s in some)
        before = [k for k in range(0, tick + 1, every) if up[k]]
        assert roster.last_up(7, tick, every) == max(before, default=-1)
        after = [k for k in range(tick, 80) if up[k]]
        assert roster.next_up(7, tick) == after[0]
        assert roster.lives(7, tick) == sum(s.killed and s.end <= tick for s in some)
    assert all(Roster({}).up(robot, 3) for robot in range(4))


@settings(max_examples=200)
@given(spans, st.integers(0, 70))
def test_a_lost_robot_is_gone_until_its_next_planned_restart(some, lost):
    roster = Roster({7: some})
    back = min((s.end for s in some if s.killed and s.end > lost), default=NEVER)
    before = [roster.up(7, tick) for tick in range(100)]
    roster.lose(7, lost)
    assert [roster.up(7, tick) for tick in range(100)] == [
        before[tick] and not lost <= tick < back for tick in range(100)
    ]
    kills = [h.tick for h in roster.happenings() if h.verb == "kill"]
    assert not [tick for tick in kills if lost <= tick < back]  # nobody kills it again


def spans_at_1_ms(*actions, robots=(1, 2, 3), seed=1):
    return spans_of(enumerate(actions), robots, seed, MS)


def test_actions_take_effect_at_the_first_tick_from_their_instant_on():
    exact = KillAction(action="kill", at_s=0.005, robots=1, restart_after_s=0.002)
    assert spans_at_1_ms(exact) == {1: [Span(5, 7, True)]}
    too_short = PauseAction(action="pause", at_s=0.0050001, robots=[2], resume_after_s=0.0001)
    with pytest.raises(
        FaultError, match="cannot resume robot 2: it is paused at that tick, and must be stopped"
    ):
        spans_at_1_ms(too_short)
    late = PauseAction(action="pause", at_s=0.0050001, robots=[2])
    assert spans_at_1_ms(late) == {2: [Span(6, NEVER, False)]}


DONE = {"kill": "killed", "restart": "restarted", "pause": "paused", "resume": "resumed"}
BEFORE = {"kill": "up", "pause": "up", "restart": "killed", "resume": "paused"}
AT_ONE_TICK = {
    ("kill", "restart"): "must be down for at least one tick before it is restarted",
    ("pause", "resume"): "must be stopped for at least one tick before it is resumed",
    ("pause", "kill"): "must be stopped for at least one tick before it is killed",
    ("restart", "kill"): "must be up for at least one tick before it is killed",
    ("restart", "pause"): "must be up for at least one tick before it is paused",
    ("resume", "kill"): None,  # it was stopped, and is dead
    ("resume", "pause"): None,
}
"""What follows ``it is ... at that tick, and``; of every other pair only the beginning is said."""


@pytest.mark.parametrize(("first", "second"), list(product(DONE, DONE)))
def test_two_actions_on_one_robot_at_one_tick_are_told_apart(first, second):
    """Each pair of them, at tick 5 of a robot that is ready for the first one since tick 2."""
    kinds = {
        "kill": KillAction,
        "restart": RestartAction,
        "pause": PauseAction,
        "resume": ResumeAction,
    }

    def action(verb, at_s):
        return kinds[verb](action=verb, at_s=at_s, robots=1)

    ready = {"up": [], "killed": [action("kill", 0.002)], "paused": [action("pause", 0.002)]}
    actions = [*ready[BEFORE[first]], action(first, 0.005), action(second, 0.005)]
    words = AT_ONE_TICK.get((first, second), "")
    if words is None:
        assert spans_at_1_ms(*actions)
        return
    with pytest.raises(FaultError) as caught:
        spans_at_1_ms(*actions)
    beginning = f"cannot {second} robot 1: it is {DONE[first]} at that tick"
    assert caught.value.problems == {
        len(actions) - 1: f"{beginning}, and {words}" if words else beginning
    }


def test_a_random_choice_is_of_those_it_can_happen_to_and_depends_on_the_seed():
    def chosen(seed):
        first = KillAction(action="kill", at_s=0.001, robots=2)
        then = KillAction(action="kill", at_s=0.002, robots={"random": 2})
        return set(spans_at_1_ms(first, then, robots=range(1, 7), seed=seed)) - {2}

    picked = [chosen(seed) for seed in range(40)]
    assert picked == [chosen(seed) for seed in range(40)]
    assert all(len(some) == 2 for some in picked)
    assert set().union(*picked) == {1, 3, 4, 5, 6}
    too_many = KillAction(action="kill", at_s=0.0, robots={"random": 4})
    with pytest.raises(FaultError, match="random = 4: kill is possible for 3"):
        spans_at_1_ms(too_many)


BAD = {
    "restart of one that lives": (
        '{action="restart", at_s=1.0, robots=2}',
        r"timeline\[0\]: cannot restart robot 2: it is up then",
    ),
    "killed twice": (
        f"{kill(1.0, 2)}, {kill(2.0, 2)}",
        r"timeline\[1\]: cannot kill robot 2: it is dead then",
    ),
    "pause of a dead one": (
        f"{kill(1.0, 2)}, {pause(2.0, 2)}",
        r"timeline\[1\]: cannot pause robot 2: it is dead then",
    ),
    "resume of a dead one": (
        f'{kill(1.0, 2)}, {{action="resume", at_s=2.0, robots=2}}',
        r"cannot resume robot 2: it is dead then",
    ),
    "restarted already": (
        f'{kill(1.0, 2, 3.0)}, {{action="restart", at_s=2.0, robots=2}}',
        r"timeline\[0\]: cannot restart robot 2: it is up then",
    ),
    "twice at one tick": (
        f'{kill(1.0, 2)}, {{action="restart", at_s=1.0, robots=2}}',
        r"timeline\[1\]: cannot restart robot 2: it is killed at that tick, and must be down for at least one tick before it is restarted",
    ),
    "reborn and killed": (
        f"{kill(1.0, 2, 1.0)}, {kill(2.0, 2)}",
        r"timeline\[1\]: cannot kill robot 2: it is restarted at that tick, and must be up for at least one tick before it is killed",
    ),
    "unknown robot": (
        kill(1.0, 9),
        r"timeline\[0\]: robot 9 does not exist \(robots: 1, 2, 3, 4, 5\)",
    ),
    "no robots": (kill(1.0, "[]"), r"timeline\[0\]\.robots = \[\]: needs 1 or more"),
    "random of none": (kill(1.0, "{random=0}"), r"robots\.random = 0: must be at least 1"),
    "restart at once": (kill(1.0, 2, 0.0), r"restart_after_s = 0\.0: must be at least 1e-09"),
    "missing robots": ('{action="kill", at_s=1.0}', r"timeline\[0\]\.robots: is required"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_fault_that_cannot_happen_is_named(paper, case):
    actions, words = BAD[case]
    with pytest.raises(ScenarioError, match=words):
        paper("section5-delay", timeline(actions))


def test_all_faults_that_cannot_happen_are_named_at_once(paper):
    actions = [
        kill(1.0, 9),
        '{action="restart", at_s=1.0, robots=2}',
        kill(2.0, 3),
        '{action="resume", at_s=3.0, robots=3}',
        '{action="cut", at_s=1.0, links=[[1, 7]]}',
    ]
    with pytest.raises(ScenarioError) as caught:
        paper("section5-delay", timeline(", ".join(actions)))
    assert sorted(problem.place for problem in caught.value.problems) == [
        "timeline[0]",
        "timeline[1]",
        "timeline[3]",
        "timeline[4]",
    ]


@pytest.mark.parametrize(
    ("override", "words"),
    [
        (
            "neighbours.on_silence=forget",
            "neighbours.on_silence = 'forget': must be 'hold' or 'drop'",
        ),
        (
            "neighbours.silence_s=0.001",
            r"neighbours\.silence_s = 0\.001: must be at least clock\.broadcast_period_s = 0\.01",
        ),
        ("plant.body_on_failure=explode", "must be 'brake', 'coast' or 'freeze'"),
        ("plant.brake_time_s=0.0", "plant.brake_time_s = 0.0: must be at least 1e-09"),
        ("run.on_unscheduled_loss=panic", "must be 'continue' or 'abort'"),
        ("run.patience_s=0.1", "run.patience_s = 0.1: must be at least 0.5"),
    ],
)
def test_bad_settings_are_named(paper, override, words):
    with pytest.raises(ScenarioError, match=words):
        paper("section5-delay", override)


# --- what a body does that is left alone ------------------------------------------------


@given(
    st.floats(-50, 50),
    st.floats(-8, 8),
    st.floats(-3, 3),
    st.floats(1e-4, 0.5),
    st.floats(0.01, 2.0),
)
def test_braking_is_the_solution_of_its_equation(speed, turn_rate, heading, period, brake_time):
    def motion(_t, s):
        return [
            s[3] * math.cos(s[2]),
            s[3] * math.sin(s[2]),
            s[4],
            -s[3] / brake_time,
            -s[4] / brake_time,
        ]

    start = State(1.0, -2.0, heading, speed, turn_rate)
    exact = solve_ivp(motion, (0, period), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    assert np.allclose(braked(start, period, brake_time), exact, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("level", ["dynamic", "kinematic"])
@pytest.mark.parametrize("what", ["brake", "coast", "freeze"])
def test_the_body_of_a_dead_robot_does_what_it_is_told(paper, level, what):
    found = collected(
        paper(
            "section5-delay",
            "duration_s=2.0",
            f"law.level={level}",
            f"plant.body_on_failure={what}",
            "plant.brake_time_s=0.1",
            timeline(kill(1.0, 3)),
        )
    )
    states = found.trajectories.states[:, 2]
    at = {k: states[100 * k // 100] for k in (100, 101, 200)}
    before = states[100]  # as it was when it was killed
    assert before[3] != 0.0
    if what == "freeze":
        assert (states[101:, :3] == before[:3]).all()
        assert (states[101:, 3:] == 0.0).all()
    elif what == "coast":
        assert np.allclose(states[100:, 3:], before[3:], rtol=1e-12)
    else:
        t_s = found.trajectories.t_s[100:] - 1.0
        assert np.allclose(states[100:, 3], before[3] * np.exp(-t_s / 0.1), rtol=1e-9)
        way = before[3] * 0.1 * (1 - np.exp(-10.0))
        assert math.dist(at[200][:2], before[:2]) <= abs(way) + 1e-9
    torques = found.trajectories.torques_nm[100:, 2]
    assert (
        (torques == 0.0).all() if (what, level) == ("coast", "dynamic") else np.isnan(torques).all()
    )


# --- what becomes of messages -----------------------------------------------------------

fault_plans = st.lists(
    st.tuples(
        st.sampled_from(["kill", "pause"]),
        st.integers(1, 5),
        st.integers(0, 30),
        st.integers(1, 12),
    ),
    max_size=5,
)


@settings(max_examples=60)
@given(fault_plans, st.integers(0, 1000))
def test_every_message_has_one_fate_at_every_neighbour_and_the_dead_are_silent(paper, plan, seed):
    """Whatever happens to robots; the plan is one that can happen."""
    down = Counter()
    actions = []
    for verb, robot, begin, length in sorted(plan, key=lambda item: item[2]):
        if begin > down[robot]:
            down[robot] = begin + length
            actions.append((kill if verb == "kill" else pause)(begin / 100, robot, length / 100))
    scenario = paper(
        "section5-delay",
        "duration_s=0.5",
        "clock.control_period_s=0.005",
        f"seed={seed}",
        'network.default.delay={distribution="uniform", low_s=0.0, high_s=0.05}',
        "network.default.loss.probability=0.1",
        timeline(*actions),
    )
    found = collected(scenario)
    roster = scenario.roster()
    assert found.outcome.kind == "completed"
    assert len(found.samples) == 5 * 51
    expected = {
        (source, receiver, tick // 2)
        for tick in range(0, 101, 2)
        for source in scenario.ids
        if roster.up(source, tick)
        for receiver in scenario.neighbours_of[source]
    }
    fates = Counter((row.source, row.destination, row.sequence) for row in found.link_rows)
    assert set(fates) == expected
    assert set(fates.values()) <= {1}
    for row in found.link_rows:
        assert row.t_sent_ns == row.sequence * 10 * MS
        if row.fate == LOST_DOWN:
            ticks = range(row.t_sent_ns // (5 * MS), row.t_sent_ns // (5 * MS) + 11)
            assert any(roster.killed(row.destination, tick) for tick in ticks)
        if row.t_usable_ns is not None:
            assert roster.up(row.destination, -(-row.t_usable_ns // (5 * MS))) or any(
                s.begin <= -(-row.t_usable_ns // (5 * MS)) < s.end and not s.killed
                for s in [roster.span(row.destination, -(-row.t_usable_ns // (5 * MS)))]
            )


def test_what_a_dead_robot_has_sent_still_arrives_and_what_was_sent_to_it_does_not(paper):
    found = collected(paper("section5-delay", "duration_s=1.0", timeline(kill(0.5, 3))))
    last = [row for row in found.link_rows if row.source == 3 and row.t_sent_ns > 400 * MS]
    assert len(last) == 2 * 9
    assert {row.fate for row in last} == {"delivered"}
    assert max(row.t_sent_ns for row in last) == 490 * MS
    to_it = [row for row in found.link_rows if row.destination == 3]
    assert {row.fate for row in to_it if row.t_sent_ns > 400 * MS} == {LOST_DOWN}
    assert {row.fate for row in to_it if row.t_sent_ns < 400 * MS} == {"delivered"}
    assert {row.fate for row in found.link_rows if row.t_sent_ns > 900 * MS} == {
        IN_FLIGHT,
        LOST_DOWN,
    }


def test_a_restarted_robot_has_new_links_and_remembers_nothing(paper):
    lossy = ("duration_s=3.0", "network.default.loss.probability=0.5")
    found = collected(paper("section5-delay", *lossy, timeline(kill(1.0, 3, 0.5))))
    lost = {row.sequence: row.fate for row in found.link_rows if row[2:4] == (2, 3)}
    first, second = ([lost[k] for k in range(s, s + 80)] for s in (0, 150))
    assert Counter(second)["lost: random"] > 20
    assert first != second  # its links draw anew


# --- what neighbours make of silence ----------------------------------------------------


def heard_by_2(paper, *overrides):
    """Whom robot 2 hears at each tick, by the law's eyes."""
    seen = []

    class Notes:
        def command(self, now_ns, own, heard):
            seen.append({s.robot: s.stamp_ns // MS for s in heard})
            return (0.0, 0.0)

    from formnet.agent.robot import Robot
    from formnet.formation.wire.broadcast import Broadcast, Envelope, run_tag
    from formnet.formation.wire.messages import Sense

    scenario = paper("section5-delay", *overrides)
    robot = Robot(resolve(scenario).robot(2), run="run", law=Notes())
    roster = scenario.roster()
    for tick in range(scenario.ticks + 1):
        for source in (1, 3):
            if tick % 10 == 0 and roster.up(source, tick):
                payload = Broadcast(
                    run_tag("run"), source, tick // 10, tick * MS, State(0.0, 0.0, 0.0, 0.0, 0.0)
                ).pack()
                robot.on_broadcast(source, payload, Envelope(source, tick // 10, tick).pack())
        robot.on_sense(Sense(tick, State(0.0, 0.0, 0.0, 0.0, 0.0)))
    return seen


def test_a_silent_neighbour_is_dropped_exactly_after_the_silence_and_rejoins_when_heard(paper):
    seen = heard_by_2(paper, "duration_s=2.5", timeline(kill(1.0, 3, 1.0)))
    # The last message, of 0.99 s, arrives at 1.09 s; more than 0.5 s later it counts as silent.
    assert seen[1590] == {1: 1490, 3: 990}
    assert seen[1591] == {1: 1490}
    assert seen[2099] == {1: 1990}
    assert seen[2100] == {1: 2000, 3: 2000}


def test_a_silent_neighbour_is_held_if_asked(paper):
    seen = heard_by_2(paper, "duration_s=2.0", "neighbours.on_silence=hold", timeline(kill(1.0, 3)))
    assert seen[2000] == {1: 1900, 3: 990}


def test_playout_makes_random_delay_constant(paper):
    random = 'network.default.delay={distribution="uniform", low_s=0.0, high_s=0.2}'
    scenario = paper(
        "section5-delay",
        "duration_s=1.0",
        random,
        "network.default.playout_s=0.15",
    )
    rows = collected(scenario).link_rows
    assert {row.t_usable_ns - row.t_sent_ns for row in rows if row.t_usable_ns} == {150 * MS}
    assert 0.15 < np.mean([row.fate == "lost: late" for row in rows]) < 0.35
    assert scenario.link_settings(1, 2).constant_ns == 150 * MS


# --- unplanned losses, in the plant ------------------------------------------------------


@settings(max_examples=60)
@given(st.data())
def test_the_plant_goes_on_without_whom_it_lost_and_takes_no_word_of_it(paper, data):
    """Robots are lost in any order, before or after their answer of a tick."""
    world = World(resolve(paper("section5-delay", "duration_s=0.2", "clock.control_period_s=0.01")))
    gone = {}
    begun = world.up[:]
    while not world.finished:
        tick = world.tick
        assert world.changed or world.up == begun  # or a shell would ask the same as before
        begun = world.up[:]
        order = data.draw(st.permutations(world.up))
        for robot in order:
            if world.tick != tick or robot in gone:
                continue
            if len(gone) < 5 and data.draw(st.integers(0, 15)) == 0:
                victim = data.draw(st.sampled_from([r for r in world.ids if r not in gone]))
                answered = victim not in world.awaited()
                gone[victim] = world.lose(victim)
                assert gone[victim] == tick + answered
                if world.tick != tick or victim == robot:
                    continue
            if robot in world.awaited() and world.tick == tick:
                world.on_drive(Drive(robot, tick, 0.1, 0.1))
        if not world.up:
            world.idle()
        for robot, since in gone.items():
            assert (robot in world.up) == (world.tick < since)
            if robot not in world.up and not world.finished:
                with pytest.raises(ValueError, match="unexpected drive"):
                    world.on_drive(Drive(robot, world.tick, 0.0, 0.0))
    samples = world.take_samples()
    assert [(s.t_ns // (10 * MS), s.robot) for s in samples] == [
        (tick, robot) for tick in range(21) for robot in world.ids
    ]


def test_a_run_with_faults_repeats_to_the_bit_and_another_seed_is_another_run(root):
    file = root / "configs" / "faults" / "every-fault.toml"

    def sha(seed):
        scenario = load(file, [f"seed={seed}", "duration_s=10.0"])
        return trajectory_sha256(collected(scenario).samples)

    assert sha(1) == sha(1) != sha(2)


def test_scenarios_with_faults_survive_writing_and_reading(root):
    from formnet.formation.scenario.loading import dumps

    scenario = load(root / "configs" / "faults" / "every-fault.toml")
    assert loads(dumps(scenario)) == scenario
