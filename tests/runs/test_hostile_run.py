"""Run folders from anybody: what is no regular file, too long or too deep is named, not read."""

import os
import shutil

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from in_process import formnet

from formnet.lab.runs import files
from formnet.lab.scenarios.packaged import CONFIGS

FILES = ("scenario.toml", "verdict.json", "events.jsonl", "states.parquet", "links.parquet")
READERS = (["report"], ["verify"], ["export", "--format", "csv"], ["compare"])


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    out = tmp_path_factory.mktemp("hostile") / "good"
    words = ("--inline", "--no-scene", "--no-figures", "--no-lookahead", "--set", "duration_s=0.2")
    assert formnet("run", CONFIGS / "paper" / "section5.toml", *words, "--out", out)[0] == 1
    (out / "figures").mkdir()  # so that nobody draws them
    return out


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
