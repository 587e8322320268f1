"""formnet nemesis: schedules that heal, invariants that notice, shrinking that ends small."""

import json
import random
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from in_process import collected, formnet

from formnet.formation.briefing.resolving import resolve
from formnet.formation.records.events import Kill, Lost, Resume
from formnet.formation.scenario.loading import load
from formnet.lab.launch import inline
from formnet.lab.nemesis.consistency import inconsistencies
from formnet.lab.nemesis.schedule import draw, scheduled
from formnet.lab.nemesis.shrink import shrunk
from formnet.lab.nemesis.smallest import smallest
from formnet.lab.nemesis.trial import Trial, tried
from formnet.lab.runs.recording import Collected
from formnet.lab.work import nemesis as command
from formnet.netem.settings.timeline import NEVER

MS = 1_000_000
SEED = 11


# --- schedules --------------------------------------------------------------------------


@settings(max_examples=150)
@given(st.integers(0, 2**32), st.sampled_from(["section5-delay", "theorem2"]), st.data())
def test_any_part_of_a_schedule_is_one_and_leaves_nothing_broken(paper, seed, name, data):
    scenario = paper(name, "duration_s=8")
    episodes = draw(scenario, seed, 2.0)
    assert episodes == draw(scenario, seed, 2.0)
    assert all(0.0 <= episode.begin_s < episode.end_s <= 2.0 for episode in episodes)
    kept = [episode for episode in episodes if data.draw(st.booleans())]
    run = scheduled(scenario, seed, kept)  # valid, or it raises
    assert run.seed == seed
    assert len(run.timeline) == sum(len(episode.entries()) for episode in kept)
    healed_tick, roster = 2000, run.roster()
    for robot in run.ids:
        assert roster.up(robot, healed_tick)
        assert roster.next_down(robot, healed_tick) == NEVER
    plan = resolve(run)
    for source, destination in run.directed_links:
        link, timeline = plan.robot(destination).incoming(0)[source]
        while timeline.next_ns < NEVER:
            timeline.advance(timeline.next_ns)
        assert timeline.settings == run.link_settings(source, destination)
        before = link.send(8_000 * MS, 0, b"after all")
        assert not any(copy.fate == "lost: cut" for copy in before)


def test_schedules_use_everything_there_is(paper):
    scenario = paper("section5-delay")
    entries = [e.entries()[0] for seed in range(300) for e in draw(scenario, seed, 10.0)]
    assert {entry["action"] for entry in entries} == {
        "kill",
        "pause",
        "cut",
        "partition",
        "network",
        "ramp",
    }
    tables = {key for entry in entries if entry["action"] == "network" for key in entry}
    assert {"delay", "loss", "duplicate", "corrupt"} <= tables
    shapes = {entry["shape"] for entry in entries if entry["action"] == "partition"}
    assert shapes == {"halves", "isolate", "bridge"}  # on the ring, a ring parts nobody
    assert any(len(entry.get("robots", [])) == 5 for entry in entries)
    assert any(entry["at_s"] * 1e3 % 1 for entry in entries)  # between ticks, too


# --- invariants ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def record(root):
    """A run with a kill and losses."""
    file = root / "configs" / "paper" / "section5-delay.toml"
    scenario = load(
        file,
        [
            "duration_s=1.0",
            "network.default.loss.probability=0.1",
            'timeline=[{action="kill", at_s=0.3, robots=3, restart_after_s=0.2}, '
            '{action="pause", at_s=0.6, robots=1, resume_after_s=0.1}]',
        ],
    )
    return collected(scenario)


def tampered(record):
    copy = Collected(record.scenario)
    copy.samples, copy.link_rows = list(record.samples), list(record.link_rows)
    copy.events, copy.outcome = list(record.events), record.outcome
    return copy


def test_a_good_record_is_consistent(record):
    assert list(inconsistencies(record)) == []


def row_of(copy, **wanted):
    return next(
        k
        for k, row in enumerate(copy.link_rows)
        if all(getattr(row, name) == value for name, value in wanted.items())
    )


def drop_sample(copy):
    del copy.samples[77]


def swap_samples(copy):
    copy.samples[5], copy.samples[6] = copy.samples[6], copy.samples[5]


def drop_message(copy):
    del copy.link_rows[row_of(copy, source=1, destination=2, sequence=40)]


def double_message(copy):
    copy.link_rows.append(copy.link_rows[row_of(copy, source=1, destination=2, sequence=40)])


def dead_sender(copy):
    row = copy.link_rows[row_of(copy, source=3, destination=2, sequence=10)]
    copy.link_rows.append(row._replace(sequence=35, t_sent_ns=350 * MS, t_usable_ns=450 * MS))


def dead_receiver(copy):
    place = row_of(copy, source=2, destination=3, sequence=33)
    copy.link_rows[place] = copy.link_rows[place]._replace(fate="delivered", t_usable_ns=430 * MS)


def before_it_was_sent(copy):
    place = row_of(copy, fate="delivered")
    copy.link_rows[place] = copy.link_rows[place]._replace(t_usable_ns=-1)


def lost_and_usable(copy):
    place = row_of(copy, fate="lost: random")
    copy.link_rows[place] = copy.link_rows[place]._replace(t_usable_ns=900 * MS)


def wrong_instant(copy):
    copy.link_rows[9] = copy.link_rows[9]._replace(t_sent_ns=copy.link_rows[9].t_sent_ns + 1)


def no_kill(copy):
    copy.events = [event for event in copy.events if event.name != "kill"]


def another_kill(copy):
    copy.events.insert(-1, Kill(900 * MS, (2,)))


def resumed_for_nothing(copy):
    copy.events.insert(-1, Resume(900 * MS, (2,)))


def backwards(copy):
    places = [k for k, event in enumerate(copy.events) if event.name in ("pause", "resume")]
    a, b = places
    copy.events[a], copy.events[b] = copy.events[b], copy.events[a]


def no_end(copy):
    copy.events = [event for event in copy.events if event.name != "last tick"]


def lost(copy):
    copy.events.insert(-1, Lost(1000 * MS, 2, "its process is gone", 1001))


def with_motion(copy, what, **values):
    place = next(k for k, event in enumerate(copy.events) if event.name == "extremes")
    told = copy.events[place]
    copy.events[place] = replace(told, **{what: replace(getattr(told, what), **values)})


def no_extremes(copy):
    copy.events = [event for event in copy.events if event.name != "extremes"]


def slower(copy):
    with_motion(copy, "top_speed", speed_mps=1.0)


def turning_less(copy):
    with_motion(copy, "top_turn_rate", turn_rate_radps=0.01)


def further_apart(copy):
    with_motion(copy, "closest", distance_m=99.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (drop_sample, "samples: 504 instead of 505"),
        (swap_samples, "the first that differs is number 5"),
        (drop_message, "without any fate: 1→2 number 40"),
        (double_message, "with several fates: 1→2 number 40"),
        (dead_sender, "from a robot that was down or does not exist: 3→2 number 35"),
        (dead_receiver, "2→3 number 33: usable at 430000000 ns by a robot that was dead"),
        (before_it_was_sent, "at an impossible time"),
        (lost_and_usable, "lost: random, usable at 900000000 ns"),
        (wrong_instant, "at an impossible time"),
        (no_kill, r"planned and not happened: (300000000, 'kill', (3,))"),
        (another_kill, r"happened and not planned: (900000000, 'kill', (2,))"),
        (resumed_for_nothing, r"happened and not planned: (900000000, 'resume', (2,))"),
        (backwards, "events: pause at 600000000 ns after resume at 700000000 ns"),
        (no_end, "must begin with started and have one last tick"),
        (lost, "lost without a plan: robot 2 (its process is gone)"),
        (no_extremes, "motion: its extremes must be recorded once, and are 0 times"),
        (slower, "ns is above 1.0"),
        (turning_less, "motion: turn_rate_radps "),
        (further_apart, "closer than recorded: 99 m (robots 3 and 4, at "),
    ],
)
def test_what_is_wrong_with_a_record_is_named(record, change, words):
    copy = tampered(record)
    change(copy)
    found = list(inconsistencies(copy))
    assert any(words in problem for problem in found), found


# --- shrinking ------------------------------------------------------------------------------


@settings(max_examples=200)
@given(st.lists(st.integers(0, 30), unique=True, max_size=16), st.integers(0, 2**32))
def test_what_is_left_fails_and_needs_all_of_itself(items, seed):
    """Whatever decides what fails, monotone or not."""

    def fails(some):
        text = ",".join(map(str, some))
        return len(some) == len(items) or random.Random(f"{seed} {text}").random() < 0.3

    left = shrunk(items, fails)
    assert fails(left)
    for place in range(len(left)):
        assert not fails(left[:place] + left[place + 1 :])
    assert [item for item in items if item in left] == left


def test_two_that_fail_together_are_found_and_made_simpler():
    def fails(some):
        return any(n % 7 == 3 for n in some) and any(n % 7 == 5 for n in some)

    left = shrunk(range(100), fails, lambda n: n - 7 if n >= 7 else None)
    assert left == [3, 5]


def test_what_fails_without_anything_becomes_nothing():
    assert shrunk([1, 2, 3], lambda _: True) == []


# --- the whole ------------------------------------------------------------------------------


def trial(scenario, episodes, **settings):
    values = {"engine": "inline", "twice": False, "limit_s": 60.0, **settings}
    return Trial(scenario, SEED, episodes, **values)


@pytest.fixture
def chaos(paper):
    """A scenario and a schedule with kills and much else."""
    scenario = paper(
        "section5-delay",
        "duration_s=2.0",
        "expect={formation=true, formation_tolerance_m=1e6}",
    )
    seed = next(
        seed
        for seed in range(100)
        if [e.action["action"] for e in draw(scenario, seed, 0.5)].count("kill") >= 2
        and len(draw(scenario, seed, 0.5)) >= 6
    )
    return scenario, draw(scenario, seed, 0.5)


def test_a_run_under_a_schedule_is_well_twice(chaos):
    found = tried(trial(*chaos, twice=True), lambda: False)
    assert found.problems == []


def test_a_run_that_takes_too_long_has_hung(chaos):
    found = tried(trial(*chaos, limit_s=0.001), lambda: False)
    (problem,) = found.problems
    assert problem.startswith("did not end: within 0.001 s it came to t = ")


def test_a_planted_bug_is_found_and_shrunk_to_one_kill(chaos, monkeypatch):
    """The bug: what was in flight to a killed robot is forgotten."""
    original = inline._Run._report

    def forgetful(self, robot, last=None):
        if last != "lost: receiver down":
            original(self, robot, last)

    monkeypatch.setattr(inline._Run, "_report", forgetful)
    failing = trial(*chaos)
    found = tried(failing, lambda: False)
    assert any(problem.startswith("without any fate: ") for problem in found.problems)
    (left,) = smallest(failing, found, lambda: False)
    assert left.action["action"] == "kill"
    assert left.end_s - left.begin_s <= 0.02


def test_a_run_that_depends_on_anything_else_is_found(chaos, monkeypatch):
    """The bug: every other run begins with another robot."""
    original, count = inline._Run._start, iter(range(10**6))
    first = chaos[0].ids[0]

    def fickle(self, robot):
        if robot == first and next(count) % 2:
            self._world._states[first] = self._world._states[first]._replace(x_m=-3.6)
        original(self, robot)

    monkeypatch.setattr(inline._Run, "_start", fickle)
    found = tried(trial(chaos[0], [], twice=True), lambda: False)
    assert any(
        p.startswith("not deterministic: first at t = 0 s (tick 0), robot 1, x_m: ")
        for p in found.problems
    )


@pytest.mark.processes
def test_the_command_tries_all_seeds(root, tmp_path):
    code, said = formnet(
        "nemesis",
        root / "configs" / "paper" / "section5-delay.toml",
        "--inline",
        "--runs",
        4,
        "--seed",
        7,
        "--set",
        "duration_s=2.0",
        "--set",
        "expect={formation=true, formation_tolerance_m=1e6}",
        "--out",
        tmp_path / "out",
    )
    assert code == 0
    assert "4 runs, seeds 7 to 10 (" in said
    assert "1 of them run twice and compared: all end, are consistent and recover" in said
    told = json.loads((tmp_path / "out" / "nemesis.json").read_text())
    assert [run["seed"] for run in told] == [7, 8, 9, 10]
    assert [run["run_twice"] for run in told] == [False, False, False, True]
    assert len({run["trajectory_sha256"] for run in told}) == 4


@pytest.mark.processes
def test_results_that_cannot_be_written_are_told_after_the_summary(root, tmp_path, monkeypatch):
    def no_room(path, data):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(command.files, "write_new", no_room)
    code, said = formnet(
        "nemesis",
        root / "configs" / "paper" / "section5-delay.toml",
        "--inline",
        "--runs",
        1,
        "--set",
        "duration_s=0.5",
        "--set",
        "expect={formation=true, formation_tolerance_m=1e6}",
        "--out",
        tmp_path / "out",
    )
    assert code == 3
    assert "all end, are consistent and recover" in said
    assert f"{tmp_path / 'out' / 'nemesis.json'}: No space left on device" in said


@pytest.mark.processes
def test_a_seed_that_fails_is_named_shrunk_and_kept(root, tmp_path):
    """Two seconds are too short for what is claimed, with failures and without."""
    scenario = str(root / "configs" / "paper" / "section5-delay.toml")
    code, said = formnet(
        "nemesis",
        scenario,
        "--inline",
        "--runs",
        1,
        "--seed",
        3,
        "--set",
        "duration_s=2.0",
        "--out",
        tmp_path / "out",
    )
    assert code == 1
    assert "seed 3 fails:" in said
    assert "does not converge after the healing, formation" in said
    assert (
        f"repeat it: formnet nemesis {scenario} --set duration_s=2.0 --inline --limit 600 "
        "--runs 1 --seed 3" in said
    )
    assert "(none: it fails without episodes)" in said
    assert "1 fail: seeds 3" in said
    place = tmp_path / "out" / "seed-3"
    assert "does not converge" in (place / "problems.txt").read_text()
    assert load(place / "shrunk.toml").timeline == []
    assert (
        load(place / "drawn.toml").timeline
        == scheduled(
            load(Path(scenario), ["duration_s=2.0"]),
            3,
            draw(load(Path(scenario), ["duration_s=2.0"]), 3, 0.5),
        ).timeline
    )


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ('timeline=[{action="kill", at_s=1.0, robots=1}]', "timeline: must be empty"),
        ('run.on_unscheduled_loss="abort"', 'must be "continue"'),
        ("formation.edges=[]", "formation.edges = []: needs an edge"),
        ("expect={}", "expect: must claim formation, heading or centroid"),
        ("law.beta=-1", "law.beta = -1"),
    ],
)
def test_a_scenario_that_is_none_for_it_is_refused(root, override, words):
    file = root / "configs" / "paper" / "section5-delay.toml"
    code, said = formnet("nemesis", file, "--set", override)
    assert code == 2
    assert words in said


@pytest.mark.processes
def test_distributed_runs_are_compared_with_inline_ones(paper):
    scenario = paper(
        "section5-delay",
        "duration_s=1.0",
        "clock.control_period_s=0.005",
        "expect={formation=true, formation_tolerance_m=1e6}",
    )
    episodes = draw(scenario, 4, 0.25)
    assert {"kill", "pause"} <= {e.action["action"] for e in episodes}
    found = tried(trial(scenario, episodes, engine="distributed", twice=True), lambda: False)
    assert found.problems == []
