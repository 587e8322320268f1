"""Run folders from strangers: mutated ones, through every command that reads one.

Each command runs in a forked child of one process that has the modules imported. It must end
without a traceback, within CPU_S seconds of processor time beyond what it takes of the folder that
was not mutated (drawing figures takes a second and a half) and MOST_BYTES of resident memory, and
leave what lies beside the folder as it was; nothing of what lies there may stand in what it says or
writes, and no other program may be started.
"""

import base64
import gc
import hashlib
import os
import random
import resource
import shutil
import signal
import sys
import tomllib
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, NoReturn

from proofs.damages import DAMAGES, SECRET, Damage

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
STARTS = {"subprocess.Popen", "os.posix_spawn", "os.exec", "os.system"}


class Call(NamedTuple):
    """How a command ended."""

    code: int
    said: str
    cpu_s: float
    resident: int


# --- what is done with it ------------------------------------------------------------------------


class _FarEnough(BaseException):
    """Here a command would begin to simulate, or to serve."""


def _far_enough(*_: object, **__: object) -> NoReturn:
    raise _FarEnough


def _open(run: Path, __: Path) -> None:
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
        setattr(verify, "engine", _far_enough)  # noqa: B010 (mypy: not exported)
        setattr(replay, "Viewer", _far_enough)  # noqa: B010
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


def _judged(name: str, call: Call, usual_s: float) -> Iterator[str]:
    if call.code not in (0, 1, 2, 3):
        yield f"{name} ended with {call.code}: {call.said.strip()[-600:]}"
    elif "Traceback" in call.said:
        yield f"{name}: traceback: {call.said.strip()[-600:]}"
    if call.cpu_s > usual_s + CPU_S:
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
        gc.collect()
        gc.freeze()  # a child that collects would copy all of this
        plain = shutil.copytree(good, root / "plain" / "runs" / "bad")
        shutil.rmtree(plain / "figures")  # so that report draws them, as it may have to
        usual_s = {
            command: _called(COMMANDS[command], plain, good, root / "log").cpu_s
            for command in commands
        }
        for number in range(first, first + folders):
            if stopped():
                break
            r = random.Random(f"{seed}/{number}")
            place = root / str(number)
            run, outside = place / "runs" / "bad", place / "outside"
            shutil.copytree(good, run)
            shutil.copytree(root / "outside", outside)
            done = [r.choice(DAMAGES) for _ in range(r.choice((1, 1, 2, 3)))]
            _in_another(partial(_damage, r, run, outside, done))
            before = _state(outside), _state(good)
            what = f"folder {number} ({', '.join(some.__name__.strip('_') for some in done)})"
            for command in commands:
                call = _called(COMMANDS[command], run, good, place / "log")
                calls[command] += 1
                most_cpu_s = max(most_cpu_s, call.cpu_s)
                most_resident = max(most_resident, call.resident)
                failures += [f"{what}: {text}" for text in _judged(command, call, usual_s[command])]
            if (_state(outside), _state(good)) != before:
                failures.append(f"{what}: something outside was changed")
            failures += [f"{what}: {file} has what lies outside" for file in _leaks(run)]
            shutil.rmtree(place)
    gc.unfreeze()
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
