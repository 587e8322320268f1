"""Run folders from strangers: mutated ones, through every command that reads one.

Each command runs in a forked child of one process that has the modules imported. It must end
without a traceback, within CPU_S seconds of processor time and MOST_BYTES of resident memory, and
leave what lies beside the folder as it was; nothing of what lies there may stand in what it says or
writes, and no other program may be started.
"""

import base64
import gc
import hashlib
import os
import random
import re
import resource
import shutil
import signal
import sys
import tomllib
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, NoReturn

import pyarrow as pa
import pyarrow.parquet as pq

import formnet
from formnet.lab.cli import main
from formnet.lab.figures import run_figures as figures
from formnet.lab.pages.report import write_report
from formnet.lab.runs import files
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.lab.verdict.files import Unreadable
from formnet.lab.verdict.recorded import read_run
from formnet.lab.watch import replay
from formnet.lab.work import compare, export, verify  # noqa: F401 (imported before children are)
from formnet.lab.work import list as listing  # noqa: F401

CPU_S, MOST_BYTES = 2.0, 500 * 2**20
WALL_S = 60
"""What hangs without computing is killed after so long; the machine may be busy."""
SECRET = "what lies outside, and is nobody's business "
FILES = ("scenario.toml", "verdict.json", "events.jsonl", "states.parquet", "links.parquet")
PLACES = (*FILES, "run.rrd", "report.html", "figures/paths.png", "figures/errors.svg")
SUBFOLDERS = ("figures", "logs", "csv")
STARTS = {"subprocess.Popen", "os.posix_spawn", "os.exec", "os.system"}

Damage = Callable[[random.Random, Path, Path], None]
"""Does something to a run's folder; the last is a folder beside it, which is nobody's business."""


class Call(NamedTuple):
    """How a command ended."""

    code: int
    said: str
    cpu_s: float
    resident: int


# --- what is done to a folder --------------------------------------------------------------------


def _gone(path: Path) -> Path:
    """``path``, with nothing there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
    path.parent.mkdir(exist_ok=True)
    return path


def _truncated(r: random.Random, run: Path, _: Path) -> None:
    file = run / r.choice(FILES)
    if file.is_file():
        os.truncate(file, r.randrange(file.stat().st_size + 1))


def _flipped(r: random.Random, run: Path, _: Path) -> None:
    file = run / r.choice(FILES)
    data = bytearray(file.read_bytes()) if file.is_file() else bytearray()
    for _ in range(r.choice((1, 3, 30)) if data else 0):
        data[r.randrange(len(data))] = r.randrange(256)
    file.write_bytes(data)


def _swapped(r: random.Random, run: Path, _: Path) -> None:
    one, other = (run / name for name in r.sample(FILES, 2))
    if one.is_file() and other.is_file():
        first, second = one.read_bytes(), other.read_bytes()
        one.write_bytes(second)
        other.write_bytes(first)


def _missing(r: random.Random, run: Path, _: Path) -> None:
    _gone(run / r.choice((*PLACES, *SUBFOLDERS)))


def _linked(r: random.Random, run: Path, outside: Path) -> None:
    place = _gone(run / r.choice((*PLACES, *SUBFOLDERS, "run.mcap", "index.html")))
    target = "empty" if place.name in SUBFOLDERS and r.random() < 0.5 else ""
    target = target or (
        "" if place.name in SUBFOLDERS else r.choice(("secret", "new", "secret.svg"))
    )
    place.symlink_to(r.choice((outside / target, Path("/dev/zero"), Path("/proc/self/mem"), place)))
    if r.random() < 0.7:
        place.unlink()
        place.symlink_to(outside / target)


def _pipe(r: random.Random, run: Path, _: Path) -> None:
    os.mkfifo(_gone(run / r.choice((*PLACES, *SUBFOLDERS))))


def _a_folder(r: random.Random, run: Path, _: Path) -> None:
    _gone(run / r.choice(PLACES)).mkdir()


def _sparse(r: random.Random, run: Path, _: Path) -> None:
    with _gone(run / r.choice(PLACES)).open("wb") as stream:
        stream.write(r.choice((b"", b'{"a":[', b"PAR1", b'name = "x"\n', b"[")))
        stream.truncate(r.choice((2**24, 2**26, 2**31, 2**40)))


def _deep(r: random.Random, run: Path, _: Path) -> None:
    size = r.choice((200, 2000, 200_000))
    text = r.choice(("[" * size, '{"a":' * size, "a=" + "[" * size, "a" + ".a" * size + "=1"))
    text = r.choice((text, "[" + text + "]", "x=" + "{a=" * size))
    (_gone(run / r.choice((*FILES[:3], "claims.json", "nemesis.json")))).write_text(text + "\n")


def _long(r: random.Random, run: Path, _: Path) -> None:
    size = r.choice((10**5, 3 * 10**6, 2 * 10**7))
    text = r.choice(('"' + "x" * size, "9" * size, "[[],[]," * (size // 7), "a=1\n" * (size // 4)))
    name = r.choice((*FILES[:3], "claims.json", "nemesis.json"))
    if r.random() < 0.3 and (run / name).is_file():
        text = (run / name).read_text(errors="replace") + text
    _gone(run / name).write_text(text)


_NUMBERS = (
    *("1e999", "-1", "0", "1e308", "-1e308", "5e-324", "9" * 30, "9" * 5000, "NaN", "nan", "inf"),
    *(
        "0x" + "f" * 6000,
        "9223372036854775807",
        "9223372036854775808",
        "1e10",
        "2147483648",
        "true",
    ),
    *('"²"', '"x"', "[]", "{}", "null", '""', '"\\ud800"', '"\\u001b]0;x"', "1e5", "1000000"),
)


def _numbers(r: random.Random, run: Path, _: Path) -> None:
    """Some number of a text, or word, becomes another value."""
    file = run / r.choice(FILES[:3])
    text = file.read_text(errors="replace") if file.is_file() else ""
    for _ in range(r.choice((1, 1, 1, 4))):
        found = list(
            re.finditer(r"(?<![\w.\"])-?\d+(\.\d+)?(e[-+]?\d+)?(?![\w.\"])|\"[^\"\n]*\"", text)
        )
        if found:
            hit = r.choice(found)
            text = text[: hit.start()] + r.choice(_NUMBERS) + text[hit.end() :]
    file.write_bytes(text.encode(errors="replace"))


def _encoded(r: random.Random, run: Path, _: Path) -> None:
    file = run / r.choice(FILES[:3])
    text = file.read_text(errors="replace") if file.is_file() else "ü"
    file.write_bytes(text.encode(r.choice(("utf-16", "utf-32", "utf-8-sig", "cp500"))) + b"\xff")


def _many(r: random.Random, run: Path, _: Path) -> None:
    place = run / r.choice(("figures", "logs", "cases", "."))
    place.mkdir(exist_ok=True)
    for number in range(2000):
        with suppress(OSError):
            (place / f"a{number}.png").touch()


def _lines(r: random.Random, run: Path, _: Path) -> None:
    """The lines of the events again and again, in another order, or without an end."""
    file = run / "events.jsonl"
    lines = file.read_bytes().splitlines(keepends=True) if file.is_file() else [b"{}\n"]
    kept = [r.choice(lines or [b"\n"]) for _ in range(r.choice((3, 300, 30_000)))]
    file.write_bytes(b"".join(kept) + r.choice((b"", b"{", b" " * 10**6)))


def _columns(r: random.Random, run: Path, _: Path) -> None:
    """A table with other values, types, columns or rows."""
    name = r.choice(FILES[3:])
    try:
        table = pq.read_table(run / name)
    except (OSError, pa.ArrowException):
        return
    index = r.randrange(table.num_columns)
    field = table.schema.field(index)
    rows = table.num_rows
    values: list[object] = table.column(index).to_pylist()
    match r.randrange(8):
        case 0:
            table = table.drop_columns([field.name])
        case 1:
            other = r.choice((pa.string(), pa.float32(), pa.list_(pa.int64()), pa.binary()))
            table = table.set_column(index, field.name, pa.nulls(rows, other))
        case 2:
            table = table.set_column(index, field, pa.nulls(rows, field.type))
        case 3:
            table = table.append_column(field.name, table.column(index))
        case 4:
            table = table.slice(0, r.randrange(rows + 1))
        case 5:
            table = pa.concat_tables([table] * r.choice((2, 50)))
        case 6:
            table = table.take(r.sample(range(rows), rows))
        case _:
            wild = (0, -1, 2**62, 2**31 - 1, -(2**31)) if pa.types.is_integer(field.type) else ()
            wild = wild or ((float("nan"), float("inf"), 1e308, -1e308, 1e-320, None))
            if not pa.types.is_dictionary(field.type):
                for _ in range(r.choice((1, 5, rows))):
                    values[r.randrange(rows)] = r.choice(wild)
                column = (
                    pa.array(values, field.type, from_pandas=False)
                    if _fits(values, field)
                    else None
                )
                table = table if column is None else table.set_column(index, field, column)
    pq.write_table(table, run / name)


def _fits(values: list[object], field: pa.Field) -> bool:
    try:
        pa.array(values, field.type)
    except (pa.ArrowException, OverflowError, TypeError, ValueError):
        return False
    return True


def _bomb(r: random.Random, run: Path, _: Path) -> None:
    """A small table that unpacks to a large one."""
    name = r.choice(FILES[3:])
    rows, groups = r.choice(((10**6, 1), (10**6, 30), (10**5, 10)))
    column = pa.DictionaryArray.from_arrays(pa.array([0] * rows, pa.int32()), pa.array([0]))
    table = pa.table(dict.fromkeys(("t_ns", "robot"), column))
    if r.random() < 0.3:  # few rows, each of many megabytes once it is unpacked
        table, groups = pa.table({"t_ns": pa.array(["\0" * 2**24] * 8)}), 1
    codec = r.choice(("snappy", "zstd", "gzip", "none"))
    with pq.ParquetWriter(_gone(run / name), table.schema, compression=codec) as writer:
        for _ in range(groups):
            writer.write_table(table)


DAMAGES: tuple[Damage, ...] = (
    *(_truncated, _flipped, _swapped, _missing, _linked, _linked, _pipe, _a_folder, _sparse, _deep),
    *(_long, _numbers, _numbers, _numbers, _encoded, _many, _lines, _columns, _columns, _bomb),
)


# --- what is done with it ------------------------------------------------------------------------


class _FarEnough(BaseException):
    """Here a command would begin to simulate, or to serve."""


def _far_enough(*_: object, **__: object) -> NoReturn:
    raise _FarEnough


def _open(run: Path, _: Path) -> None:
    with suppress(Unreadable, formnet.ScenarioError, OSError):
        opened = formnet.open(run)
        assert opened.t_s.ndim == 1
        assert opened.errors


def _cli(*words: object) -> None:
    main([str(word) for word in words], standalone_mode=True)


COMMANDS: dict[str, Callable[[Path, Path], None]] = {
    "list": lambda run, good: _cli("list", run.parent),
    "report": lambda run, good: _cli("report", run),
    "compare": lambda run, good: _cli("compare", run, good),
    "plot": lambda run, good: _cli("plot", run),
    "csv": lambda run, good: _cli("export", run, "--format", "csv"),
    "mcap": lambda run, good: _cli("export", run, "--format", "mcap"),
    "open": _open,
    "verify": lambda run, good: _cli("verify", run),
    "replay": lambda run, good: _cli("replay", run, "--web"),
    "check": lambda run, good: _cli("check", "--no-lookahead", run),
}


def _called(command: Callable[[Path, Path], None], run: Path, good: Path, log: Path) -> Call:
    """Run a command in a child; a negative code is the signal that ended it."""
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if not child:
        _in_child(command, run, good, log)
    _, status, used = os.wait4(child, 0)
    code = os.waitstatus_to_exitcode(status)
    said = log.read_text(errors="replace")
    return Call(code, said, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024)


def _in_child(command: Callable[[Path, Path], None], run: Path, good: Path, log: Path) -> NoReturn:
    code = 99
    try:
        output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(output, 1)
        os.dup2(output, 2)
        sys.stdout = sys.stderr = open(1, "w", closefd=False, errors="replace")  # noqa: SIM115
        os.chdir(run)
        signal.alarm(WALL_S)
        resource.setrlimit(resource.RLIMIT_CPU, (10, 10))
        sys.addaudithook(_no_program)
        verify.engine = replay.Viewer = _far_enough  # type: ignore[assignment,misc]
        command(run, good)
        code = 0
    except _FarEnough:
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0 if end.code is None else 98
    except BaseException:
        traceback.print_exc()
    finally:
        with suppress(Exception):
            sys.stdout.flush()
        os._exit(code)


def _no_program(event: str, arguments: tuple[object, ...]) -> None:
    if event in STARTS and arguments[:1] != ("uname",):
        raise RuntimeError(f"{event} {arguments[:2]}: a program is started")


def _state(place: Path) -> dict[str, tuple[int, int, str]]:
    """Everything below a folder: when it was changed, its mode, and what is in it."""
    found = {}
    for path in sorted(place.rglob("*")):
        status = path.lstat()
        content = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
        found[str(path.relative_to(place))] = (status.st_mtime_ns, status.st_mode, content)
    return found


def _leaks(run: Path) -> list[str]:
    """Files of the folder in which something from outside stands."""
    marks = (SECRET.encode(), base64.b64encode((SECRET * 6).encode())[:60])
    found = []
    for path in run.rglob("*"):
        if path.is_symlink() or not path.is_file() or path.stat().st_size > 2**25:
            continue
        content = path.read_bytes()
        if any(mark in content for mark in marks):
            found.append(path.name)
    return found


def _judged(name: str, call: Call) -> Iterator[str]:
    if call.code not in (0, 1, 2, 3):
        yield f"{name} ended with {call.code}: {call.said.strip()[-600:]}"
    elif "Traceback" in call.said:
        yield f"{name}: traceback: {call.said.strip()[-600:]}"
    if call.cpu_s > CPU_S:
        yield f"{name} took {call.cpu_s:.1f} s"
    if call.resident > MOST_BYTES:
        yield f"{name} took {call.resident >> 20} MiB"
    if SECRET in call.said:
        yield f"{name} says what lies outside"


def _damage(r: random.Random, run: Path, outside: Path, done: list[Damage]) -> None:
    for damage in done:
        with suppress(OSError, UnicodeError):  # what another one left of it
            damage(r, run, outside)


def _in_another(work: Callable[[], None]) -> None:
    """Do it in a child: what it takes of memory is not counted as that of the commands."""
    child = os.fork()
    if not child:
        try:
            work()
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    if os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]):
        raise RuntimeError("a folder could not be mutated")


class Fuzzed(NamedTuple):
    """How many calls of each command, what failed, and the most that one took."""

    calls: Counter[str]
    failures: list[str]
    most_cpu_s: float
    most_resident: int


def fuzz_folders(
    folders: int,
    seed: int,
    stopped: Callable[[], bool] = bool,
    first: int = 0,
    commands: tuple[str, ...] = tuple(COMMANDS),
) -> Fuzzed:
    """Mutate ``folders`` run folders, the ``first``-th of ``seed`` and on, and read each."""
    calls: Counter[str] = Counter()
    failures: list[str] = []
    most_cpu_s, most_resident = 0.0, 0
    with TemporaryDirectory(prefix="formnet-folders-") as name:
        root = Path(name).resolve()
        good = _good(root)
        gc.freeze()  # a child that collects would copy all of this
        for number in range(first, first + folders):
            if stopped():
                break
            r = random.Random(f"{seed}/{number}")
            place = root / str(number)
            run, outside = place / "runs" / "bad", place / "outside"
            shutil.copytree(good, run)
            shutil.copytree(root / "outside", outside)
            done = [r.choice(DAMAGES) for _ in range(r.choice((1, 1, 2, 3)))]
            _in_another(
                lambda r=r, run=run, outside=outside, done=done: _damage(r, run, outside, done)
            )
            before = _state(outside), _state(good)
            what = f"folder {number} ({', '.join(some.__name__.strip('_') for some in done)})"
            for command in commands:
                call = _called(COMMANDS[command], run, good, place / "log")
                calls[command] += 1
                most_cpu_s = max(most_cpu_s, call.cpu_s)
                most_resident = max(most_resident, call.resident)
                failures += [f"{what}: {text}" for text in _judged(command, call)]
            if (_state(outside), _state(good)) != before:
                failures.append(f"{what}: something outside was changed")
            failures += [f"{what}: {file} has what lies outside" for file in _leaks(run)]
            shutil.rmtree(place)
    return Fuzzed(calls, failures, most_cpu_s, most_resident)


def _good(root: Path) -> Path:
    """A run's folder, with everything in it, and a folder beside that is nobody's business."""
    outside = root / "outside"
    (outside / "empty").mkdir(parents=True)
    (outside / "secret").write_text(SECRET * 6 + "\n")
    (outside / "secret.svg").write_text(SECRET * 6 + "\n")
    found = formnet.run(_two_robots())
    folder = found.save(root / "good")
    figures.draw(read_run(folder), files.subfolder(folder, "figures", made=True))
    write_report(folder)
    (folder / "logs").mkdir()
    (folder / "run.rrd").write_bytes(b"RRF2")
    for module in ("zenoh", "numpy", "formnet", "json", "typing"):
        said = outside / f"{module} was executed"
        (folder / f"{module}.py").write_text(f"open({str(said)!r}, 'w').close()\n")
    return folder


def _two_robots() -> dict[str, Any]:
    """A scenario in which something happens; drawing it takes a second."""
    with (CONFIGS / "paper" / "section5-delay.toml").open("rb") as stream:
        tables = tomllib.load(stream)
    cut = {"action": "cut", "at_s": 0.05, "links": [[1, 2]], "heal_after_s": 0.05}
    return tables | {
        "duration_s": 0.2,
        "robots": tables["robots"][:2],
        "formation": {"edges": [[1, 2]]},
        "timeline": [cut, {"action": "pause", "at_s": 0.1, "robots": 2, "resume_after_s": 0.05}],
    }
