"""The process that writes run.rrd: what it is sent, and that nothing it does harms the run."""

import errno
import signal
import subprocess

import msgpack
import numpy as np
import pytest
from rerun.chunk import RrdReader

from formnet.formation.records.checked import Malformed
from formnet.formation.records.events import Started
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.rows import LinkRow, LinkRows, Sample, Samples
from formnet.formation.records.stream import Stir, pack
from formnet.formation.scenario.loading import dumps
from formnet.lab.judge.lyapunov import Curve
from formnet.lab.runs.recording import SCENARIO
from formnet.lab.scene import writer
from formnet.lab.scene.writer import FILE, Came, Lyapunov, Reader, SceneWriter, packed

ROBOTS = (1, 2)
SAMPLES = Samples([Sample(0, robot, 0.1, -0.0, 1e-300, 0.0, 0.0, None, 2.0) for robot in ROBOTS])
ITEMS = (
    Came(Started(0, ROBOTS), 1),
    Came(SAMPLES, 2**62),
    Came(LinkRows([LinkRow(0, None, 1, 2, 3, "lost: random")]), 3),
    Came(Outcome("broken", 5, None, "no such folder: b\\xe9d"), 4),
)


@pytest.mark.parametrize("size", [1, 7, 10**6])
def test_what_is_sent_is_read_in_pieces_of_any_size(size):
    v = Lyapunov(np.array([0.0, 0.1]), np.array([np.nan, 5e-324]))
    data = b"".join(map(packed, (*ITEMS, v)))
    reader = Reader(ROBOTS)
    pieces = (data[k : k + size] for k in range(0, len(data), size))
    *found, last = (item for piece in pieces for item in reader.take(piece))
    assert found == [*ITEMS]
    assert isinstance(last, Lyapunov)
    assert [x.tobytes() for x in last] == [x.tobytes() for x in v]


def test_what_is_no_text_is_escaped():
    (found,) = Reader(ROBOTS).take(packed(Came(Outcome("broken", 5, None, "b\udce9d"), 4)))
    assert found == Came(Outcome("broken", 5, None, "b\\udce9d"), 4)


@pytest.mark.parametrize(
    "data",
    [
        b"\xc1",
        msgpack.packb(7),
        msgpack.packb(["record", -1, pack(SAMPLES)]),
        msgpack.packb(["record", 1.0, pack(SAMPLES)]),
        msgpack.packb(["record", 1, pack(Stir(ROBOTS, True))]),
        msgpack.packb(["record", 1, b"\xc1"]),
        msgpack.packb(["lyapunov", bytes(8), bytes(16)]),
        msgpack.packb(["lyapunov", bytes(7), bytes(7)]),
    ],
)
def test_anything_else_is_refused(data):
    with pytest.raises(Malformed):
        list(Reader(ROBOTS).take(data))


# --- its process ---------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, paper):
    (tmp_path / SCENARIO).write_text(dumps(paper("section5", "duration_s=2.0")))
    return tmp_path


def samples(ticks):
    rows = [
        Sample(tick * 10**7, robot, float(tick), 0.0, 0.0, 0.0, 0.0, None, None)
        for tick in ticks
        for robot in range(1, 6)
    ]
    return Samples(rows)


def processes(made):
    """The processes of scenes that are made from now on."""

    class Noted(subprocess.Popen):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            made.append(self)

    return Noted


@pytest.mark.processes
def test_the_file_has_every_frame_and_v(folder):
    scene = SceneWriter(folder)
    scene.take(samples(range(100)))
    scene.take(samples(range(100, 201)))
    instants = np.arange(5.0)
    scene.end(Curve(instants, 10.0**-instants, instants, instants > 0.0))
    scene.close()
    scene.leave()  # once more does nothing
    rows = {"/field/robots": 0, "/lyapunov/v": 0}
    for chunk in RrdReader(str(folder / FILE)).stream():
        if chunk.entity_path in rows and "sim_time" in chunk.timeline_names:
            rows[chunk.entity_path] += chunk.to_record_batch().num_rows
    assert rows == {"/field/robots": 201, "/lyapunov/v": 5}


@pytest.mark.processes
def test_a_file_that_is_there_stays(folder):
    (folder / FILE).write_text("mine")
    with pytest.raises(FileExistsError):
        SceneWriter(folder)
    assert (folder / FILE).read_text() == "mine"


@pytest.mark.processes
@pytest.mark.parametrize(
    ("number", "words"),
    [(signal.SIGKILL, "ended with exit code -9"), (signal.SIGSTOP, "did nothing for 0.5 s")],
)
def test_a_process_that_dies_or_hangs_costs_the_file_alone(folder, monkeypatch, number, words):
    made = []
    monkeypatch.setattr(writer.subprocess, "Popen", processes(made))
    monkeypatch.setattr(writer, "PATIENCE_S", 0.5)
    scene = SceneWriter(folder)
    made[0].send_signal(number)
    for start in range(0, 40_000, 100):  # more than a pipe holds
        scene.take(samples(range(start, start + 100)))
    with pytest.raises(OSError, match=words) as raised:
        scene.close()
    assert raised.value.filename == str(folder / FILE)
    assert not (folder / FILE).exists()
    assert made[0].returncode == -signal.SIGKILL


@pytest.mark.processes
def test_room_is_made_at_once(folder):
    scene = SceneWriter(folder)
    scene.take(samples(range(100)))
    scene.make_room()
    assert not (folder / FILE).exists()
    scene.take(samples(range(100, 200)))
    with pytest.raises(OSError, match="No space left on device") as raised:
        scene.close()
    assert raised.value.errno == errno.ENOSPC


@pytest.mark.processes
def test_a_scenario_that_is_none_any_more_is_told(folder):
    (folder / SCENARIO).write_text("name = 7")
    with pytest.raises(OSError, match=f"{SCENARIO}: "):
        SceneWriter(folder).close()
    assert not (folder / FILE).exists()


@pytest.mark.processes
def test_a_signal_that_ends_programs_does_not_end_it(folder, monkeypatch):
    """A service manager sends it to all processes of a run; the launcher decides."""
    made = []
    monkeypatch.setattr(writer.subprocess, "Popen", processes(made))
    scene = SceneWriter(folder)
    scene.take(samples(range(201)))
    while (folder / FILE).stat().st_size == 0:  # it has begun
        assert made[0].poll() is None
    made[0].send_signal(signal.SIGTERM)
    scene.close()
    assert (folder / FILE).exists()
