"""The extremes of the motion against brute force over all ticks and pairs, and closed forms."""

import json
import math
import random
from itertools import combinations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from formnet.exact.trigonometry import hypot
from formnet.formation.briefing.resolving import resolve
from formnet.formation.scenario.loading import load
from formnet.formation.wire.messages import Drive
from formnet.formation.wire.state import State
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.plant.extremes import Extremes
from formnet.plant.timed import TimedWorld
from formnet.plant.world import World

MS = 1_000_000


def brute_force(ids, dynamic, ticks):
    """By definition. ``ticks`` are (t_ns, states, drives), drives as (robot, first, second)."""
    distances, speeds, turn_rates, commands = [], [], [], []
    for t_ns, states, drives in ticks:
        for one, other in combinations(range(len(ids)), 2):
            a, b = states[ids[one]], states[ids[other]]
            distances.append((hypot(a.x_m - b.x_m, a.y_m - b.y_m), t_ns, one, other))
        for place, robot in enumerate(ids):
            speeds.append((-abs(states[robot].speed_mps), t_ns, place))
            turn_rates.append((-abs(states[robot].turn_rate_radps), t_ns, place))
        for robot, first, second in drives:
            if math.isfinite(first) and math.isfinite(second):
                size = max(abs(first), abs(second)) if dynamic else abs(first)
                commands.append((-size, t_ns, ids.index(robot)))
    distances = [some for some in distances if some[0] < math.inf]

    def top(name, found):
        if not found:
            return None
        value, t_ns, place = min(found)
        return {name: -value, "robot": ids[place], "t_s": t_ns / 1e9}

    closest = None
    if distances:
        value, t_ns, one, other = min(distances)
        closest = {"distance_m": value, "robots": [ids[one], ids[other]], "t_s": t_ns / 1e9}
    return {
        "closest": closest,
        "top_speed": top("speed_mps", speeds),
        "top_turn_rate": top("turn_rate_radps", turn_rates),
        "top_command": top("torque_nm" if dynamic else "speed_mps", commands),
    }


def found_by(ids, dynamic, ticks):
    extremes = Extremes(ids, dynamic=dynamic)
    for t_ns, states, drives in ticks:
        extremes.at(t_ns, states)
        for drive in drives:
            extremes.asked(t_ns, *drive)
    return extremes.event(0).details


coarse = st.sampled_from([-2.0, -1.0, -0.0, 0.0, 1.0, 2.0])  # ties, and robots at one place
tiny = st.sampled_from([0.0, 5e-324, -5e-324, 1e-323, 1e-310, -3e-308])
huge = st.sampled_from([-1.7e308, -1e300, 1e20, 2.5e9, 1e300, 1.7e308])
near = st.floats(-1e-3, 1e-3)
value = st.one_of(coarse, tiny, huge, near, st.floats(-50, 50))
command = st.one_of(value, st.sampled_from([math.nan, math.inf, -math.inf]))


@st.composite
def motions(draw):
    """Robots that stand, crawl and jump, as (ids, dynamic, ticks)."""
    ids = draw(st.lists(st.integers(1, 99), min_size=1, max_size=6, unique=True))
    states = {robot: State(*(draw(value) for _ in range(5))) for robot in ids}
    ticks = []
    for tick in range(draw(st.integers(1, 12))):
        drives = [(robot, draw(command), draw(command)) for robot in draw(st.permutations(ids))]
        ticks.append((tick * MS, states, drives[draw(st.integers(0, len(drives))) :]))
        states = dict(states)
        drift = draw(coarse), draw(st.one_of(coarse, near))  # of all alike
        for robot in draw(st.permutations(ids)):
            x, y, *rest = states.pop(robot)
            how = draw(st.sampled_from(["stands", "drifts", "moves", "jumps"]))
            if how == "drifts":
                x, y = x + drift[0], y + drift[1]
            elif how == "moves":
                x, y = x + draw(near), y + draw(st.one_of(near, tiny))
            elif how == "jumps":
                x, y, *rest = (draw(value) for _ in range(5))
            moved = State(x, y, *rest)
            states[robot] = moved if all(map(math.isfinite, moved)) else State(0, 0, 0, 0, 0)
    return ids, draw(st.booleans()), ticks


@pytest.mark.long
@settings(max_examples=600)
@given(motions())
def test_extremes_are_those_of_all_ticks_and_pairs(motion):
    assert repr(found_by(*motion)) == repr(brute_force(*motion))


@settings(max_examples=40)
@given(
    st.integers(0, 2**32),
    st.integers(2, 20),
    st.sampled_from([1e-3, 1e-2, 0.3]),
    st.sampled_from([0.0, 3.0]),
)
def test_a_swarm_that_moves_smoothly_has_the_same_extremes(seed, count, pace, drift):
    """Everybody swings along both axes, so that pairs part and meet again."""
    draw, ids = random.Random(seed), list(range(1, count + 1))
    swings = {
        robot: [(draw.uniform(1, 9), draw.uniform(0.2, 3), draw.uniform(0, 6)) for _ in range(2)]
        for robot in ids
    }

    def place(robot, t):
        x, y = (size * math.sin(rate * t + phase) for size, rate, phase in swings[robot])
        return State(x + drift * t, y, 0.0, 1.0, 2.0)

    ticks = [(k * MS, {robot: place(robot, k * pace) for robot in ids}, []) for k in range(400)]
    assert found_by(ids, True, ticks) == brute_force(ids, True, ticks)


@settings(max_examples=100)
@given(
    st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=2, max_size=4),
    st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)), min_size=1, max_size=8),
)
def test_a_formation_that_moves_as_one_comes_closer_by_rounding_alone(places, ways):
    """Far out, coordinates are known to fewer digits, and so are distances."""
    ids = list(range(len(places)))
    states, ticks = {k: State(x, y, 0.0, 0.0, 0.0) for k, (x, y) in enumerate(places)}, []
    for tick, (along, across) in enumerate([(0.0, 0.0), *ways]):
        states = {
            robot: state._replace(x_m=state.x_m + along, y_m=state.y_m + across)
            for robot, state in states.items()
        }
        ticks.append((tick * MS, states, []))
    assert found_by(ids, True, ticks) == brute_force(ids, True, ticks)


@pytest.mark.parametrize("then", [{}, {4: 2.5, 1: 10.5, 2: 11.0}])
def test_of_pairs_as_close_as_each_other_the_first_in_the_file_counts(then):
    """At the start, and later, where what they move by tells them apart."""
    ids, starts = [1, 2, 3, 4], {1: 10.0, 2: 11.0, 3: 2.0, 4: 3.0}
    ticks = [
        (tick * MS, {robot: State(x, 0.0, 0.0, 0.0, 0.0) for robot, x in places.items()}, [])
        for tick, places in enumerate([starts, starts | then])
    ]
    found = found_by(ids, True, ticks)["closest"]
    expected = {"distance_m": 0.5, "t_s": 0.001} if then else {"distance_m": 1.0, "t_s": 0.0}
    assert found == {**expected, "robots": [1, 2]}


class Counting(dict):
    """States that count how often they are looked at."""

    looked = 0

    def __getitem__(self, robot):
        Counting.looked += 1
        return super().__getitem__(robot)


def looks(ids, ticks):
    """How often states are looked at in each tick."""
    extremes, found = Extremes(ids, dynamic=True), []
    for tick, states in enumerate(ticks):
        before = Counting.looked
        extremes.at(tick * MS, Counting(states))
        found.append(Counting.looked - before)
    return found


def test_a_thousand_robots_do_not_cost_every_pair_at_every_tick():
    """On a grid of 1 m that drifts as a whole while everybody trembles by a millimetre."""
    draw, ids = random.Random(1), list(range(1000))

    def place(robot, tick):
        x, y = robot % 32 + 0.01 * tick, robot // 32
        return State(x + draw.uniform(-1e-3, 1e-3), y + draw.uniform(-1e-3, 1e-3), 0.0, 10.0, 0.0)

    found = looks(ids, [{robot: place(robot, tick) for robot in ids} for tick in range(40)])
    assert sum(found) / 40 < 20_000  # there are 499,500 pairs, some 2000 of them neighbours


def test_who_stands_costs_nothing():
    state = State(0.0, 0.0, 0.0, 0.0, 0.0)
    found = looks([1, 2, 3], [{k: state._replace(x_m=float(k)) for k in (1, 2, 3)}] * 9)
    assert found[1:] == [6] * 8  # each robot's state, and the one before


def test_before_any_tick_there_is_nothing():
    nothing = dict.fromkeys(("closest", "top_speed", "top_turn_rate", "top_command"))
    assert Extremes([1, 2], dynamic=True).event(0).details == nothing


# --- in the plant -----------------------------------------------------------------------


def two(*more, level="kinematic"):
    """Robots 7 and 3 pass each other at 0.096 m and 74 m/s, 13 ms after the start."""
    passing = (
        "robots=[{id=7, offset_m=[0.0, 0.0], start={x_m=-0.481, y_m=0.0, heading_rad=0.0}}, "
        "{id=3, offset_m=[1.0, 0.0], start={x_m=0.481, y_m=0.096, heading_rad=0.0}}]"
    )
    return load(
        CONFIGS / "paper" / "theorem4.toml",
        [
            passing,
            "formation.edges=[[7,3]]",
            f"law.level={level}",
            "duration_s=0.05",
            "clock.control_period_s=0.001",
            "clock.broadcast_period_s=0.01",
            *more,
        ],
    )


def driven_to_the_end(world, command, shuffle=lambda robots: robots):
    while not world.finished:
        if not world.up:
            world.idle()
            continue
        tick, up = world.tick, list(world.up)
        for robot in shuffle(up):
            world.on_drive(Drive(robot, tick, *command(robot, tick)))
    return world


def test_what_lies_between_two_broadcasts_is_seen():
    """At broadcasts 10 ms apart they are never closer than 0.24 m."""
    world = driven_to_the_end(
        World(resolve(two())), lambda robot, _: (37.0 if robot == 7 else -37.0, 0.0)
    )
    found = world.extremes.event(0).details
    assert found["closest"]["distance_m"] == pytest.approx(0.096, abs=1e-12)
    assert (found["closest"]["robots"], found["closest"]["t_s"]) == ([7, 3], 0.013)
    rows = world.take_samples()
    sampled = [
        math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) for a, b in zip(rows[::2], rows[1::2], strict=True)
    ]
    assert min(sampled) == pytest.approx(math.hypot(0.962 - 0.74, 0.096), abs=1e-9)
    assert found["top_speed"] == {"speed_mps": 37.0, "robot": 7, "t_s": 0.001}
    assert found["top_turn_rate"] == {"turn_rate_radps": 0.0, "robot": 7, "t_s": 0.0}
    assert found["top_command"] == {"speed_mps": 37.0, "robot": 7, "t_s": 0.0}


def test_a_command_counts_before_the_wheel_s_limit_and_in_either_wheel():
    limited = two("robot_defaults.wheel_torque_limit_nm=2.0", level="dynamic")
    commands = {(3, 4): (1.0, -900.0), (7, 4): (900.0, 1.0), (7, 9): (-899.0, 0.0)}
    world = driven_to_the_end(
        World(resolve(limited)), lambda *which: commands.get(which, (0.0, 0.0))
    )
    found = world.extremes.event(0).details["top_command"]
    assert found == {"torque_nm": 900.0, "robot": 7, "t_s": 0.004}
    assert max(row.torque_right_nm for row in world.take_samples()) <= 2.0


def test_a_robot_that_is_dead_can_be_hit_and_is_no_source_of_commands():
    """Robot 3 dies where it started and stands; robot 7 drives by."""
    world = driven_to_the_end(
        World(
            resolve(
                two(
                    'timeline=[{action="kill", at_s=0.0, robots=3}]',
                    "plant.body_on_failure=freeze",
                    "run.on_unscheduled_loss=continue",
                )
            )
        ),
        lambda *_: (37.0, 0.0),
    )
    found = world.extremes.event(0).details
    assert found["closest"]["robots"] == [7, 3]
    assert found["closest"]["t_s"] == 0.026  # after 0.962 m at 37 m/s
    assert found["closest"]["distance_m"] == pytest.approx(0.096, abs=1e-12)
    assert found["top_command"]["robot"] == 7


def test_where_everybody_is_down_bodies_move_on():
    kill = 'timeline=[{action="kill", at_s=0.005, robots="*"}]'
    world = driven_to_the_end(
        World(resolve(two(kill, "plant.body_on_failure=coast"))),
        lambda robot, _: (37.0 if robot == 7 else -37.0, 0.0),
    )
    assert world.extremes.event(0).details["closest"]["t_s"] == 0.013


@given(st.integers(0, 2**32), st.sampled_from(["dynamic", "kinematic"]))
def test_the_order_of_answers_does_not_matter(seed, level):
    """Commands from few values, so that ties are the rule."""
    draw = random.Random(seed)
    asked = {
        (robot, tick): (draw.choice([1.0, -5.0, 5.0]), draw.choice([0.0, 5.0]))
        for robot in (7, 3)
        for tick in range(51)
    }

    def shuffled(robots):
        draw.shuffle(robots)
        return robots

    found = [
        driven_to_the_end(World(resolve(two(level=level))), lambda *which: asked[which], shuffle)
        for shuffle in (shuffled, sorted, lambda robots: robots)
    ]
    assert len({repr(world.extremes.event(0).details) for world in found}) == 1


def test_a_tick_that_is_not_complete_does_not_count():
    world = World(resolve(two()))
    world.on_drive(Drive(3, 0, 1e6, 0.0))
    assert (
        world.extremes.event(0).details["closest"]
        is world.extremes.event(0).details["top_command"]
        is None
    )
    world.on_drive(Drive(7, 0, 1.0, 0.0))
    assert world.extremes.event(0).details["top_command"]["robot"] == 3
    world.on_drive(Drive(3, 1, 2e6, 0.0))
    assert world.extremes.event(0).details["top_command"]["speed_mps"] == 1e6


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_is_left_out_and_the_others_of_its_tick_are_not(bad):
    world = World(resolve(two(level="dynamic")))
    world.on_drive(Drive(7, 0, 1e6, bad))
    world.on_drive(Drive(3, 0, 5.0, -6.0))
    assert world.diverged is not None
    found = world.extremes.event(0).details
    assert found["top_command"] == {"torque_nm": 6.0, "robot": 3, "t_s": 0.0}
    json.dumps(found, allow_nan=False)


@pytest.mark.parametrize("level", ["dynamic", "kinematic"])
@given(st.integers(0, 2**32))
def test_drives_at_the_ticks_have_the_same_extremes_in_real_time(level, seed):
    """To the bit, whenever robots ask between the ticks of others."""
    draw = random.Random(seed)
    settings = (f"law.level={level}", "duration_s=0.5")
    yard = load(CONFIGS / "yard.toml", settings)
    virtual, timed = World(resolve(yard)), TimedWorld(resolve(yard))
    while not virtual.finished:
        t_ns, tick = virtual.t_ns, virtual.tick
        for robot, sense in virtual.senses():
            command = draw.uniform(-20, 20), draw.uniform(-20, 20)
            assert timed.measure(robot, t_ns) == sense.state
            timed.drive(robot, t_ns, *command)
            virtual.on_drive(Drive(robot, tick, *command))
    timed.advance(timed.end_ns)
    assert repr(timed.extremes.event(0).details) == repr(virtual.extremes.event(0).details)


def test_in_real_time_all_ticks_count_though_nobody_asks_at_them():
    world = TimedWorld(resolve(two("plant.drive_timeout_s=1")))
    world.drive(7, 0, 37.0, 0.0)
    world.drive(3, 0, -37.0, 0.0)
    world.advance(50 * MS)
    found = world.extremes.event(0).details
    assert found["closest"]["distance_m"] == pytest.approx(0.096, abs=1e-12)
    assert found["closest"]["t_s"] == 0.013


def test_in_real_time_what_comes_after_a_divergence_does_not_count():
    world = TimedWorld(resolve(two()))
    world.advance(MS)
    world.drive(7, 2 * MS, math.nan, 0.0)
    world.drive(3, 2 * MS, 99.0, 0.0)
    world.advance(50 * MS)
    found = world.extremes.event(0).details
    assert found["top_command"] is None
    assert found["top_speed"] == {"speed_mps": 0.0, "robot": 7, "t_s": 0.0}
