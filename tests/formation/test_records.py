"""Records: every bit survives as bytes and as lines, and nothing that is no record gets in."""

import io
import json
import math
import struct
import sys
import typing
from dataclasses import FrozenInstanceError, dataclass, fields, is_dataclass
from datetime import UTC, datetime

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from formnet.formation.briefing.resolving import resolve
from formnet.formation.records import events, stream, watching
from formnet.formation.records.checked import Count, Malformed, Nanoseconds, RobotId
from formnet.formation.records.events import EVENTS, Event, Severity
from formnet.formation.records.outcome import OUTCOMES, Outcome
from formnet.formation.records.rows import LinkRow, LinkRows, Sample, Samples
from formnet.formation.records.stream import Stir
from formnet.formation.scenario.loading import dumps
from formnet.lab.launch.launch import Launch, LocalChild
from formnet.lab.runs.events_file import EVENTS as EVENTS_FILE
from formnet.lab.runs.events_file import Line, parsed, read_events, written
from formnet.lab.scene import foxglove, scene
from formnet.lab.watch.monitor import Feed, NoRun
from formnet.netem.core.transit import FATES

ROBOTS = [3, 1, 7]
NOW = datetime(2026, 1, 31, tzinfo=UTC)

int64 = st.integers(-(2**63), 2**63 - 1)
nanoseconds = st.integers(0, 10**15)  # what a double of seconds holds exactly
finite = st.floats(allow_nan=False, allow_infinity=False)
texts = st.text("aZ09 -_\x00\x1f\x7f\né√\u2028\uffff\U0001f600<'\"", max_size=20)
robots = st.sampled_from(ROBOTS)


def values(kind):
    """What a field with this annotation may hold."""
    simple = {
        RobotId: robots,
        Nanoseconds: nanoseconds,
        Count: nanoseconds,
        int: int64,
        float: finite,
        str: texts,
        type(None): st.none(),
    }
    if kind in simple:
        return simple[kind]
    if is_dataclass(kind):
        hints = typing.get_type_hints(kind, include_extras=True)
        return st.builds(kind, **{item.name: values(hints[item.name]) for item in fields(kind)})
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Literal:
        return st.sampled_from(arguments)
    if origin is dict:
        return st.dictionaries(*map(values, arguments), max_size=3)
    if origin is tuple and arguments[-1] is ...:
        return st.lists(values(arguments[0]), max_size=3, unique=True).map(tuple)
    if origin is tuple:
        return st.tuples(*map(values, arguments))
    return st.one_of(*map(values, arguments))


some_events = st.one_of(*map(values, EVENTS.values()))
outcomes = values(Outcome)
lines = some_events | outcomes


def of_ticks(ticks):
    return Samples([Sample(t, robot, *row) for t, rows in ticks for robot, row in rows])


torques = st.none() | st.floats()
sample_rows = st.tuples(*[finite] * 5, torques, torques)
ticks = st.tuples(int64, st.tuples(*[st.tuples(st.just(robot), sample_rows) for robot in ROBOTS]))
link_rows = st.builds(
    LinkRow, int64, st.none() | int64, robots, robots, int64, st.sampled_from(sorted(FATES))
)
shown = st.one_of(
    st.lists(ticks, max_size=2).map(of_ticks),
    st.builds(LinkRows, st.lists(link_rows, max_size=3)),
    lines,
)
records = shown | values(Stir)


def bits(value):
    """``value`` with every float as its bytes, so that == tells -0.0 from 0.0 and knows NaN."""
    if isinstance(value, float):
        return struct.pack("<d", value)
    if is_dataclass(value):
        return [type(value), *(bits(getattr(value, item.name)) for item in fields(value))]
    if isinstance(value, tuple | list):
        return [bits(item) for item in value]
    if isinstance(value, dict):
        return [bits(item) for item in value.items()]
    return value


def same_records(found, expected):
    assert [type(item) for item in found] == [type(item) for item in expected]
    assert bits(found) == bits(expected)


# --- classes of events ----------------------------------------------------------------


@pytest.mark.parametrize("name", EVENTS)
def test_a_class_says_when_it_occurs_and_cannot_be_changed(name):
    kind = EVENTS[name]
    assert kind.name == name
    assert kind.__doc__.strip().endswith(".")
    assert not kind.__doc__.startswith(f"{kind.__name__}(")  # which dataclass would write
    with pytest.raises(FrozenInstanceError):
        kind.__new__(kind).t_ns = 1


def test_a_new_event_is_its_class_alone():
    """It is written, read, sent, and shown by everybody."""

    @dataclass(frozen=True)
    class Stuck(Event, name="stuck", severity=Severity.ERROR):
        """Wheels turn and the robot does not."""

        robot: RobotId
        slip_mps: float

    try:
        stuck = Stuck(5, robot=3, slip_mps=0.25)
        assert parsed(written(stuck, NOW).encode(), ROBOTS).record == stuck
        assert stream.unpack(stream.pack(stuck), ROBOTS) == stuck
        assert stuck.words == "robot 3; slip_mps 0.25"
        assert foxglove._LEVELS[stuck.severity] == 4
    finally:
        del EVENTS["stuck"]


def test_viewers_know_every_severity():
    assert set(foxglove._LEVELS) == set(scene._LEVELS) == set(Severity)


def test_how_severe_an_end_is():
    found = {kind: Outcome(kind, 0, None, "").severity for kind in OUTCOMES}
    assert found.pop("completed") is Severity.INFO
    assert found.pop("interrupted") is Severity.WARNING
    assert set(found.values()) == {Severity.ERROR}


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (events.Started(0, (1, 2)), "robots 1, 2"),
        (events.LastTick(0), ""),
        (events.Kill(0, (3,)), "robot 3"),
        (events.Waiting(0, "join", (1, 2)), "for join; robots 1, 2"),
        (events.Network(0, "cut 1→2"), "cut 1→2"),
        (events.Lost(0, 3, "its process is gone", 70), "robot 3; its process is gone; tick 70"),
        (
            events.Rejected(0, "plant", 2, "malformed", 4),
            "robot plant; source 2; malformed; times 4",
        ),
        (Outcome("completed", 0, None, ""), ""),
        (Outcome("failed", 0, 2, "ValueError: no"), "robot 2: ValueError: no"),
    ],
)
def test_events_in_words(event, words):
    assert event.words == words


# --- as lines -------------------------------------------------------------------------


@settings(max_examples=200)
@given(lines)
def test_a_line_is_read_as_it_was_written(record):
    line = written(record, NOW)
    found, wall = parsed(line.encode(), ROBOTS)
    assert type(found) is type(record)
    assert bits(found) == bits(record)
    assert datetime.fromisoformat(wall) == NOW
    assert list(json.loads(line)) == ["t_s", "event", *record.details, "wall"]


def test_a_line_has_the_keys_it_always_had():
    waiting = events.Waiting(1_500_000_000, "join", (2, 3))
    assert written(waiting, NOW) == (
        '{"t_s": 1.5, "event": "waiting", "for": "join", "robots": [2, 3], '
        '"wall": "2026-01-31T00:00:00.000+00:00"}\n'
    )
    timing = events.Timing(
        0,
        events.PlantTiming(events.Quantiles(0.1, 0.2, 0.3)),
        {1: events.RobotTiming(9, 1, None, None, None, -0.5, 0.25)},
    )
    assert timing.details == {
        "plant": {"woke_late_s": {"p50": 0.1, "p99": 0.2, "max": 0.3}},
        "robots": {
            "1": {
                "periods": 9,
                "missed": 1,
                "sense_to_drive_s": None,
                "woke_late_s": None,
                "transit_s": None,
                "clock_offset_s": -0.5,
                "clock_uncertainty_s": 0.25,
            }
        },
    }


def test_a_lost_robot_is_an_event_or_an_end():
    event = events.Lost(10**9, 3, "gone", 7)
    end = Outcome("lost", 10**9, 3, "gone")
    assert [parsed(written(one, NOW).encode(), ROBOTS).record for one in (event, end)] == [
        event,
        end,
    ]


LINE = {"t_s": 0.5, "event": "lost", "robot": 3, "reason": "r", "tick": 7, "wall": "2026-01-31"}
KILL = {"t_s": 0, "event": "kill", "wall": "2026-01-31"}
DEEP = "[" * 100_000


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (LINE | {"event": "found"}, "event: 'found': is none of started, last tick, "),
        (LINE | {"event": None}, "event: None: is none of "),
        (LINE | {"event": ["lost"]}, "event: ['lost']: is none of "),
        (LINE | {"t_s": -0.1}, "t_s: -0.1: must be a time in seconds"),
        (LINE | {"t_s": math.nan}, "t_s: nan: "),
        (LINE | {"t_s": math.inf}, "t_s: inf: "),
        (LINE | {"t_s": 1e300}, "t_s: 1e+300: "),
        (LINE | {"t_s": 10**400}, "t_s: 100000"),
        (LINE | {"t_s": True}, "t_s: True: "),
        (LINE | {"wall": "yesterday"}, "wall: 'yesterday': must be a time such as "),
        (LINE | {"wall": "2026-01-31\ud80012:00:00"}, "must be a time such as "),
        (LINE | {"wall": "2026-01-31\x1b12:00:00"}, "must be a time such as "),
        (LINE | {"wall": "2026-02-30T12:00:00Z"}, "must be a time such as "),
        (LINE | {"robot": 2}, "lost.robot: 2: no such robot (robots: 3, 1, 7)"),
        (LINE | {"robot": True}, "lost.robot: True: must be an integer of 64 bits"),
        (LINE | {"robot": 3.0}, "lost.robot: 3.0: must be an integer of 64 bits"),
        (LINE | {"reason": 5}, "lost.reason: 5: must be text"),
        (LINE | {"reason": "\ud800"}, "lost.reason: '\\ud800': must be text"),
        (LINE | {"tick": -1}, "lost.tick: -1: must be at least 0"),
        (LINE | {"tick": 2**63}, "lost.tick: 9223372036854775808: must be an integer of 64 bits"),
        (LINE | {"why": 1}, "lost: 'why': is none of robot, reason, tick"),
        (LINE | {"t_ns": 1}, "lost: 't_ns': is none of robot, reason, tick"),
        (LINE | {"event": "completed"}, "outcome: 'tick': is none of robot, reason"),
        ({"t_s": 0, "event": "kill", "wall": "2026-01-31"}, "kill: {}: robots is missing"),
        (KILL | {"robots": [1, 3, 1]}, "kill.robots: [1, 3, 1]: must name no robot twice"),
        (KILL | {"robots": [1, 2]}, "kill.robots[1]: 2: no such robot"),
        (KILL | {"robots": [1] * 340_000}, "'340000 entries': must have at most 3 entries"),
        ("[1]", "[1]: must be a table"),
        ("{", "b'{': is not JSON"),
        ("\xff", "is not JSON"),
        (DEEP, "is not JSON"),
        (f'{{"t_s": {"9" * 5000}}}', "is not JSON"),
    ],
    ids=str,
)
def test_a_line_that_is_none_is_refused_with_place_value_and_rule(line, words):
    data = line if isinstance(line, str) else json.dumps(line)
    with pytest.raises(Malformed) as error:
        parsed(data.encode("latin-1"), ROBOTS)
    assert words in str(error.value)


def test_a_file_is_read_up_to_a_bad_line_whose_number_is_told(tmp_path):
    good = written(events.LastTick(0), NOW)
    (tmp_path / EVENTS_FILE).write_text(good + "{}\n" + good)
    found = read_events(tmp_path, ROBOTS)
    assert next(found) == Line(events.LastTick(0), NOW.isoformat(timespec="milliseconds"))
    with pytest.raises(Malformed, match=r"^line 2: t_s: None: must be a time in seconds$"):
        next(found)


hostile = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(st.characters(), max_size=5),
    st.just("\ud800"),
    st.just(10**400),
    st.lists(st.integers(-1, 9) | st.none(), max_size=3),
    st.dictionaries(st.sampled_from(["1", "9", "-1", "", "t_ns", "p50", "robot"]), st.integers()),
)


def places(value, way=()):
    """The way to every value in ``value``."""
    yield way
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from places(item, (*way, key))


def put(value, way, other):
    """A copy of ``value`` with another value at the end of ``way``."""
    if not way:
        return other
    copy = value.copy()
    copy[way[0]] = put(value[way[0]], way[1:], other)
    return copy


def damaged(data, draw):
    """``data`` with a value exchanged, a key added or one taken away, somewhere."""
    way = draw(st.sampled_from(sorted(places(data), key=repr)))
    here = data
    for key in way:
        here = here[key]
    if isinstance(here, dict) and draw(st.booleans()):
        key = draw(st.sampled_from(["what", "robot", "robots", "t_ns", *here]))
        other = {name: item for name, item in here.items() if name != key}
        return put(data, way, other if key in here else here | {key: draw(hostile)})
    return put(data, way, draw(hostile))


def refused_or_usable(line):
    """What is read can be shown, written and sent by whoever does; and so can the refusal."""
    try:
        record = parsed(line, ROBOTS).record
    except Malformed as error:
        print(str(error).encode())
        return
    assert isinstance(f"{record.name}: {record.words}".encode(), bytes)
    assert stream.unpack(stream.pack(record), ROBOTS) == record
    assert parsed(written(record, NOW).encode(), ROBOTS).record.details == record.details


@settings(max_examples=500)
@given(lines, st.data())
def test_a_damaged_line_is_refused_or_can_be_worked_with(record, data):
    line = json.dumps(damaged(json.loads(written(record, NOW)), data.draw))
    refused_or_usable(line.encode())


@settings(max_examples=300)
@given(lines, st.data())
def test_a_line_with_wrong_bytes_is_refused_or_can_be_worked_with(record, data):
    line = bytearray(written(record, NOW).encode())
    for _ in range(data.draw(st.integers(1, 4))):
        line[data.draw(st.integers(0, len(line) - 1))] = data.draw(st.integers(0, 255))
    refused_or_usable(bytes(line))


# --- as a stream ----------------------------------------------------------------------


def streamed(items):
    """The bytes of ``items`` and where each of them ends."""
    raw, ends = io.BytesIO(), []
    write = stream.writer(raw)
    for item in items:
        write(item)
        ends.append(raw.tell())
    return raw.getvalue(), ends


@given(st.lists(records, max_size=6))
def test_records_are_read_as_they_were_written(items):
    data, _ = streamed(items)
    found = list(stream.read(io.BytesIO(data), ROBOTS))
    same_records(found, items)
    for item in found:
        if isinstance(item, Samples | LinkRows):
            row = Sample if isinstance(item, Samples) else LinkRow
            assert all(type(entry) is row for entry in item.rows)


RECORDS = [
    events.Waiting(0, "ünï", (3, 1)),
    Samples([Sample(0, robot, 0.1, -0.0, 5e-324, 1.0, 2.0, None, None) for robot in ROBOTS]),
    LinkRows([LinkRow(0, 10, 1, 3, 0, "delivered"), LinkRow(0, None, 3, 1, 0, "lost: random")]),
    Samples([]),
    Samples([Sample(10, r, 0.0, 0.0, 0.0, 1.0, 2.0, math.inf, math.nan) for r in ROBOTS] * 2),
    Outcome("diverged", 10, 1, "state is not finite"),
]


def test_stream_cut_at_any_byte_yields_the_records_before_the_cut():
    data, ends = streamed(RECORDS)
    for cut in range(len(data) + 1):
        whole = sum(end <= cut for end in ends)
        same_records(list(stream.read(io.BytesIO(data[:cut]), ROBOTS)), RECORDS[:whole])


class Drip(io.BytesIO):
    """A stream that hands out a few bytes at a time, as a pipe may."""

    def read1(self, size=-1):
        return super().read1(3)


def test_stream_that_comes_in_drips_yields_the_same():
    same_records(list(stream.read(Drip(streamed(RECORDS)[0]), ROBOTS)), RECORDS)


def test_every_record_is_out_at_once():
    """What was sent before a process was killed can be read."""
    raw = io.BytesIO()
    write = stream.writer(io.BufferedWriter(raw, 2**20))
    for count, item in enumerate(RECORDS, start=1):
        write(item)
        same_records(list(stream.read(io.BytesIO(raw.getvalue()), ROBOTS)), RECORDS[:count])


class Live:
    """A pipe whose writer lives on: after what is there, a further read would block."""

    def __init__(self, data):
        self._chunks = iter([data])

    def read1(self, size=-1):
        return next(self._chunks)


def test_records_can_be_taken_while_the_writer_lives_on():
    data, ends = streamed(RECORDS)
    reader = stream.read(Live(data[: ends[1] + 1]), ROBOTS)
    same_records([next(reader), next(reader)], RECORDS[:2])


SAMPLE = [0, 3, 0.0, 0.0, 0.0, 0.0, 0.0, None, None]
LINK = [0, None, 1, 3, 0, "delivered"]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (["Nothing", 1], "is none of Samples, LinkRows, Event, Outcome, Stir"),
        ([], "is none of Samples"),
        (5, "is none of Samples"),
        (["Samples", [SAMPLE]], "must be of whole ticks"),
        (["Samples", [[0, 1, *SAMPLE[2:]]]], "must be in whole ticks, robots in their order"),
        (["Samples", [SAMPLE, [1, 1, *SAMPLE[2:]]]], "must be in whole ticks"),
        (["Samples", [SAMPLE[:-1]]], "must be t_ns, robot, x_m, "),
        (["Samples", [[0, 3, math.nan, *SAMPLE[3:]]]], "a finite state"),
        (["Samples", [[2**63, *SAMPLE[1:]]]], "a time of 64 bits"),
        (["Samples", ["x"]], "must be t_ns, robot, x_m, "),
        (["LinkRows", [[0, None, 1, 2, 0, "delivered"]]], "must be of the scenario's robots"),
        (["LinkRows", [[*LINK[:-1], "eaten"]]], "the fate must be one of corrupted, "),
        (["LinkRows", [[0, 2**64 - 1, *LINK[2:]]]], "must have integers of 64 bits"),
        (["LinkRows", [[0, 0.5, *LINK[2:]]]], "must be t_sent_ns, t_usable_ns, "),
        (["Event", "nothing", 0, {}], "event: 'nothing': is none of started, "),
        (["Event", "last tick", -1, {}], "last tick.t_ns: -1: must be at least 0"),
        (["Event", "last tick", 0, []], "last tick: []: must be a table"),
        (["Outcome", "won", 0, {"robot": None, "reason": ""}], "must be one of completed, "),
        (["Outcome", "lost", 0, {"robot": 2, "reason": ""}], "outcome.robot: 2: no such robot"),
        (["Stir", {"robots": [2], "running": True}], "Stir.robots[0]: 2: no such robot"),
        (["Stir", {"robots": [1], "running": 1}], "Stir.running: 1: must be true or false"),
    ],
    ids=str,
)
def test_what_is_no_record_is_refused_with_the_reason(fields, words):
    data = msgpack.packb(fields)
    for reading in (
        lambda: stream.unpack(data, ROBOTS),
        lambda: list(stream.read(io.BytesIO(data), ROBOTS)),
    ):
        with pytest.raises(Malformed) as error:
            reading()
        assert words in str(error.value)


@settings(max_examples=500)
@given(records, st.data())
def test_damaged_records_raise_nothing_but_malformed(record, data):
    packed = bytearray(stream.pack(record))
    for _ in range(data.draw(st.integers(1, 4))):
        packed[data.draw(st.integers(0, len(packed) - 1))] = data.draw(st.integers(0, 255))
    for reading in (
        lambda: stream.unpack(bytes(packed), ROBOTS),
        lambda: list(stream.read(io.BytesIO(bytes(packed)), ROBOTS)),
        lambda: watching.unpack_shown(bytes(packed), ROBOTS),
        lambda: watching.unpack_numbered(bytes(packed), ROBOTS),
        lambda: watching.unpack_history(bytes(packed)),
    ):
        try:
            reading()
        except Malformed as error:
            print(str(error).encode())


@given(st.integers(0, 2**63 - 1), shown)
def test_what_is_on_the_bus_is_read_as_it_was_sent(number, record):
    sent = watching.pack_numbered(number, stream.pack(record))
    again, found = watching.unpack_numbered(sent, ROBOTS)
    assert again == number
    same_records([found], [record])


def test_a_history_is_read_as_it_was_sent():
    history = watching.History("toml", [b"1", b""], 7)
    assert watching.unpack_history(watching.pack_history(history)) == history


@pytest.mark.parametrize(
    "data",
    [
        msgpack.packb(["toml", [b"1"], -1]),
        msgpack.packb(["toml", ["1"], 1]),
        msgpack.packb([b"toml", [b"1"], 1]),
        msgpack.packb([True, stream.pack(events.LastTick(0))]),
        msgpack.packb([-1, stream.pack(events.LastTick(0))]),
        msgpack.packb([1, stream.pack(Stir((1,), True))]),
        msgpack.packb([1, b"\xc1"]),
        msgpack.packb([[]] * 3),
        b"\x91" * 2000,
        b"\xc1",
        b"",
    ],
    ids=lambda data: data[:6].hex() or "empty",
)
def test_what_a_plant_never_sends_is_refused(data):
    for unpack in (watching.unpack_history, lambda some: watching.unpack_numbered(some, ROBOTS)):
        with pytest.raises(Malformed):
            unpack(data)


# --- who reads them -------------------------------------------------------------------


class Bus:
    """As much of a session as a feed needs; ``answers`` are what its question gets."""

    def __init__(self, *answers):
        self._answers = answers

    def declare_subscriber(self, key, handler, **_):
        if key.endswith("/watch"):
            self.say = lambda data: handler(Message(data))

    def liveliness(self):
        return self

    def get(self, *_, **__):
        return [Message(data) for data in self._answers]


class Message:
    """A sample, or the reply to a question."""

    def __init__(self, data):
        self._data = data

    @property
    def ok(self):
        return self

    @property
    def payload(self):
        return self

    def to_bytes(self):
        return self._data


def test_a_watcher_leaves_out_and_counts_what_is_no_record(paper):
    scenario = paper("section5")
    told = [stream.pack(events.Started(0, (1, 2))), b"\xc1", stream.pack(events.Started(0, (99,)))]
    answer = watching.pack_history(watching.History(dumps(scenario), told, 4))
    bus = Bus(b"\xc1", answer)
    feed = Feed(bus, "run")
    end = Outcome("completed", 1, None, "")
    for data in (b"lie", msgpack.packb([5, b"lie"]), msgpack.packb([4, stream.pack(end)])):
        bus.say(data)
    assert list(feed.take()) == [events.Started(0, (1, 2)), end]
    assert feed.refused.total() == 5
    assert feed.missed == 0


def test_a_watcher_of_which_nobody_understands_the_question_says_so(monkeypatch):
    monkeypatch.setattr("formnet.lab.watch.monitor._SEARCH_S", 0.01)
    with pytest.raises(NoRun, match=r"a reply was rejected: message: .*: is not msgpack"):
        Feed(Bus(b"\xc1x"), "run")


@pytest.mark.processes
def test_a_plant_that_says_what_is_no_record_ends_the_run_and_is_named(
    paper, monkeypatch, tmp_path
):
    says = "import sys; sys.stdout.buffer.write(b'\\xc1'); sys.stdout.flush(); sys.stdin.read()"

    def spawn(_self, name, _arguments):
        (tmp_path / f"{name}.log").touch()
        pipe = -1  # subprocess.PIPE
        return LocalChild([sys.executable, "-c", says], stdin=pipe, stdout=pipe)

    monkeypatch.setattr(Launch, "_spawn", spawn)
    records = []
    launch = Launch(resolve(paper("theorem4")), "run", records.append, tmp_path)
    outcome = launch.wait(lambda: False)
    assert records == [outcome]
    assert outcome.kind == "broken"
    assert "the plant sent an invalid record (record: b'\\xc1': is not msgpack: " in outcome.reason
