"""The run folder and the verdict: windows, settling, claims, hashes, and files anyone can read."""

import hashlib
import json
import math
import struct
from datetime import datetime

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from verdicts import made

from formnet.formation.briefing.resolving import resolve
from formnet.formation.paper.geometry import Errors
from formnet.formation.records import events
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.rows import LinkRow, LinkRows, Sample, Samples
from formnet.formation.scenario.expect import CRITERIA, ERRORS, Expect
from formnet.formation.scenario.loading import load
from formnet.formation.wire.messages import Rejected
from formnet.lab.judge.errors import settling_time, window_s
from formnet.lab.launch.inline import Inline
from formnet.lab.runs.folders import RunExists
from formnet.lab.runs.recording import Recording, trajectory_sha256
from formnet.lab.verdict import model
from formnet.lab.verdict.files import text

MS = 1_000_000
S = 1_000_000_000


def rows_at(scenario, t_ns, *, heading=0.0, shift=0.0, torque=1.0):
    """The formation at ``t_ns``; robot 1's heading is off by ``heading`` rad and all are off by
    ``shift`` m, so Eq. 3's error is 0, Eq. 4's ``heading`` and Eq. 5's n times ``shift``."""
    return [
        Sample(t_ns, robot, x + shift, y, heading * (robot == 1), 0.5, 0.25, torque, torque)
        for robot, (x, y) in zip(scenario.ids, scenario.offsets_m.tolist(), strict=True)
    ]


def recorded(folder, scenario, samples, kind="completed", *, t_ns=None, robot=None, reason=""):
    """A recording of ``samples`` that ended with ``kind`` at its last instant, or at ``t_ns``."""
    recording = Recording(folder, scenario)
    recording(Samples(samples))
    end_ns = (samples[-1].t_ns if samples else 0) if t_ns is None else t_ns
    recording(Outcome(kind, end_ns, robot, reason))
    return recording


def judge(recording, wall_s=2.0):
    """The verdict, which must be JSON without NaN whatever the run was."""
    judged = model.judge(recording, mode="inline", wall_s=wall_s)
    assert json.loads(text(judged)) == judged.model_dump()
    return judged


def trial(folder, scenario, series, kind="completed", **changes):
    """Judge a run in which ``series`` holds (t_ns, changes of :func:`rows_at`)."""
    samples = [row for t_ns, how in series for row in rows_at(scenario, t_ns, **how)]
    return judge(recorded(folder, scenario, samples, kind, **changes))


KILL_ALL = 'timeline=[{action="kill", at_s=1.0, robots="*"}]'

# --- settling -------------------------------------------------------------------------

TOLERANCES = {"formation": 1.0, "heading": 0.5, "centroid": 2.0}


def settled(values, claim="formation"):
    return settling_time(
        np.arange(len(values)) * 0.5, {claim: np.array(values, dtype=float)}, TOLERANCES
    )


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([0, 0, 0], 0.0),
        ([5, 4, 1, 0], 1.0),  # on the tolerance is within it
        ([5, 0, 5, 0, 0], 1.5),
        ([0, 0, 5], None),
        ([5, 5, 0], 1.0),
        ([1.0000001, 1.0], 0.5),
        ([0], 0.0),
        ([5], None),
        ([], None),
        ([math.nan, 0.0], 0.5),
        ([0.0, math.nan], None),
        ([math.inf, 0.5], 0.5),
    ],
)
def test_settling_time_is_when_the_error_entered_its_tolerance_for_good(values, expected):
    assert settled(values) == expected


def test_settling_takes_the_last_of_the_claims_to_settle():
    t_s = np.array([0.0, 1.0, 2.0, 3.0])
    series = {"formation": np.array([9.0, 0, 0, 0]), "heading": np.array([9.0, 9.0, 0, 0])}
    assert settling_time(t_s, series, TOLERANCES) == 2.0
    series["centroid"] = np.array([0.0, 0, 0, 3.0])
    assert settling_time(t_s, series, TOLERANCES) is None
    assert settling_time(t_s, {}, TOLERANCES) == 0.0


errors = st.one_of(st.floats(0.0, 2.0), st.sampled_from([1.0, math.nan, math.inf]))


@given(st.lists(st.tuples(errors, errors), max_size=12))
def test_settling_time_against_its_definition(pairs):
    t_s = np.arange(len(pairs)) * 0.1
    formation, centroid = ([pair[i] for pair in pairs] for i in (0, 1))
    found = settling_time(
        t_s, {"formation": np.array(formation), "centroid": np.array(centroid)}, TOLERANCES
    )
    within = [f <= 1.0 and c <= 2.0 for f, c in pairs]
    expected = [float(t_s[k]) for k in range(len(pairs)) if all(within[k:])]
    assert found == (expected[0] if expected else None)


def test_settling_is_judged_on_the_claims_expected_true(tmp_path, paper):
    """Theorem 1 does not expect the centroid to come home, so it does not hold settling up."""
    series = [(0, {"heading": 0.1, "shift": 9.0}), (S, {"shift": 9.0}), (2 * S, {"shift": 9.0})]
    judged = trial(tmp_path / "a", paper("theorem1", "duration_s=2.0"), series)
    assert judged.settling_time_s == 1.0
    every = trial(tmp_path / "b", paper("theorem2", "duration_s=2.0"), series)
    assert every.settling_time_s is None


# --- the window -----------------------------------------------------------------------


def test_error_before_the_window_does_not_count(tmp_path, paper):
    scenario = paper("theorem4", "duration_s=10.0", "expect.window_s=2.0")
    series = [(0, {"heading": 3.0}), (8 * S - 10 * MS, {"heading": 0.3}), (8 * S, {}), (10 * S, {})]
    judged = trial(tmp_path / "run", scenario, series)
    assert judged.window_s == 2.0
    assert judged.claims["heading"].observed is True
    assert judged.claims["heading"].largest_in_window == pytest.approx(0.0)
    assert judged.settling_time_s == 8.0


@pytest.mark.parametrize("bad_ns", [8 * S, 9 * S, 10 * S])
def test_error_anywhere_in_the_window_counts(tmp_path, paper, bad_ns):
    scenario = paper("theorem4", "duration_s=10.0", "expect.window_s=2.0")
    instants = [0, 8 * S, 9 * S, 10 * S]
    series = [(t_ns, {"heading": 0.3} if t_ns == bad_ns else {}) for t_ns in instants]
    judged = trial(tmp_path / "run", scenario, series)
    assert judged.claims["heading"].observed is False
    assert judged.claims["heading"].holds is False
    assert judged.claims["heading"].largest_in_window == pytest.approx(0.3)
    assert judged.claims["formation"].observed is True
    assert judged.claims["centroid"].observed is True


def test_window_begins_exactly_where_it_should_for_every_duration(tmp_path, paper):
    """The default window is a tenth of the run; the sample at its first instant belongs to it,
    and the one before does not. Durations 0.1 s to 6 s."""
    missed, taken = [], []
    for tenths in range(1, 61):
        end_ns, start_ns = tenths * 100 * MS, tenths * 90 * MS
        scenario = paper("theorem4", f"duration_s={tenths / 10}")
        for name, bad_ns, wrong in (("at", start_ns, missed), ("by", start_ns - 1, taken)):
            series = [(bad_ns, {"heading": 0.3}), (end_ns, {})]
            judged = trial(tmp_path / f"{tenths}{name}", scenario, series)
            if judged.claims["heading"].observed is not (bad_ns < start_ns):
                wrong.append(tenths / 10)
    assert (missed, taken) == ([], [])


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        (["duration_s=40.0"], 4.0),
        (["duration_s=0.05"], 0.01),  # at least one broadcast period
        (["duration_s=40.0", "expect.window_s=0.25"], 0.25),
        (["duration_s=0.05", "expect.window_s=0.001"], 0.001),
    ],
)
def test_length_of_the_window(paper, overrides, expected):
    assert window_s(paper("theorem4", *overrides)) == pytest.approx(expected)


def test_length_of_the_window_without_expect(paper):
    scenario = paper("theorem4", "duration_s=20.0").model_copy(update={"expect": None})
    assert window_s(scenario) == pytest.approx(2.0)


# --- claims ---------------------------------------------------------------------------


def test_expect_and_the_errors_have_a_field_for_every_row_of_the_table():
    fields = Expect.model_fields
    assert list(fields) == [
        *CRITERIA,
        *(row.tolerance_key for row in ERRORS.values()),
        "window_s",
    ]
    assert list(Errors._fields) == [f"{row.name}_{row.unit}" for row in ERRORS.values()]
    assert Expect(heading=False).claims == dict.fromkeys(CRITERIA) | {"heading": False}
    assert Expect(heading_tolerance_rad=0.5).tolerances == {
        name: 0.5 if name == "heading" else row.tolerance for name, row in ERRORS.items()
    }


def test_errors_at_the_end_are_eqs_3_to_5(tmp_path, paper):
    judged = trial(
        tmp_path / "run", paper("theorem4"), [(0, {}), (40 * S, {"heading": 0.3, "shift": 2.0})]
    )
    assert judged.formation_error_m == pytest.approx(0.0, abs=1e-9)
    assert judged.heading_error_rad == pytest.approx(0.3)
    assert judged.centroid_error_m == pytest.approx(5 * 2.0)


@pytest.mark.parametrize("expected", [True, False])
@pytest.mark.parametrize("home", [True, False])
def test_false_is_a_claim_too(tmp_path, paper, expected, home):
    scenario = paper("theorem4", f"expect.centroid={str(expected).lower()}")
    judged = trial(tmp_path / "run", scenario, [(40 * S, {"shift": 0.0 if home else 1.0})])
    claim = judged.claims["centroid"]
    assert claim.expected is expected
    assert claim.observed is home
    assert claim.holds is (expected == home)
    assert judged.passed is (expected == home)


def test_each_claim_has_its_own_tolerance(tmp_path, paper):
    scenario = paper(
        "theorem4", "expect.heading_tolerance_rad=0.4", "expect.centroid_tolerance_m=0.9"
    )
    judged = trial(tmp_path / "run", scenario, [(40 * S, {"heading": 0.3, "shift": 0.2})])
    assert {claim: judged.claims[claim].tolerance for claim in ERRORS} == {
        "formation": 0.05,
        "heading": 0.4,
        "centroid": 0.9,
    }
    assert judged.claims["heading"].observed is True
    assert judged.claims["centroid"].observed is False  # 5 × 0.2 m


@pytest.mark.parametrize("shift", [0.0, 1.0])
def test_without_expect_everything_is_observed_and_nothing_judged(tmp_path, paper, shift):
    scenario = paper("theorem4").model_copy(update={"expect": None})
    judged = trial(tmp_path / "run", scenario, [(0, {}), (40 * S, {"shift": shift})])
    assert {claim: entry.observed for claim, entry in judged.claims.items()} == {
        "formation": True,
        "heading": True,
        "centroid": shift == 0.0,
        "lyapunov": None,  # the estimates are wrong: a rise would not show
    }
    assert all(entry.expected is None for entry in judged.claims.values())
    assert all(entry.holds is None for entry in judged.claims.values())
    assert judged.passed
    assert judged.settling_time_s == (None if shift else 0.0)


def test_claim_that_is_not_made_is_not_judged(tmp_path, paper):
    scenario = paper("theorem4", "expect={heading=true}")
    judged = trial(tmp_path / "run", scenario, [(40 * S, {"shift": 9.0})])
    assert judged.claims["centroid"].holds is None
    assert judged.claims["heading"].holds is True
    assert judged.settling_time_s == 40.0
    assert judged.passed


def test_nobody_up_at_the_end_means_nothing_judged(tmp_path, paper):
    judged = trial(tmp_path / "run", paper("theorem4", KILL_ALL), [(40 * S, {})])
    assert {claim.observed for claim in judged.claims.values()} == {None}
    assert {claim.largest_in_window for claim in judged.claims.values()} == {None}
    assert (judged.settling_time_s, judged.formation_error_m) == (None, None)
    assert judged.standing == model.NOT_JUDGED
    assert not judged.passed


@pytest.mark.parametrize(
    ("kind", "lost", "passes"),
    [("completed", [], True), ("completed", [3], False), ("diverged", [], False)],
)
def test_without_claims_a_run_passes_that_completes_with_everybody(kind, lost, passes):
    assert made(kind=kind, lost=lost).passed is passes


# --- runs that did not complete -------------------------------------------------------


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e300])
def test_diverged_run_fails_every_claim_and_its_verdict_is_json(tmp_path, paper, value):
    scenario = paper("theorem4")
    bad = [row._replace(x_m=value, heading_rad=value) for row in rows_at(scenario, S)]
    samples = [*rows_at(scenario, 0), *bad]
    with np.errstate(all="ignore"):
        judged = judge(
            recorded(
                tmp_path / "run",
                scenario,
                samples,
                "diverged",
                robot=3,
                reason="state is not finite",
            )
        )
    assert judged.outcome.model_dump() == {
        "kind": "diverged",
        "t_s": 1.0,
        "robot": 3,
        "reason": "state is not finite",
    }
    for entry in judged.claims.values():
        assert entry.observed is False
        assert entry.holds is (None if entry.expected is None else False)
    assert judged.settling_time_s is None
    assert not judged.passed


def test_run_that_diverged_within_its_tolerances_fails_all_the_same(tmp_path, paper):
    judged = trial(tmp_path / "run", paper("theorem4"), [(0, {}), (S, {})], "diverged")
    assert [entry.observed for entry in judged.claims.values()] == [False] * 4
    assert judged.claims["lyapunov"].largest_in_window is None  # no rise was measured
    assert judged.settling_time_s is None


def test_error_that_is_not_finite_in_a_completed_run_is_outside(tmp_path, paper):
    scenario = paper("theorem4")
    samples = [row._replace(heading_rad=math.nan) for row in rows_at(scenario, 40 * S)]
    judged = judge(recorded(tmp_path / "run", scenario, samples))
    assert judged.heading_error_rad is None
    assert judged.claims["heading"].observed is False
    assert judged.claims["heading"].largest_in_window is None
    assert judged.claims["formation"].observed is True


@pytest.mark.parametrize("kind", ["interrupted", "lost", "failed", "broken"])
def test_run_that_was_cut_off_decides_nothing(tmp_path, paper, kind):
    judged = trial(tmp_path / "run", paper("theorem4"), [(0, {}), (7 * S, {})], kind)
    assert judged.outcome.kind == kind
    assert judged.simulated_s == 7.0
    for entry in judged.claims.values():
        assert entry.observed is None
        assert entry.holds is None
    assert judged.settling_time_s is None
    assert judged.formation_error_m == pytest.approx(0.0, abs=1e-9)


def test_run_that_was_cut_off_before_the_first_sample(tmp_path, paper):
    judged = judge(recorded(tmp_path / "run", paper("theorem4"), [], "interrupted"), wall_s=0.0)
    assert judged.formation_error_m is None
    assert judged.heading_error_rad is None
    assert judged.centroid_error_m is None
    assert judged.realtime_factor is None
    assert all(entry.largest_in_window is None for entry in judged.claims.values())
    assert judged.trajectory_sha256 == hashlib.sha256(b"").hexdigest()


# --- the rest of the verdict ----------------------------------------------------------


def test_verdict_says_what_was_run_and_how_fast(tmp_path, paper):
    scenario = paper("theorem6", "seed=17")
    judged = judge(recorded(tmp_path / "run", scenario, rows_at(scenario, 40 * S)), wall_s=8.0)
    assert judged.scenario == "theorem6"
    assert judged.mode == "inline"
    assert judged.seed == 17
    assert judged.theorem == 6
    assert (judged.simulated_s, judged.wall_s, judged.realtime_factor) == (40.0, 8.0, 5.0)
    assert judged.versions["numpy"] == np.__version__


def test_verdict_counts_messages_and_the_latest_refusals(tmp_path, paper):
    scenario = paper("theorem4")
    recording = recorded(tmp_path / "run", scenario, rows_at(scenario, 40 * S))
    delivered = [LinkRow(k, k, 1, 2, k, "delivered") for k in range(3)]
    recording(LinkRows([*delivered, LinkRow(3, None, 1, 2, 3, "lost: random")]))
    refused = [
        Rejected(1, 2, "replayed", 1),
        Rejected(1, 2, "replayed", 5),
        Rejected(1, 5, "malformed", 2),
    ]
    for item in refused:
        recording(events.Rejected(S, **item._asdict()))
    recording(events.Waiting(S, "join", (1,)))
    messages = judge(recording).messages
    assert messages.sent == 4
    assert messages.fates == {"delivered": 3, "lost: random": 1}
    assert [item.model_dump() for item in messages.rejected] == [
        item._asdict() for item in refused[1:]
    ]


# --- the hash -------------------------------------------------------------------------


def hash_of_file(path):
    """The hash as the docstring describes it, from the file alone."""
    digest = hashlib.sha256()
    table = pq.read_table(path)
    for row in zip(*(table[name].to_pylist() for name in table.column_names), strict=True):
        values = [math.nan if value is None else value for value in row[2:]]
        digest.update(struct.pack("<qq7d", *row[:2], *values))
    return digest.hexdigest()


@pytest.mark.parametrize("name", ["theorem1", "theorem4", "theorem5"])
def test_hash_of_a_run_can_be_computed_from_its_file(tmp_path, paper, name):
    """Of a real run of 50 ms: kinematic (no torques) and dynamic."""
    scenario = paper(name, "duration_s=0.05")
    hashes = []
    for folder in (tmp_path / "first", tmp_path / "second"):
        recording = Recording(folder, scenario)
        outcome = Inline().run(resolve(scenario), recording)
        assert outcome.kind == "completed"
        recording.save()
        hashes.append(judge(recording).trajectory_sha256)
        assert hash_of_file(folder / "states.parquet") == hashes[-1]
        assert len(recording.samples) == 5 * 6  # five robots, every broadcast period and the end
        assert len(recording.link_rows) == 10 * 6  # ten directed links
    assert hashes[0] == hashes[1]


def test_hash_tells_every_bit_of_every_sample(paper):
    samples = rows_at(paper("theorem4"), 10)
    hashes = {trajectory_sha256(samples)}
    for place in range(len(Sample._fields)):
        value = samples[2][place]
        other = value + 1 if place < 2 else math.nextafter(value, math.inf)
        changed = [*samples]
        changed[2] = Sample(*[other if i == place else v for i, v in enumerate(samples[2])])
        hashes.add(trajectory_sha256(changed))
    changed = [samples[0]._replace(heading_rad=-0.0), *samples[1:]]
    assert samples[0] == changed[0]
    hashes |= {trajectory_sha256(changed), trajectory_sha256(samples[:-1])}
    hashes |= {trajectory_sha256(samples[::-1]), trajectory_sha256([])}
    assert len(hashes) == len(Sample._fields) + 5


# --- the folder -----------------------------------------------------------------------


def test_recording_refuses_a_folder_that_is_not_empty(tmp_path, paper):
    note = tmp_path / "note"
    note.write_text("mine")
    with pytest.raises(RunExists, match=str(tmp_path)):
        Recording(tmp_path, paper("theorem4"))
    with pytest.raises(RunExists, match="note"):
        Recording(note, paper("theorem4"))
    assert [entry.name for entry in tmp_path.iterdir()] == ["note"]
    assert note.read_text() == "mine"


def test_recording_refuses_its_own_folder_the_second_time(tmp_path, paper):
    Recording(tmp_path / "run", paper("theorem4"))
    with pytest.raises(RunExists):
        Recording(tmp_path / "run", paper("theorem4"))


def test_recording_takes_an_empty_folder_and_makes_what_is_missing(tmp_path, paper):
    for folder in (tmp_path, tmp_path / "a" / "b"):
        recording = Recording(folder, paper("theorem4"))
        assert recording.folder == folder
        assert load(folder / "scenario.toml") == paper("theorem4")


def test_events_are_on_disk_at_once(tmp_path, paper):
    recording = Recording(tmp_path / "run", paper("theorem4"))
    path = tmp_path / "run" / "events.jsonl"
    recording(events.Waiting(1_500_000_000, "join", (2, 3)))
    (line,) = path.read_text(encoding="utf-8").splitlines()
    entry = json.loads(line)
    assert datetime.fromisoformat(entry.pop("wall")).tzinfo is not None
    assert entry == {"t_s": 1.5, "event": "waiting", "for": "join", "robots": [2, 3]}
    recording(Outcome("lost", 2_000_000_000, 3, "its process is gone"))
    entry = json.loads(path.read_text(encoding="utf-8").splitlines()[1])
    entry.pop("wall")
    assert entry == {"t_s": 2.0, "event": "lost", "robot": 3, "reason": "its process is gone"}


STATES = {
    "t_ns": pa.int64(),
    "robot": pa.int32(),
    "x_m": pa.float64(),
    "y_m": pa.float64(),
    "heading_rad": pa.float64(),
    "speed_mps": pa.float64(),
    "turn_rate_radps": pa.float64(),
    "torque_right_nm": pa.float64(),
    "torque_left_nm": pa.float64(),
}
LINKS = {
    "t_sent_ns": pa.int64(),
    "t_usable_ns": pa.int64(),
    "source": pa.int32(),
    "destination": pa.int32(),
    "sequence": pa.int64(),
    "fate": pa.string(),
}


def columns_of(table):
    """Names and types, in order; a dictionary counts as what it stands for."""
    return {
        field.name: field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        for field in table.schema
    }


def test_tables_hold_what_was_recorded(tmp_path, paper):
    scenario = paper("theorem4")
    samples = [
        Sample(10 * MS, 1, 0.1, -0.0, 5e-324, 1.0, 2.0, None, None),
        Sample(10 * MS, 2, math.inf, 1 / 3, -1e300, 1.0, 2.0, 3.0, -4.0),
    ]
    links = [
        LinkRow(20, 2**62, 2, 1, 2**40, "delivered"),
        LinkRow(10, None, 2, 1, 1, "lost: random"),
        LinkRow(10, 30, 1, 2, 1, "delivered"),
        LinkRow(10, 10, 2, 1, 0, "delivered"),
    ]
    recording = Recording(tmp_path / "run", scenario)
    recording(Samples(samples[:1]))
    recording(LinkRows(links[:2]))
    recording(Samples(samples[1:]))
    recording(LinkRows(links[2:]))
    recording.save()
    states = pq.read_table(tmp_path / "run" / "states.parquet")
    assert list(columns_of(states).items()) == list(STATES.items())
    assert [Sample(**row) for row in states.to_pylist()] == samples
    assert math.copysign(1.0, states["y_m"][0].as_py()) == -1.0
    found = pq.read_table(tmp_path / "run" / "links.parquet")
    assert list(columns_of(found).items()) == list(LINKS.items())
    assert [LinkRow(**row) for row in found.to_pylist()] == [links[i] for i in (2, 3, 1, 0)]


def test_empty_recording_is_saved_and_readable(tmp_path, paper):
    recording = recorded(tmp_path / "run", paper("theorem4"), [], "interrupted")
    recording.save()
    for name, columns in (("states", STATES), ("links", LINKS)):
        table = pq.read_table(tmp_path / "run" / f"{name}.parquet")
        assert table.num_rows == 0
        assert list(columns_of(table).items()) == list(columns.items())
    assert hash_of_file(tmp_path / "run" / "states.parquet") == trajectory_sha256([])
    assert recording.trajectories.states.shape == (0, 5, 5)
    assert len(recording.latest().t_s) == 0


def test_run_of_one_robot_has_no_links_and_is_saved(tmp_path, paper):
    lone = (
        "robots=[{id=7, offset_m=[0.0, 0.0], start={x_m=0.0, y_m=0.0}, damping=4.0}]",
        "formation.edges=[]",
        "duration_s=0.02",
    )
    scenario = paper("theorem4", *lone)
    recording = Recording(tmp_path / "run", scenario)
    assert Inline().run(resolve(scenario), recording).kind == "completed"
    recording.save()
    judge(recording)
    assert pq.read_table(tmp_path / "run" / "links.parquet").num_rows == 0
    assert pq.read_table(tmp_path / "run" / "states.parquet")["robot"].to_pylist() == [7, 7, 7]


def test_trajectories_are_arrays_in_the_order_of_the_file(tmp_path, paper):
    scenario = paper("theorem4")
    samples = rows_at(scenario, 0) + rows_at(scenario, 10 * MS, heading=0.5, torque=None)
    recording = recorded(tmp_path / "run", scenario, samples)
    for found, count in ((recording.trajectories, 2), (recording.latest(), 1)):
        assert found.t_ns.tolist() == [0, 10 * MS][-count:]
        assert found.states.shape == (count, 5, 5)
        np.testing.assert_array_equal(found.positions_m[-1], scenario.offsets_m)
        assert found.headings_rad[-1].tolist() == [0.5, 0.0, 0.0, 0.0, 0.0]
        assert np.isnan(found.torques_nm[-1]).all()
    assert (recording.trajectories.torques_nm[0] == 1.0).all()
