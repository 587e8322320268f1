"""The plant in lockstep while it waits: every way in which a robot can keep it waiting.

On a bus in memory with a clock of its own (``memory_bus``): a patience of half a minute takes
milliseconds, and nothing depends on how busy the machine is.
"""

from functools import partial

import pytest
from memory_bus import MemoryBus

from formnet.formation.briefing.resolving import resolve
from formnet.formation.records import events
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.rows import LinkRow, LinkRows, Samples
from formnet.formation.records.stream import Stir
from formnet.formation.wire.messages import (
    KILL,
    PLANT,
    PROTOCOL,
    Brief,
    CatchUp,
    Drive,
    End,
    Failed,
    Links,
    Meet,
    Rejected,
    Sense,
    Waiting,
)
from formnet.plant.host import FAREWELL_S, HASTY_FAREWELL_S, START_PATIENCE_S, VANISHED
from formnet.plant.lockstep import LockstepPlant

MS = 10**6


class Hosted:
    """A plant and its robots; :meth:`run` hosts them to the end."""

    def __init__(self, scenario, start_patience_s=None):
        self.plan = resolve(scenario)
        self.bus = MemoryBus(self.plan.ids)
        self.robots = self.bus.robots
        self.plant = LockstepPlant(
            self.bus, self.plan, self.bus, start_patience_s, self.bus.mailbox
        )

    def run(self):
        outcome = self.plant.run()
        assert self.bus.records[-1] == outcome
        return outcome

    def waits(self):
        """On whom the run waited, for what, and when it said so, each of them once."""
        return list(
            dict.fromkeys((e.t_ns // MS, e.what, e.robots) for e in self.bus.told(events.Waiting))
        )

    def ticks(self, robot):
        """The ticks for which a robot was told its state."""
        return [sense.tick for sense in self.robots[robot].heard if isinstance(sense, Sense)]

    @property
    def now_s(self):
        return self.bus.mailbox.now_s()


@pytest.fixture
def hosted(paper):
    """``hosted("key=value", ...)``: 50 ticks of Section 5's five robots."""

    def host(*overrides, **how):
        return Hosted(paper("section5-delay", "duration_s=0.05", *overrides), **how)

    return host


FAULT = 'timeline=[{{at_s=0.02, action="{}", robots=[2], {}_after_s=0.01}}]'
RESTART, RESUME = FAULT.format("kill", "restart"), FAULT.format("pause", "resume")
KILLED = 'timeline=[{at_s=0.02, action="kill", robots=[2]}]'
COMPLETED = Outcome("completed", 50 * MS, None, "")


def test_a_run_in_which_nothing_goes_wrong(hosted):
    run = hosted()
    assert run.run() == COMPLETED
    assert [event.name for event in run.bus.told(events.Event)] == [
        "started",
        "last tick",
        "extremes",
    ]
    assert all(run.ticks(robot) == list(range(51)) for robot in run.robots)
    rows = [row for record in run.bus.told(Samples) for row in record.rows]
    assert [(row.t_ns, row.robot) for row in rows] == [
        (t_ns, robot) for t_ns in range(0, 51 * MS, 10 * MS) for robot in run.plan.ids
    ]
    assert run.now_s < 1.0


# --- before the first tick ------------------------------------------------------------


def test_who_does_not_join_is_named_and_ends_the_run(hosted):
    run = hosted(start_patience_s=5.0)
    run.robots[3].absent = True
    assert run.run() == Outcome("lost", 0, 3, "did not join in time")
    assert run.waits()[0] == (0, "join", (3,))
    assert not run.bus.told(events.Started)
    assert not run.bus.told(events.Extremes)
    assert 5.0 <= run.now_s < 6.0


def test_without_a_limit_it_waits_for_as_long_as_it_takes(hosted):
    run = hosted()
    run.robots[3].late_s = 300.0
    assert run.run() == COMPLETED
    assert run.waits() == [(0, "join", (3,))]
    assert run.now_s > 300.0


def test_patience_is_from_the_last_that_came(hosted):
    run = hosted(start_patience_s=5.0)
    for robot in run.robots.values():
        robot.late_s = 4.0 * robot.robot
    assert run.run() == COMPLETED


def test_who_does_not_hear_its_neighbours_is_named_and_ends_the_run(hosted):
    run = hosted(start_patience_s=5.0)
    run.robots[3].deaf = (Brief,)
    assert run.run() == Outcome("lost", 0, 3, "did not be heard by its neighbours in time")
    assert run.waits()[-1] == (0, "be heard", (3,))


def test_who_is_gone_before_the_first_tick_ends_the_run(hosted):
    run = hosted()
    run.robots[3].absent = True
    run.bus.mailbox.after(2.0, run.robots[4].end)
    assert run.run() == Outcome("lost", 0, 4, VANISHED)


def test_another_protocol_ends_the_run(hosted):
    run = hosted()
    run.robots[3].protocol = PROTOCOL - 1
    outcome = run.run()
    assert (outcome.kind, outcome.robot) == ("failed", 3)
    assert outcome.reason.startswith(f"speaks protocol {PROTOCOL - 1}, the plant {PROTOCOL}: ")


# --- lost in the run ------------------------------------------------------------------


def test_who_does_not_answer_is_named_and_then_lost_and_all_go_on(hosted):
    run = hosted("run.patience_s=3")
    run.robots[3].silent_from = 20
    assert run.run() == COMPLETED
    assert run.waits() == [(20, "answer", (3,))]
    assert run.bus.told(events.Lost) == [
        events.Lost(20 * MS, 3, "did not answer for 3 s", 20),
    ]
    for robot in (1, 2, 4, 5):
        assert run.robots[robot].lost() == [(3, 20)]
        assert run.ticks(robot) == list(range(51))
    assert run.ticks(3) == list(range(21))
    assert 3.0 <= run.now_s < 5.0


def test_who_waits_for_another_is_not_blamed(hosted):
    run = hosted("run.patience_s=3")
    waits, silent = run.robots[2], run.robots[3]
    waits.silent_from = silent.silent_from = 20
    waits.at[20] = lambda: waits.say(Waiting(2, 20, [3]))

    def go_on():
        waits.silent_from = None
        waits.say(Drive(2, 20, 0.0, 0.0))

    silent.at[20] = lambda: run.bus.mailbox.after(3.5, go_on)
    assert run.run() == COMPLETED
    assert run.waits() == [(20, "answer", (3,))]
    assert [event.robot for event in run.bus.told(events.Lost)] == [3]


def test_who_lies_about_whom_it_waits_for_frames_nobody(hosted):
    """Robot 2 answers nothing more, and says of robots that were heard that it waits for them."""
    run = hosted("run.patience_s=3")
    liar = run.robots[2]
    liar.silent_from = 20
    liar.at[20] = lambda: liar.say(Waiting(2, 20, [*run.plan.neighbours_of[2], 99]))
    assert run.run() == COMPLETED
    assert run.waits() == [(20, "answer", (2,))]
    assert [event.robot for event in run.bus.told(events.Lost)] == [2]


def test_who_lies_is_to_blame_where_others_wait_for_it(hosted):
    """Robot 3 says that it waits for robot 2, which waits for it, as robot 4 does."""
    run = hosted("run.patience_s=3")
    for robot, others in ((3, [2]), (2, [3]), (4, [3])):
        waits = run.robots[robot]
        assert set(others) <= set(run.plan.neighbours_of[robot])
        waits.silent_from = 20
        waits.at[20] = partial(waits.say, Waiting(robot, 20, others))

    def go_on():
        for robot in (2, 4):
            run.robots[robot].silent_from = None
            run.robots[robot].say(Drive(robot, 20, 0.0, 0.0))

    run.bus.mailbox.after(3.5, go_on)
    assert run.run() == COMPLETED
    assert run.waits() == [(20, "answer", (3,))]
    assert [event.robot for event in run.bus.told(events.Lost)] == [3]


def test_whose_process_ends_is_lost_at_once(hosted):
    run = hosted()
    run.robots[3].at[20] = run.robots[3].end
    assert run.run() == COMPLETED
    assert run.bus.told(events.Lost) == [events.Lost(20 * MS, 3, VANISHED, 20)]
    assert run.waits() == []
    assert run.now_s < 1.0


def test_who_answered_before_its_process_ended_is_lost_from_the_next_tick_on(hosted):
    run = hosted()
    run.robots[3].at[20] = lambda: run.bus.mailbox.after(1e-4, run.robots[3].end)
    run.robots[4].at[20] = lambda: setattr(run.robots[4], "silent_from", 20)
    run.bus.mailbox.after(0.5, lambda: run.robots[4].say(Drive(4, 20, 0.0, 0.0)))
    run.bus.mailbox.after(0.4, lambda: setattr(run.robots[4], "silent_from", None))
    assert run.run() == COMPLETED
    assert run.bus.told(events.Lost) == [events.Lost(20 * MS, 3, VANISHED, 21)]


def test_the_last_robot_s_loss_leaves_bodies_alone_to_the_end(hosted):
    run = hosted()
    for robot in run.robots.values():
        robot.at[20] = robot.end
    assert run.run() == COMPLETED
    assert [event.robot for event in run.bus.told(events.Lost)] == list(run.plan.ids)


@pytest.mark.parametrize("how", ["silent", "gone"])
def test_a_loss_ends_the_run_where_the_scenario_says_so(hosted, how):
    run = hosted("run.patience_s=3", "run.on_unscheduled_loss=abort")
    robot = run.robots[3]
    if how == "silent":
        robot.silent_from = 20
    else:
        robot.at[20] = robot.end
    reason = "did not answer for 3 s" if how == "silent" else VANISHED
    assert run.run() == Outcome("lost", 20 * MS, 3, reason)
    assert all(End(other, "lost", 19) in run.robots[other].heard for other in (1, 2, 4, 5))
    assert not run.bus.told(events.Lost)


# --- killed and restarted -------------------------------------------------------------


def test_a_killed_robot_says_its_last_first_and_comes_back_met(hosted):
    run = hosted(RESTART)
    assert run.run() == COMPLETED
    assert [(e.name, e.t_ns // MS, e.robots) for e in run.bus.told(events.Planned)] == [
        ("kill", 20, (2,)),
        ("restart", 30, (2,)),
    ]
    assert End(2, KILL, 19) in run.robots[2].heard
    assert run.ticks(2) == [*range(20), *range(30, 51)]
    first, second = [brief for brief in run.robots[2].heard if isinstance(brief, Brief)]
    assert (first.tick, second.tick, second.neighbours) == (0, 30, [1, 3])
    for neighbour in (1, 3):
        assert Meet(30, [2]) in run.robots[neighbour].heard
    for other in (4, 5):
        assert not [m for m in run.robots[other].heard if isinstance(m, Meet)]
    assert run.waits() == []


def test_who_does_not_say_its_last_is_killed_all_the_same(hosted):
    run = hosted(KILLED, "run.patience_s=3")
    run.robots[2].deaf = (End,)
    assert run.run() == COMPLETED
    assert run.waits() == [(20, "say its last", (2,))]
    assert run.bus.told(events.Kill) == [events.Kill(20 * MS, (2,))]
    assert not run.bus.told(events.Lost)
    assert 3.0 <= run.now_s < 4.0


def test_who_dies_instead_of_saying_its_last_is_waited_for_no_longer(hosted):
    run = hosted(KILLED)
    run.robots[2].deaf = (End,)
    run.robots[2].at[19] = lambda: run.bus.mailbox.after(1.5, run.robots[2].end)
    assert run.run() == COMPLETED
    assert run.waits() == [(20, "say its last", (2,))]
    assert not run.bus.told(events.Lost)
    assert 1.5 <= run.now_s < 2.0


def test_whose_process_does_not_die_is_waited_for_until_patience_ends(hosted):
    run = hosted(KILLED, "run.patience_s=3")
    run.robots[2].end = lambda: None
    assert run.run() == COMPLETED
    assert (20, "die", (2,)) in run.waits()
    assert not run.bus.told(events.Lost)


def test_a_process_that_is_not_there_again_is_lost(hosted):
    run = hosted(RESTART)
    run.robots[2].at[0] = lambda: setattr(run.robots[2], "absent", True)
    assert run.run() == COMPLETED
    assert run.waits() == [(30, "join", (2,))]
    assert run.bus.told(events.Lost) == [events.Lost(30 * MS, 2, "did not join in time", 30)]
    assert START_PATIENCE_S <= run.now_s < START_PATIENCE_S + 1.0
    assert run.robots[1].lost() == [(2, 30)]


def test_a_process_that_does_not_hear_its_neighbours_again_is_lost(hosted):
    run = hosted(RESTART)
    run.robots[2].at[0] = lambda: setattr(run.robots[2], "deaf", (Brief,))
    assert run.run() == COMPLETED
    assert run.bus.told(events.Lost) == [
        events.Lost(30 * MS, 2, "did not meet its neighbours in time", 30)
    ]
    assert run.waits()[0] == (30, "meet its neighbours", (2,))


def test_one_that_is_lost_while_another_comes_back_holds_up_nobody(hosted):
    run = hosted(RESTART)
    run.robots[1].deaf = (Meet,)
    run.robots[2].at[0] = lambda: setattr(run.robots[2], "late_s", 0.5)
    run.bus.mailbox.after(0.8, run.robots[1].end)
    assert run.run() == COMPLETED
    assert [(e.robot, e.reason) for e in run.bus.told(events.Lost)] == [(1, VANISHED)]
    assert run.ticks(2)[-1] == 50


def test_who_comes_back_is_told_whom_the_others_have_lost(hosted):
    run = hosted(RESTART)
    run.robots[4].at[25] = run.robots[4].end
    assert run.run() == COMPLETED
    assert run.robots[2].lost() == [(4, 25)]


# --- paused and resumed ---------------------------------------------------------------


def test_a_paused_robot_is_not_asked(hosted):
    run = hosted(RESUME)
    assert run.run() == COMPLETED
    assert [(e.name, e.t_ns // MS) for e in run.bus.told(events.Planned)] == [
        ("pause", 20),
        ("resume", 30),
    ]
    assert run.ticks(2) == [*range(20), *range(30, 51)]
    assert run.waits() == []
    assert not run.bus.told(Stir)


LONG = (
    "clock.broadcast_period_s=0.001",
    "duration_s=0.3",
    'timeline=[{at_s=0.01, action="pause", robots=[2]}]',
    "run.patience_s=3",
)


def test_a_long_paused_robot_takes_in_what_it_was_sent(hosted):
    """Two neighbours fill the network's buffers twice as fast as one."""
    run = hosted(*LONG)
    assert run.run() == Outcome("completed", 300 * MS, None, "")
    assert CatchUp(2, 259) in run.robots[2].heard
    assert run.bus.told(Stir) == [Stir((2,), True), Stir((2,), False), Stir((2,), True)]


def test_who_does_not_catch_up_is_lost(hosted):
    run = hosted(*LONG)
    run.robots[2].deaf = (CatchUp,)
    assert run.run() == Outcome("completed", 300 * MS, None, "")
    assert run.waits()[0] == (260, "catch up", (2,))
    assert run.bus.told(events.Lost) == [events.Lost(260 * MS, 2, "did not catch up in time", 261)]
    assert run.bus.told(Stir) == [Stir((2,), True), Stir((), False)]


def test_a_paused_robot_that_is_killed_runs_to_say_its_last(hosted):
    pause = '{at_s=0.01, action="pause", robots=[2]}, {at_s=0.02, action="kill", robots=[2]}'
    run = hosted(f"timeline=[{pause}]")
    assert run.run() == COMPLETED
    assert run.bus.told(Stir) == [Stir((2,), True)]
    assert End(2, KILL, 19) in run.robots[2].heard


# --- the end --------------------------------------------------------------------------


@pytest.mark.parametrize(("patience_s", "limit_s"), [(3.0, 3.0), (60.0, FAREWELL_S)])
def test_who_hands_in_no_last_report_is_named(hosted, patience_s, limit_s):
    run = hosted(f"run.patience_s={patience_s}")
    run.robots[3].deaf = (End,)
    assert run.run() == COMPLETED
    assert run.bus.told(events.SilentAtTheEnd) == [events.SilentAtTheEnd(50 * MS, (3,))]
    assert run.waits() == [(50, "hand in a last report", (3,))]
    assert limit_s <= run.now_s < limit_s + 1.0


def test_whose_process_is_gone_is_not_waited_for_long_at_the_end(hosted):
    run = hosted()
    run.robots[3].deaf = (End,)
    run.robots[3].at[50] = lambda: run.bus.mailbox.after(0.1, run.robots[3].end)
    assert run.run() == COMPLETED
    assert run.bus.told(events.SilentAtTheEnd) == [events.SilentAtTheEnd(50 * MS, (3,))]
    assert run.now_s < 0.1 + 2 * HASTY_FAREWELL_S


def test_a_user_who_stops_it_does_not_wait_long(hosted):
    run = hosted()
    run.robots[3].deaf = (End,)
    run.robots[3].at[20] = run.plant.stop
    outcome = run.run()
    assert (outcome.kind, outcome.reason) == ("interrupted", "stopped by the user")
    assert run.now_s < 2 * HASTY_FAREWELL_S
    assert run.bus.told(events.Extremes)


def test_of_robots_that_fail_the_first_in_the_file_is_named(hosted):
    run = hosted()
    run.robots[4].silent_from = 20
    run.robots[4].at[20] = lambda: run.robots[4].say(Failed(4, "ValueError: no"))
    run.robots[2].at[20] = lambda: run.bus.mailbox.after(
        5e-7, lambda: run.robots[2].say(Failed(2, "ValueError: neither"))
    )
    assert run.run() == Outcome("failed", 20 * MS, 2, "ValueError: neither")


# --- strangers ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lie", "reason"),
    [
        (Drive(2, 20, 0.0, 0.0), "claims to be robot 2"),
        (Failed(2, "no"), "claims to be robot 2"),
        (Drive(3, 19, 0.0, 0.0), "unexpected drive of robot 3 for tick 19 "),
        (Links(3, [LinkRow(0, None, 2, 4, 0, "delivered")]), "tells fates on others' links"),
        (Links(3, [LinkRow(0, None, 9, 3, 0, "delivered")]), "tells fates on others' links"),
        (Rejected(3, 9, "malformed", 1), "tells of messages from nobody"),
    ],
    ids=str,
)
def test_what_a_robot_cannot_say_is_refused_and_changes_nothing(hosted, lie, reason):
    run = hosted()
    run.robots[3].at[20] = lambda: run.robots[3].say(lie)
    assert run.run() == COMPLETED
    (refused,) = run.bus.told(events.Rejected)
    assert (refused.robot, refused.source, refused.times) == ("plant", 3, 1)
    assert refused.reason.startswith(reason)
    assert not any(record.rows for record in run.bus.told(LinkRows))


def test_what_a_robot_tells_of_refused_messages_is_recorded(hosted):
    run = hosted()
    run.robots[3].at[20] = lambda: run.robots[3].say(Rejected(3, PLANT, "malformed", 4))
    assert run.run() == COMPLETED
    (refused,) = run.bus.told(events.Rejected)
    assert (refused.robot, refused.source, refused.times) == (3, "plant", 4)
