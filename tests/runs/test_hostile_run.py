"""Run folders from anybody: what is no regular file, too long or too deep is named, not read."""

import base64
import os
import shutil

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from in_process import formnet

from formnet.lab.runs import files

FILES = ("scenario.toml", "verdict.json", "events.jsonl", "states.parquet", "links.parquet")
READERS = (["report"], ["verify"], ["export", "--format", "csv"], ["compare"])


def pipe(path):
    os.mkfifo(path)


def device(path):
    path.symlink_to("/dev/zero")


def link(path):
    path.symlink_to(__file__)


def huge(path):
    with path.open("wb") as stream:
        stream.truncate(2**40)  # sparse: it takes no room


def deep(path):
    path.write_bytes(b"[" * 200_000 + b"\n")


def folder(path):
    path.mkdir()


def many_rows(path):
    """A few hundred kilobytes that are 10⁸ rows."""
    column = pa.DictionaryArray.from_arrays(pa.array([0] * 10**6, pa.int32()), pa.array([0]))
    with pq.ParquetWriter(path, pa.schema([("t_ns", column.type)])) as writer:
        for _ in range(30):
            writer.write_table(pa.table({"t_ns": column}))


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("attack", [pipe, device, link, huge, deep, folder])
def test_a_file_of_a_run_that_is_none_ends_every_reader_and_harms_nothing_beside_it(
    good, tmp_path, attack, name
):
    shutil.copytree(good, tmp_path / "beside")
    bad = shutil.copytree(good, tmp_path / "bad")
    (bad / name).unlink()
    attack(bad / name)
    before = sorted(bad.iterdir())
    for words in READERS:
        more = [good] if words == ["compare"] else []
        more += ["--out", tmp_path / "out"] if words[0] == "export" else []
        code, said = formnet(*words, bad, *more)
        if not (words == ["report"] and code == 0):  # the rest of it can be shown
            assert code in (2, 3), (words, said)
            assert name in said.replace(" ", "") or "tables" in said, (words, said)
    assert [path for path in before if path not in bad.iterdir()] == []
    code, said = formnet("list", tmp_path)
    assert code == 0, said
    assert "beside" in said
    assert "bad" in said


def test_a_table_of_too_many_rows_is_not_read(good, tmp_path, monkeypatch):
    bad = shutil.copytree(good, tmp_path / "bad")
    many_rows(bad / "states.parquet")
    assert (bad / "states.parquet").stat().st_size < 10**6
    code, said = formnet("verify", bad)
    assert code == 2
    assert "states.parquet has 30000000 rows; at most 150 are read" in said


def test_a_catalogue_of_claims_that_nests_deep_is_one_line(good, tmp_path):
    shutil.copytree(good, tmp_path / "beside")
    for kind in ("claims", "nemesis"):
        (tmp_path / kind).mkdir()
        deep(tmp_path / kind / f"{kind}.json")
    code, said = formnet("list", tmp_path)
    assert code == 0, said
    assert "beside" in said
    assert "claims.json cannot be read" in said
    assert "nemesis.json cannot be read" in said


def test_what_is_read_is_bounded(tmp_path):
    (tmp_path / "long").write_bytes(b"x" * 100)
    with pytest.raises(OSError, match="longer than 99 bytes") as raised:
        files.reading(tmp_path / "long", 99)
    assert raised.value.filename == str(tmp_path / "long")
    with files.reading(tmp_path / "long", 100) as stream:
        assert stream.read() == b"x" * 100


# --- what is written ---------------------------------------------------------------------------

WRITERS = {
    "report": (["report"], ["report.html"]),
    "plot": (["plot"], ["figures/paths.png", "figures/graph.svg", "figures/thumbnail.png"]),
    "csv": (["export", "--format", "csv"], []),
    "mcap": (["export", "--format", "mcap"], []),
}


def canary(place):
    """What lies outside, and when it was changed."""
    return {
        path.name: (path.lstat().st_mtime_ns, path.is_file() and path.read_bytes())
        for path in sorted(place.rglob("*"))
    }


@pytest.mark.parametrize(
    "writer", [pytest.param(key, marks=[pytest.mark.long] * (key == "plot")) for key in WRITERS]
)
@pytest.mark.parametrize("target", ["precious.txt", "none"])
def test_a_link_in_a_run_s_folder_is_not_written_through(good, tmp_path, writer, target):
    """``figures/paths.png -> ../../precious.txt``, then ``plot``: that was the end of the file."""
    words, names = WRITERS[writer]
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "precious.txt").write_text("mine")
    bad = shutil.copytree(good, tmp_path / "bad")
    for name in [*names, "run.mcap"]:
        (bad / name).unlink(missing_ok=True)
        (bad / name).symlink_to(outside / target)
    before = canary(outside)
    code, said = formnet(*words, bad)
    assert code == (2 if writer == "mcap" else 0), said
    assert canary(outside) == before
    for name in names:
        assert (bad / name).is_file()
        assert not (bad / name).is_symlink()


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["plot"], "figures"),
        (["report"], "figures"),
        (["export", "--format", "csv"], "csv"),
    ],
)
def test_a_folder_of_a_run_that_is_a_link_is_not_written_into(good, tmp_path, words, name):
    outside = tmp_path / "outside"
    outside.mkdir()
    bad = shutil.copytree(good, tmp_path / "bad")
    shutil.rmtree(bad / name, ignore_errors=True)
    (bad / name).symlink_to(outside)
    code, said = formnet(*words, bad)
    assert list(outside.iterdir()) == []
    assert words == ["report"] or (code == 2 and "symbolic link, which is not followed" in said)


def test_no_figure_from_elsewhere_comes_into_the_page(good, tmp_path):
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "paths.png").write_bytes(b"a picture of mine")
    for link, to in (("figures", outside), ("figures/paths.png", outside / "paths.png")):
        bad = shutil.copytree(good, tmp_path / link.replace("/", "-"))
        if link == "figures":
            (bad / link).rmdir()
        (bad / link).symlink_to(to)
        assert formnet("report", bad)[0] == 0
        assert (
            base64.b64encode(b"a picture of mine").decode() not in (bad / "report.html").read_text()
        )


def test_an_index_that_is_a_link_is_left_as_it_is(good, tmp_path):
    runs = tmp_path / "runs"
    shutil.copytree(good, runs / "one")
    (tmp_path / "mine").write_text('<meta name="generator" content="formnet"> mine')
    (runs / "index.html").symlink_to(tmp_path / "mine")
    code, said = formnet("list", runs)
    assert code == 0
    assert "not formnet's; it is left as it is" in said
    assert (tmp_path / "mine").read_text().endswith("mine")


def test_a_linked_run_is_named_and_not_followed(good, tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "link").symlink_to(good)
    code, said = formnet("list", tmp_path / "folder")
    assert code == 0
    assert "link (a symbolic link, which is not followed)" in said


def test_migrate_of_a_received_folder_follows_no_link(good, tmp_path):
    old = "\n".join(
        line for line in (good / "scenario.toml").read_text().splitlines() if "format" not in line
    )
    (tmp_path / "mine.toml").write_text(old)
    bad = shutil.copytree(good, tmp_path / "bad")
    (bad / "scenario.toml").unlink()
    (bad / "scenario.toml").symlink_to(tmp_path / "mine.toml")
    code, said = formnet("migrate", bad)
    assert code == 2
    assert "symbolic link, which is not followed" in said
    assert (tmp_path / "mine.toml").read_text() == old


@pytest.mark.parametrize("command", ["run", "check"])
def test_a_received_folder_s_scenario_is_no_link(good, tmp_path, command):
    bad = shutil.copytree(good, tmp_path / "bad")
    (bad / "scenario.toml").unlink()
    (bad / "scenario.toml").symlink_to("/etc/passwd")
    code, said = formnet(command, bad)
    assert code == 2
    assert "symbolic link, which is not followed" in said
    assert "root:" not in said


# --- tables and events ---------------------------------------------------------------------------


@pytest.mark.parametrize("codec", ["zstd", "gzip"])
def test_a_table_that_is_packed_tighter_than_ours_is_not_unpacked(good, tmp_path, codec):
    bad = shutil.copytree(good, tmp_path / "bad")
    table = pq.read_table(bad / "states.parquet")
    pq.write_table(table, bad / "states.parquet", compression=codec)
    code, said = formnet("verify", bad)
    assert code == 2
    assert f"states.parquet is compressed with {codec.upper()}; must be SNAPPY" in said


TABLES = {
    "another type": (
        lambda t: t.set_column(0, "t_ns", pa.nulls(len(t), pa.list_(pa.int64()))),
        "column t_ns: must be int64",
    ),
    "a column twice": (lambda t: t.append_column("t_ns", t["t_ns"]), "must have one column t_ns"),
    "empty cells": (
        lambda t: t.set_column(2, "x_m", pa.nulls(len(t), pa.float64())),
        "column x_m: has empty cells",
    ),
    "other instants": (
        lambda t: t.set_column(0, "t_ns", pa.array([2**62] * len(t))),
        "t_ns must ascend from 0 to the end of the run",
    ),
    "twice as long": (lambda t: pa.concat_tables([t] * 9), "rows; at most 150 are read"),
}


@pytest.mark.parametrize("case", TABLES)
def test_a_table_that_is_another_is_named(good, tmp_path, case):
    change, words = TABLES[case]
    bad = shutil.copytree(good, tmp_path / "bad")
    pq.write_table(change(pq.read_table(bad / "states.parquet")), bad / "states.parquet")
    code, said = formnet("verify", bad)
    assert code == 2
    assert words in said


@pytest.mark.parametrize(
    ("fates", "code"),
    [
        (pa.dictionary(pa.int32(), pa.string()), 0),  # as Arrow 18 reads what it wrote as int8
        (pa.string(), 2),
    ],
    ids=str,
)
def test_a_column_of_words_is_a_dictionary_with_any_kind_of_index(good, tmp_path, fates, code):
    other = shutil.copytree(good, tmp_path / "other")
    table = pq.read_table(other / "links.parquet")
    number = table.column_names.index("fate")
    words = pa.chunked_array([table["fate"].combine_chunks().cast(pa.string()).cast(fates)])
    pq.write_table(table.set_column(number, "fate", words), other / "links.parquet")
    found, said = formnet("verify", other)
    assert found == code, said
    assert ("column fate: must be dictionary" in said) == (code == 2)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (b'{"a": "' + b"x" * 2**20 + b'"}\n', "line 1: is longer than 1048576 bytes"),
        (None, "line 50001: at most 50000 lines are read"),
    ],
)
def test_events_are_bounded(good, tmp_path, lines, words):
    bad = shutil.copytree(good, tmp_path / "bad")
    first = (bad / "events.jsonl").read_bytes().splitlines(keepends=True)[0]
    (bad / "events.jsonl").write_bytes(first * 50_001 if lines is None else lines)
    code, said = formnet("verify", bad)
    assert code == 2
    assert words in said


def test_json_of_many_values_is_not_parsed(good, tmp_path):
    bad = shutil.copytree(good, tmp_path / "bad")
    (bad / "verdict.json").write_bytes(b"[" + b"[]," * 2 * 10**6 + b"[]]")
    code, said = formnet("verify", bad)
    assert code == 2
    assert "it has more than 3000000 values" in said
