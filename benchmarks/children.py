"""Processes of a benchmark: started together, one of them reports a number, none is left behind.

Children are started anew (``python -m <module> ...``) with their standard
input as a leash, as :mod:`lab.launch.launch` does it; each child's standard error goes
to a file, whose last line is told when the child fails.
"""

import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from benchmarks.table import BenchmarkError
from formnet.lab.launch.launch import LocalChild, end

GRACE_S = 3.0
"""How long children have to end by themselves once the number is known."""
POLL_S = 0.1


def reported(commands: Mapping[str, Sequence[str]], logs: Path, *, limit_s: float) -> float:
    """Run all ``commands`` (name to module and arguments); the first one's output is a number.

    Raises:
        BenchmarkError: a child failed, or the number did not come within ``limit_s``.
    """
    with running(commands, logs) as children:
        reporter = next(iter(children))
        deadline = time.monotonic() + limit_s
        while children[reporter].poll() is None:
            for name, child in children.items():
                if child.poll() not in (None, 0):
                    raise _failure(name, f"exited with code {child.returncode}", logs)
            if time.monotonic() > deadline:
                raise _failure(reporter, f"has not finished within {limit_s:.0f} s", logs)
            with suppress(subprocess.TimeoutExpired):
                children[reporter].wait(POLL_S)
        output = children[reporter].stdout
        assert output is not None
        text = output.read().decode(errors="replace").strip()
    try:
        return float(text.rpartition("\n")[2])
    except ValueError:
        raise _failure(reporter, f"reported {text!r} instead of a number", logs) from None


@contextmanager
def running(commands: Mapping[str, Sequence[str]], logs: Path) -> Iterator[dict[str, LocalChild]]:
    """All ``commands`` as processes; only the first one's standard output can be read."""
    logs.mkdir(parents=True, exist_ok=True)
    children: dict[str, LocalChild] = {}
    try:
        for name, command in commands.items():
            with (logs / f"{name}.log").open("wb") as log:
                children[name] = LocalChild(
                    [sys.executable, "-m", *command],
                    stdin=subprocess.PIPE,
                    stdout=log if children else subprocess.PIPE,  # the first one reports
                    stderr=log,
                    start_new_session=True,
                )
        yield children
    finally:
        _end(list(children.values()))


def _end(children: list[LocalChild]) -> None:
    end(children, time.monotonic() + GRACE_S)
    for child in children:
        if child.stdout is not None:
            child.stdout.close()


def _failure(name: str, what: str, logs: Path) -> BenchmarkError:
    lines = (logs / f"{name}.log").read_text(encoding="utf-8", errors="replace").split("\n")
    words = [line.strip() for line in lines if line.strip()]
    return BenchmarkError(f"{name} {what}" + (f": {words[-1]}" if words else ""))
