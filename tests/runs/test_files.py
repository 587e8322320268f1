"""Files written whole or not at all: on a full disk, beside what is there, through links."""

import os
import resource
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from processes import missing

from formnet.lab.cli import main
from formnet.lab.runs import files
from formnet.lab.runs.folders import filled
from formnet.lab.schemas.scenario import FILE
from formnet.lab.work.export import write_mcap


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty folder to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def limited(limit, code, *arguments):
    """Python in a process whose files may have ``limit`` bytes: beyond that, EFBIG."""
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )


COMMAND = "import sys; sys.dont_write_bytecode = True; from formnet.lab.cli import main; main()"


# --- new files --------------------------------------------------------------------------------


def test_a_new_file_has_what_it_should_and_the_permissions_asked_for(here):
    before = os.umask(0o027)
    try:
        files.write_new(Path("text"), "ü\n")
        files.write_new(here / "secret", b"\x00\xff", 0o600)
    finally:
        os.umask(before)
    assert Path("text").read_bytes() == "ü\n".encode()
    assert Path("secret").read_bytes() == b"\x00\xff"
    assert [stat.S_IMODE(Path(name).stat().st_mode) for name in ("text", "secret")] == [
        0o640,
        0o600,
    ]
    assert sorted(os.listdir()) == ["secret", "text"]


@pytest.mark.parametrize("links", [True, False])
@pytest.mark.parametrize("kind", ["file", "folder", "dangling link"])
def test_what_is_there_is_not_overwritten(here, monkeypatch, kind, links):
    """Even if it appears while the new file is written; on file systems without hard links, too."""
    path = here / "x"
    make = {
        "file": lambda: path.write_text("mine"),
        "folder": path.mkdir,
        "dangling link": lambda: path.symlink_to("nowhere"),
    }[kind]
    real = os.link

    def link(*names):
        make()
        if not links:
            raise PermissionError(1, "Operation not permitted")
        real(*names)

    monkeypatch.setattr(os, "link", link)
    for _ in range(2):  # it appears meanwhile; then it is there
        with pytest.raises(FileExistsError) as caught:
            files.write_new(path, "theirs")
        assert caught.value.filename == str(path)
        assert os.listdir() == ["x"]
        assert kind != "file" or path.read_text() == "mine"


def test_without_hard_links_a_new_file_is_written_all_the_same(here, monkeypatch):
    def link(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", link)
    files.write_new(here / "x", "text")
    assert os.listdir() == ["x"]
    assert Path("x").read_text() == "text"


def test_an_export_removes_no_file_but_its_own(here):
    """A link that leads nowhere is no file that exists, and cannot be written as a new one."""
    Path("run.mcap").symlink_to("nowhere")
    with pytest.raises(FileExistsError):
        write_mcap(None, Path("run.mcap"))
    assert os.listdir() == ["run.mcap"]


# --- replacing -------------------------------------------------------------------------------


@pytest.mark.parametrize("write", [files.replace, files.write_to])
def test_replacing_keeps_permissions(here, write):
    Path("real").write_text("old")
    Path("real").chmod(0o604)
    write(Path("real"), "new")
    assert Path("real").read_text() == "new"
    assert stat.S_IMODE(Path("real").stat().st_mode) == 0o604
    write(Path("fresh"), b"x")
    assert sorted(os.listdir()) == ["fresh", "real"]


def test_a_link_that_the_user_named_is_followed(here):
    Path("real").write_text("old")
    Path("link").symlink_to("real")
    files.write_to(Path("link"), "new")
    assert Path("link").is_symlink()
    assert Path("real").read_text() == "new"


@pytest.mark.parametrize("kind", ["link", "dangling link", "pipe"])
def test_in_a_folder_no_link_or_pipe_is_written_to_but_replaced(here, kind):
    Path("precious").write_text("mine")
    make = {
        "link": lambda: Path("x").symlink_to("precious"),
        "dangling link": lambda: Path("x").symlink_to("nowhere"),
        "pipe": lambda: os.mkfifo("x"),
    }[kind]
    make()
    files.replace(Path("x"), "new")
    assert stat.S_ISREG(Path("x").lstat().st_mode)
    assert Path("x").read_text() == "new"
    assert Path("precious").read_text() == "mine"
    assert sorted(os.listdir()) == ["precious", "x"]


def test_a_folder_in_a_run_s_folder_is_no_link(here):
    Path("elsewhere").mkdir()
    Path("run").mkdir()
    Path("run/figures").symlink_to("../elsewhere")
    for made in (False, True):
        with pytest.raises(OSError, match="symbolic link, which is not followed"):
            files.subfolder(Path("run"), "figures", made=made)
    assert files.subfolder(Path("run"), "csv", made=True).is_dir()


def test_who_has_the_old_file_open_still_reads_all_of_it(here):
    Path("x").write_text("old")
    with Path("x").open() as old:
        files.replace(Path("x"), "new")
        assert old.read() == "old"
    assert Path("x").read_text() == "new"


def test_a_pipe_is_written_to_and_stays_a_pipe(here):
    os.mkfifo("pipe")
    reader = os.open("pipe", os.O_RDONLY | os.O_NONBLOCK)
    files.write_to(Path("pipe"), "text")
    assert os.read(reader, 100) == b"text"
    os.close(reader)
    assert stat.S_ISFIFO(Path("pipe").stat().st_mode)


@pytest.mark.parametrize("name", ["none/x", "folder"])
@pytest.mark.parametrize("write", [files.replace, files.write_new])
def test_errors_name_the_file_and_not_its_part(here, name, write):
    Path("folder").mkdir()
    with pytest.raises(OSError, match=f"'{name}'") as caught:
        write(Path(name), "x")
    assert caught.value.filename == name
    assert os.listdir() == ["folder"]
    assert os.listdir("folder") == []


# --- no room ---------------------------------------------------------------------------------

WRITE = """
import sys
from pathlib import Path
from formnet.lab.runs import files
try:
    getattr(files, sys.argv[1])(Path(sys.argv[2]), "x" * 5000)
except OSError as error:
    print(error.filename, error.strerror)
"""


@pytest.mark.processes
@pytest.mark.parametrize("write", ["write_new", "replace"])
def test_a_file_that_grows_too_large_leaves_nothing_behind(here, write):
    told = limited(4096, WRITE, write, "x")
    assert told.stdout == "x File too large\n", told.stderr
    assert os.listdir() == []


@pytest.mark.processes
def test_what_cannot_be_replaced_stays(here):
    Path("x").write_text("old")
    told = limited(4096, WRITE, "replace", "x")
    assert told.stdout == "x File too large\n", told.stderr
    assert (os.listdir(), Path("x").read_text()) == (["x"], "old")


@pytest.mark.processes
@pytest.mark.parametrize(
    ("limit", "name"), [(100, "x.toml"), (20_000, FILE)], ids=["scenario", "schema"]
)
def test_new_leaves_nothing_behind_where_one_of_its_files_finds_no_room(here, limit, name):
    told = limited(limit, COMMAND, "new", "x")
    assert (told.returncode, told.stderr) == (3, f"{name} cannot be written: File too large\n")
    assert os.listdir() == []


@pytest.mark.processes
def test_a_schema_that_cannot_be_written_leaves_the_old_one(here):
    Path("s.json").write_text("old")
    told = limited(20_000, COMMAND, "schema", "--out", "s.json")
    assert (told.returncode, told.stderr) == (3, "--out s.json: File too large\n")
    assert (os.listdir(), Path("s.json").read_text()) == (["s.json"], "old")


KEYS = """
import resource, sys
from pathlib import Path
from formnet.lab.machines import keys
from formnet.lab.runs import files
real = files.write_new
def write_new(path, *rest):
    if path.name == sys.argv[1]:
        resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))
    real(path, *rest)
files.write_new = write_new
try:
    keys.make(Path("keys"), [1], [], 30)
except OSError as error:
    print(error.filename, error.strerror)
"""


@pytest.mark.processes
@pytest.mark.parametrize("name", ["ca.pem", "robot-1.pem", "robot-1-key.pem"])
def test_keys_come_in_pairs_even_where_there_is_no_room(here, name):
    pytest.importorskip("cryptography")
    told = subprocess.run([sys.executable, "-c", KEYS, name], capture_output=True, text=True)
    assert told.stdout == f"keys/{name} File too large\n", told.stderr
    there = sorted(
        path.name.removesuffix(".pem").removesuffix("-key") for path in here.glob("keys/*.pem")
    )
    assert there == sorted(2 * list(dict.fromkeys(there)))
    assert CliRunner().invoke(main, ["keys", "init", "keys", "--robots", "1"]).exit_code == 0
    assert (here / "keys" / name).exists()


@pytest.mark.processes
def test_on_a_full_disk_nothing_is_left_behind(here):
    """A file system of one page beside the folder itself: ENOSPC."""
    disk = here / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=8k", "none", disk], capture_output=True
    )
    if mounted.returncode:
        missing("the right to mount a tmpfs")
    try:
        told = CliRunner().invoke(main, ["new", "x", "--out", str(disk / "x.toml")])
        assert told.exit_code == 3
        assert "cannot be written: No space left on device" in told.output
        assert f"{disk}/" in told.output
        assert list(disk.iterdir()) == []
        (disk / "s.json").write_text("old")
        told = CliRunner().invoke(main, ["schema", "--out", str(disk / "s.json")])
        assert told.exit_code == 3
        assert [path.read_text() for path in disk.iterdir()] == ["old"]
    finally:
        subprocess.run(["umount", disk], check=True)


@pytest.mark.parametrize("there", [False, True])
@pytest.mark.parametrize("error", [OSError, ValueError, KeyboardInterrupt])
def test_of_a_folder_that_could_not_be_filled_nothing_is_left(tmp_path, there, error):
    if there:
        (tmp_path / "out").mkdir()

    def fails():
        with filled(tmp_path / "out", "first") as folder:
            (folder / "second").write_text("half")
            raise error

    with pytest.raises(error):
        fails()
    assert list(tmp_path.rglob("*")) == [tmp_path / "out"] * there
