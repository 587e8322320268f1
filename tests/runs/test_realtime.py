"""Real time: the clock's estimate, bodies between messages, robots that nobody waits for."""

import math
import os
import random
import re
import signal
import subprocess
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from processes import Run

from formnet.agent.law import Command
from formnet.agent.timed import MOST_AHEAD_NS, MOST_BEHIND_NS, TimedRobot
from formnet.formation.briefing.resolving import resolve
from formnet.formation.scenario.loading import load
from formnet.formation.wire.broadcast import Broadcast, Envelope, run_tag
from formnet.formation.wire.messages import Drive, Measured
from formnet.formation.wire.state import State
from formnet.formation.wire.sync import RemoteClock, Spread
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.plant.timed import TimedWorld
from formnet.plant.world import World

MS = 1_000_000
YARD = CONFIGS / "yard.toml"


def scenario(*overrides, file=YARD):
    return load(file, overrides)


# --- another's clock ----------------------------------------------------------------------


@given(
    st.integers(-(10**12), 10**12),
    st.lists(
        st.tuples(st.integers(0, 50 * MS), st.integers(0, 50 * MS), st.integers(1, 500 * MS)),
        min_size=1,
        max_size=60,
    ),
)
def test_the_true_offset_is_within_the_uncertainty(offset_ns, trips):
    """Whatever the two directions take."""
    clock, now_ns = RemoteClock(), 0
    for there_ns, back_ns, pause_ns in trips:
        clock.exchange(now_ns, now_ns + there_ns + offset_ns, now_ns + there_ns + back_ns)
        now_ns += there_ns + back_ns
        assert abs(clock.offset_ns() - offset_ns) <= clock.uncertainty_ns(now_ns) + 1
        now_ns += pause_ns
    best_ns = min((there + back) // 2 for there, back, _ in trips[-1:])
    assert clock.uncertainty_ns(now_ns - trips[-1][2]) <= best_ns + 1


@given(st.integers(-90, 90), st.lists(st.integers(0, 20 * MS), min_size=1, max_size=200))
def test_a_clock_that_drifts_is_followed(ppm, trips):
    """The remote clock runs faster or slower by so many millionths; one exchange in 10 ms."""
    clock, own_ns = RemoteClock(), 0
    for trip_ns in trips:
        remote_ns = round((own_ns + trip_ns) * (1 + ppm * 1e-6))  # all of it on the way there
        received_ns = own_ns + trip_ns
        clock.exchange(own_ns, remote_ns, received_ns)
        true_ns = round(received_ns * (1 + ppm * 1e-6)) - received_ns
        assert abs(clock.offset_ns() - true_ns) <= clock.uncertainty_ns(received_ns) + 2
        own_ns = received_ns + 10 * MS


def test_the_remote_time_never_goes_back():
    clock = RemoteClock()
    assert not clock.known
    clock.exchange(0, 1000 * MS + 10 * MS, 10 * MS)  # thinks 1,005 ms ahead
    first = clock.at(11 * MS)
    clock.exchange(20 * MS, 1020 * MS, 20 * MS)  # knows 1,000 ms
    assert clock.at(21 * MS) >= first
    assert clock.at(100 * MS) == 1100 * MS


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=300))
def test_spread_is_numpy_s(values):
    spread = Spread()
    for value in values:
        spread.add(value)
    p50, p99, most = spread.summary()
    expected = np.percentile(values, [50, 99])
    assert np.allclose([p50, p99], expected, rtol=1e-12, atol=1e-9)
    assert (most, spread.count) == (max(values), len(values))
    assert Spread().summary() == []


# --- bodies ---------------------------------------------------------------------------------


@pytest.mark.parametrize("level", ["dynamic", "kinematic"])
@given(st.integers(0, 2**32))
def test_drives_at_the_ticks_move_everybody_as_in_lockstep(level, seed):
    """To the bit: the same pieces of the same integrator."""
    draw = random.Random(seed)
    overrides = (f"law.level={level}", "duration_s=0.5", "robot_defaults.com_offset_m=0.1")
    virtual, timed = World(resolve(scenario(*overrides))), TimedWorld(resolve(scenario(*overrides)))
    while not virtual.finished:
        t_ns, tick = virtual.t_ns, virtual.tick
        for robot, sense in virtual.senses():
            command = draw.uniform(-20, 20), draw.uniform(-20, 20)
            assert timed.measure(robot, t_ns) == sense.state
            timed.drive(robot, t_ns, *command)
            virtual.on_drive(Drive(robot, tick, *command))
        timed.advance(t_ns)
    expected = virtual.take_samples()
    found = timed.take_samples()
    assert [row[:7] for row in found] == [row[:7] for row in expected]
    assert len(found) == 5 * 11


@given(st.lists(st.integers(0, 500 * MS), max_size=30))
def test_whoever_asks_changes_nothing(asked):
    worlds = [TimedWorld(resolve(scenario("duration_s=0.5"))) for _ in range(2)]
    for world in worlds:
        world.drive(3, 0, 5.0, 4.0)
    for t_ns in sorted(asked):
        worlds[0].measure(3, t_ns)
    rows = []
    for world in worlds:
        world.advance(500 * MS)
        rows.append(np.array([row[2:7] for row in world.take_samples()]))
    assert np.allclose(*rows, rtol=0, atol=1e-9)


def test_a_drive_counts_for_so_long_and_then_the_robot_brakes():
    world = TimedWorld(
        resolve(
            scenario(
                "law.level=kinematic", "plant.drive_timeout_s=0.2", "robots.1.start.heading_rad=0"
            )
        )
    )
    world.drive(1, 100 * MS, 2.0, 0.0)
    start = scenario().start_state(1)
    assert world.measure(1, 300 * MS).x_m == pytest.approx(start.x_m + 0.4, abs=1e-12)
    later = world.measure(1, 400 * MS)
    assert later.speed_mps == pytest.approx(2.0 * math.exp(-1.0))
    assert later.x_m == pytest.approx(start.x_m + 0.4 + 0.2 * (1 - math.exp(-1.0)), abs=1e-12)
    world.drive(1, 400 * MS, 1.0, 0.0)
    assert world.measure(1, 450 * MS).speed_mps == 1.0


@pytest.mark.parametrize(
    ("body", "speed"), [("brake", 2.0 * math.exp(-1.0)), ("coast", 2.0), ("freeze", 0.0)]
)
def test_a_robot_that_is_killed_does_what_bodies_do(body, speed):
    kill = 'timeline=[{action="kill", at_s=0.1, robots=1, restart_after_s=0.2}]'
    world = TimedWorld(
        resolve(scenario("law.level=kinematic", f"plant.body_on_failure={body}", kill))
    )
    world.drive(1, 0, 2.0, 0.0)
    assert [world.up(1, t * MS) for t in (99, 100, 299, 300)] == [True, False, False, True]
    assert world.measure(1, 200 * MS).speed_mps == pytest.approx(speed)
    assert [h.verb for h in world.advance(150 * MS)] == ["kill"]
    assert [h.verb for h in world.advance(350 * MS)] == ["restart"]
    assert world.advance(350 * MS) == []


def test_a_lost_robot_and_a_command_that_is_no_number():
    world = TimedWorld(resolve(scenario()))
    assert world.lose(2, 1_234_567_890) == 124
    assert not world.up(2, 1_240 * MS)
    world.drive(3, 1_500 * MS, math.nan, 0.0)
    assert (world.diverged.robot, world.diverged.t_ns) == (3, 1_500 * MS)


def test_samples_are_complete_and_in_order_and_due_when_it_says():
    world = TimedWorld(resolve(scenario("duration_s=0.33")))
    due = []
    while not due or due[-1] < world.end_ns:
        due.append(world.next_ns())
        world.advance(due[-1])
        world.measure(4, due[-1] + 7 * MS)
    assert due == [*range(0, 330 * MS, 50 * MS), 330 * MS]
    rows = world.take_samples()
    assert [(row.t_ns, row.robot) for row in rows] == [(t, r) for t in due for r in range(1, 6)]


# --- a robot ----------------------------------------------------------------------------------


class Echo:
    """Drives with the number of neighbours heard, and the age of the newest in seconds."""

    def command(self, now_ns, own, heard):
        newest = max((stamped.stamp_ns for stamped in heard), default=now_ns)
        return Command(float(len(heard)), (now_ns - newest) / 1e9)


def robot(*overrides):
    constant = 'network.default={delay={distribution="constant", mean_s=0.05}}'
    return TimedRobot(resolve(scenario(constant, *overrides)).robot(1), run="run", law=Echo())


def broadcast(source, sequence, stamp_ns, **changed):
    state = State(1.0, 2.0, 3.0, 4.0, 5.0)
    fields = {
        "tag": run_tag("run"),
        "robot": source,
        "sequence": sequence,
        "stamp_ns": stamp_ns,
    } | changed
    return Broadcast(**fields, state=state).pack(), Envelope(source, sequence, stamp_ns).pack()


def measured(number, t_ns):
    return Measured(number, t_ns, State(0.0, 0.0, 0.0, 0.0, 0.0))


def test_delays_come_on_top_of_the_network_s():
    one = robot()
    one.on_broadcast(2, *broadcast(2, 0, 10 * MS), now_ns=17 * MS)  # 7 ms on the way
    assert one.on_measured(measured(0, 67 * MS - 1))[1][2:] == (0.0, 0.0)
    assert one.on_measured(measured(1, 67 * MS))[1][2:] == (1.0, 0.057)
    assert one.transit_s.summary() == pytest.approx([0.007] * 3)
    (row,) = one.take_link_rows()
    assert (row.t_sent_ns, row.t_usable_ns, row.fate) == (17 * MS, 67 * MS, "delivered")


def test_broadcasts_are_sent_every_so_many_periods_also_after_missed_ones():
    one = robot()
    sent = [
        number
        for number in (0, 1, 4, 5, 6, 13, 14, 15, 16, 20)
        if one.on_measured(measured(number, number * 10 * MS))[0] is not None
    ]
    assert sent == [0, 5, 13, 15, 20]


def test_a_silent_neighbour_is_dropped_and_comes_back():
    one = robot("neighbours.silence_s=0.5")
    one.on_broadcast(2, *broadcast(2, 0, 0), now_ns=0)
    assert one.on_measured(measured(0, 50 * MS))[1].right == 1.0
    assert one.on_measured(measured(1, 551 * MS))[1].right == 0.0
    one.on_broadcast(2, *broadcast(2, 1, 600 * MS), now_ns=600 * MS)
    assert one.on_measured(measured(2, 650 * MS))[1].right == 1.0


@pytest.mark.parametrize(
    ("source", "message", "now_ns", "reason"),
    [
        (4, broadcast(4, 1, 10 * MS), 20 * MS, "not a neighbour"),
        (2, broadcast(3, 1, 10 * MS), 20 * MS, "envelope names another robot"),
        (2, (b"", b"xyz"), 20 * MS, "malformed envelope: not three 64-bit integers"),
        (2, broadcast(2, 0, 10 * MS), 20 * MS, "replayed: sequence or stamp is not newer"),
        (2, broadcast(2, 5, 5 * MS), 20 * MS, "replayed: sequence or stamp is not newer"),
        (2, broadcast(2, 1, MOST_AHEAD_NS + 21 * MS), 20 * MS, "stamped in the future"),
        (2, broadcast(2, 1, 11 * MS), MOST_BEHIND_NS + 12 * MS, "stamped long ago"),
        (
            2,
            (broadcast(2, 1, 11 * MS)[0][:-1], broadcast(2, 1, 11 * MS)[1]),
            20 * MS,
            "malformed: not 72 bytes",
        ),
        (2, broadcast(2, 1, 11 * MS, robot=3), 20 * MS, "claims to be another robot"),
        (2, broadcast(2, 1, 11 * MS, tag=run_tag("else")), 20 * MS, "another run"),
        (
            2,
            (broadcast(2, 1, 3 * MOST_AHEAD_NS)[0], broadcast(2, 1, 11 * MS)[1]),
            20 * MS,
            "stamped at another time than it was sent",
        ),
    ],
)
def test_a_neighbour_that_lies_is_refused_and_counted(source, message, now_ns, reason):
    one = robot()
    one.on_broadcast(2, *broadcast(2, 0, 10 * MS), now_ns=10 * MS)
    one.on_broadcast(source, *message, now_ns=now_ns)
    _, drive = one.on_measured(measured(0, now_ns + 50 * MS))
    assert drive.right == 1.0  # only the first
    assert [(r.source, r.reason, r.times) for r in one.take_rejections()] == [(source, reason, 1)]


# --- processes --------------------------------------------------------------------------------


@pytest.fixture
def start(tmp_path):
    """Start runs of the yard; whatever is left of them afterwards is killed."""
    runs = []

    def starter(*overrides):
        sets = [part for text in overrides for part in ("--set", text)]
        runs.append(Run(tmp_path / f"run{len(runs)}", YARD, *sets))
        return runs[-1]

    yield starter
    for run in runs:
        run.end()


@pytest.mark.processes
def test_a_run_in_real_time_takes_its_time_and_is_judged_like_any_other(start):
    run = start("duration_s=4.0", "law.beta=2.5", "clock.sync_bound_s=1e-6")
    assert run.wait(60) == 1, run.output()  # too short for the claims
    judged, events = run.verdict(), run.events()
    assert judged["outcome"]["kind"] == "completed"
    assert 3.9 < judged["wall_s"] < 6.0
    assert pq.read_table(run.out / "states.parquet").num_rows == 5 * 81
    assert "started" in [event["event"] for event in events]
    timing = judged["realtime"]
    assert set(timing["robots"]) == {"1", "2", "3", "4", "5"}
    for own in timing["robots"].values():
        assert 350 <= own["periods"] <= 402
        assert own["missed"] < 200  # the machine may be busy; the benchmark says how many it is
        assert 0.0 < own["clock_uncertainty_s"] < 1.0
        assert abs(own["clock_offset_s"]) > 0.0
    assert judged["lyapunov"] is None
    uncertain = {e["robot"]: e for e in events if e["event"] == "clock uncertain"}
    assert set(uncertain) == {1, 2, 3, 4, 5}  # nobody knows the time to a microsecond
    assert all(e["uncertainty_s"] > e["bound_s"] == 1e-6 for e in uncertain.values())
    for link in judged["links"]:
        assert 0.03 < link["delay_s"]["p50"] < 0.09
        assert link["sent"] > 30
    states = pq.read_table(run.out / "states.parquet")
    speeds = np.abs(states.column("speed_mps").to_numpy())
    assert speeds.max() > 0.5  # they move
    assert judged["motion"]["top_speed"]["speed_mps"] >= speeds.max()
    assert [event["event"] for event in events][-3:] == ["timing", "extremes", "completed"]


@pytest.mark.processes
def test_robots_that_fail_in_real_time(start):
    run = start(
        "duration_s=9.0",
        "run.patience_s=2.0",
        'timeline=[{action="kill", at_s=2.5, robots=2, restart_after_s=1.0}, '
        '{action="pause", at_s=1.0, robots=3, resume_after_s=1.5}]',
    )
    run.until_event("restart")
    run.child("agent", "--robot", "5").send_signal(signal.SIGKILL)
    run.child("agent", "--robot", "1").send_signal(signal.SIGSTOP)
    assert run.wait(60) == 1, run.output()
    events = [(e["event"], e.get("robots", e.get("robot"))) for e in run.events()]
    for expected in [
        ("kill", [2]),
        ("pause", [3]),
        ("restart", [2]),
        ("resume", [3]),
        ("lost", 5),
        ("lost", 1),
    ]:
        assert expected in events
    judged = run.verdict()
    assert judged["robots"]["judged"] == [2, 3, 4]
    reasons = {item["robot"]: item["reason"] for item in judged["robots"]["lost"]}
    assert reasons == {5: "its process is gone", 1: "did not ask or drive for 2 s"}
    heard = pq.read_table(run.out / "links.parquet").to_pylist()
    last = max(row["t_sent_ns"] for row in heard if row["source"] == 2)
    assert last > 7e9  # the restarted one is heard again
    reborn = min(row["t_sent_ns"] for row in heard if row["source"] == 2 and row["t_sent_ns"] > 3e9)
    periods = judged["realtime"]["robots"]["2"]["periods"]
    assert periods > (9e9 - reborn) / 1e7 + 100  # those of its first life, too
    to_dead = [row for row in heard if (row["source"], row["destination"]) == (1, 2)]
    numbers = sorted(row["sequence"] for row in to_dead)
    assert numbers == list(range(len(numbers)))  # each message once, whoever could tell of it
    assert {row["fate"] for row in to_dead if 2.6e9 < row["t_sent_ns"] < 3.4e9} == {
        "lost: receiver down"
    }
    assert not [e for e in run.events() if e["event"] == "silent at the end"]


@pytest.mark.processes
@pytest.mark.parametrize("policy", ["continue", "abort"])
def test_a_robot_that_hangs_shortly_before_the_end_is_lost_too(start, policy):
    run = start(
        "duration_s=4.0",
        "run.patience_s=3.0",
        f"run.on_unscheduled_loss={policy}",
        'timeline=[{action="pause", at_s=2.0, robots=3, resume_after_s=0.1}]',
    )
    run.until_event("resume")
    run.child("agent", "--robot", "1").send_signal(signal.SIGSTOP)
    code = run.wait(60)
    judged, said = run.verdict(), " ".join(run.output().split())
    assert "waiting at t = 4.000 s for robot 1 to hand in a last report" in said
    assert "silent at the end: robot 1: the fate of messages since the last report" in said
    if policy == "abort":
        assert code == 3
        assert judged["outcome"]["kind"] == "lost"
        return
    assert code == 1
    (lost,) = judged["robots"]["lost"]
    since = re.fullmatch(r"nothing came from it after t = (\S+) s", lost["reason"])
    assert since is not None
    hung_s = 4.0 - float(since[1])
    assert judged["robots"]["judged"] == [2, 3, 4, 5]
    counts = judged["realtime"]["robots"]["1"]
    assert 100 * hung_s - 2 <= counts["missed"] <= counts["periods"] < 410


@pytest.mark.processes
def test_a_plant_in_real_time_that_dies_ends_the_run(start):
    run = start("duration_s=20.0")
    run.until_event("started")
    plant = run.child("plant")
    os.kill(plant.pid, signal.SIGKILL)
    assert run.wait(30) == 3
    assert run.verdict()["outcome"]["kind"] == "broken"


@pytest.mark.processes
@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["run", "--inline"], "--inline: needs virtual time"),
        (["nemesis", "--runs", "1"], 'clock.mode = "realtime": must be "lockstep"'),
    ],
)
def test_what_needs_virtual_time_says_so(tmp_path, command, words):
    result = subprocess.run(
        [sys.executable, "-m", "formnet", command[0], str(YARD), *command[1:]],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert result.returncode == 2
    assert words in " ".join((result.stdout + result.stderr).split())
