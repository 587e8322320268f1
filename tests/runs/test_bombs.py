"""Run folders from anybody: what is small on the disk takes little memory and time when read."""

import json
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from in_process import formnet

from formnet.lab.runs.tables import MOST_ROWS
from formnet.lab.verdict.files import MOST_ITEMS, MOST_KEYS


@pytest.fixture
def bad(good, tmp_path):
    """A copy of a run, to be damaged."""
    return shutil.copytree(good, tmp_path / "bad")


def long_plan(folder):
    """The scenario says that the run lasted for long."""
    text = (folder / "scenario.toml").read_text()
    assert "duration_s = 0.2" in text
    (folder / "scenario.toml").write_text(text.replace("duration_s = 0.2", "duration_s = 1e6"))


@pytest.mark.parametrize("name", ["states", "links"])
def test_a_small_table_of_very_many_rows_is_not_read(bad, name):
    """Columns that repeat one value: a megabyte was gigabytes of Python's objects."""
    long_plan(bad)
    file = bad / f"{name}.parquet"
    schema = pq.read_schema(file).remove_metadata()
    row = pq.read_table(file).slice(0, 1)
    many = row.take(pa.array(np.zeros(10**6, np.int64)))
    with pq.ParquetWriter(file, schema) as writer:
        for _ in range(MOST_ROWS // 10**6 + 1):
            writer.write_table(many.cast(schema))
    assert file.stat().st_size < 10**6
    code, said = formnet("verify", bad)
    assert code == 2
    assert f"{name}.parquet has {MOST_ROWS + 10**6} rows; at most {MOST_ROWS} are read" in said


@pytest.mark.parametrize(
    ("name", "column", "encoding"),
    [
        ("states", "t_ns", "DELTA_BINARY_PACKED"),
        ("states", "x_m", "BYTE_STREAM_SPLIT"),
        ("links", "sequence", "DELTA_BINARY_PACKED"),
    ],
)
def test_a_table_is_encoded_as_ours_are(bad, name, column, encoding):
    file = bad / f"{name}.parquet"
    table = pq.read_table(file)
    others = [own for own in table.column_names if own != column]
    pq.write_table(table, file, use_dictionary=others, column_encoding={column: encoding})
    code, said = formnet("verify", bad)
    assert code == 2
    assert f"{name}.parquet is encoded as {encoding}; must be PLAIN or a dictionary" in said


@pytest.mark.parametrize("fate", ["=cmd|'/C calc'!A0", "\x1b]0;x\x07", "delivered ", ""])
def test_a_fate_that_is_none_comes_into_no_table_of_anybody_s(bad, tmp_path, fate):
    """A spreadsheet executes a cell that begins with ``=``."""
    file = bad / "links.parquet"
    table = pq.read_table(file)
    kind = table.schema.field("fate")
    fates = pa.array([fate] + ["delivered"] * (len(table) - 1)).cast(kind.type)
    pq.write_table(table.set_column(table.schema.get_field_index("fate"), kind, fates), file)
    code, said = formnet("export", bad, "--format", "csv", "--out", tmp_path / "csv")
    assert code == 2
    assert "links.parquet: fates must be of corrupted, delivered, " in said
    assert not (tmp_path / "csv").exists()


VERDICTS = {
    "warnings": (lambda v: v | {"warnings": [0] * (MOST_ITEMS + 1)}, "has a list of 200001 items"),
    "keys": (
        lambda v: v | {str(key): 0 for key in range(MOST_KEYS + 1)},
        f"; at most {MOST_KEYS}",
    ),
    "fates": (
        lambda v: v | {"messages": {"fates": {str(key): -1 for key in range(MOST_KEYS + 1)}}},
        "has an object of 1001 keys",
    ),
    "all wrong": (
        lambda v: v | {"warnings": [0] * MOST_ITEMS},
        "warnings[0] = 0: must be a string",
    ),
}


@pytest.mark.parametrize("case", VERDICTS)
def test_a_verdict_of_which_all_is_wrong_is_a_line(bad, case):
    """Each of its items was an error of its own: three megabytes were two gigabytes."""
    change, words = VERDICTS[case]
    verdict = json.loads((bad / "verdict.json").read_text())
    (bad / "verdict.json").write_text(json.dumps(change(verdict)))
    code, said = formnet("verify", bad)
    assert code == 2
    assert words in said
    assert "more" not in said


def test_an_event_about_more_robots_than_there_are_ends_the_reading(bad):
    lines = (bad / "events.jsonl").read_text().splitlines()
    started = json.loads(lines[0]) | {"robots": [1] * 340_000}
    (bad / "events.jsonl").write_text("\n".join([json.dumps(started, separators=(",", ":"))] * 3))
    code, said = formnet("verify", bad)
    assert code == 2
    assert "line 1: started.robots: '340000 entries': must have at most 5 entries" in said


@pytest.mark.parametrize("mark", ["\ud800", "\x1b", " ", "\u202e"])
def test_a_time_is_written_as_ours_are(bad, tmp_path, mark):
    """``datetime.fromisoformat`` takes any character between date and time."""
    lines = (bad / "events.jsonl").read_text().splitlines()
    first = json.loads(lines[0])
    first["wall"] = first["wall"].replace("T", mark)
    (bad / "events.jsonl").write_text("\n".join([json.dumps(first), *lines[1:], ""]))
    code, said = formnet("export", bad, "--format", "csv", "--out", tmp_path / "csv")
    assert code == 2
    assert "line 1: wall: " in said
    assert not (tmp_path / "csv").exists()


@pytest.mark.long
@pytest.mark.parametrize("size", [1e90, 1.7e308])
def test_states_as_large_as_numbers_are_end_no_figure_but_their_own(bad, tmp_path, size):
    table = pq.read_table(bad / "states.parquet")
    row = np.arange(len(table))
    for place, name in enumerate(table.column_names[2:], start=2):
        values = pa.array(np.where(row % 2, size, -size))
        table = table.set_column(place, table.schema.field(name), values)
    pq.write_table(table, bad / "states.parquet")
    code, said = formnet("plot", bad, "--out", tmp_path / "figures")
    assert code == 0, said
    drawn = {path.stem for path in (tmp_path / "figures").glob("*.png")}
    assert {"graph", "errors", "delays"} <= drawn
    if size > 1e100:
        assert "without: thumbnail, paths (states or places beyond 1e+100)" in said
    else:
        assert "without" not in said
        assert {"thumbnail", "paths"} <= drawn
    assert "Warning" not in said
