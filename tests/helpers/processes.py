"""What tests share that start processes: runs in the background, waiting, system packages."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import psutil
import pytest


def missing(package: str) -> NoReturn:
    """Skip the test for want of a system package; in CI, which installs it first, fail."""
    if "FORMNET_CI" in os.environ:
        pytest.fail(f"CI did not install {package}")
    pytest.skip(f"needs {package}")


def until(
    condition: Callable[[], object],
    what: str = "what was waited for",
    context: Callable[[], str] = str,
    timeout_s: float = 60.0,
) -> float:
    """Poll until ``condition`` holds; returns how many seconds it took."""
    start = time.monotonic()
    while not condition():
        if time.monotonic() - start > timeout_s:
            pytest.fail(f"{what} did not come within {timeout_s} s\n{context()}")
        time.sleep(0.02)
    return time.monotonic() - start


class Run:
    """``formnet run --no-figures ARGUMENTS --out OUT`` in the background."""

    def __init__(self, out: Path, *arguments: object, **environment: str) -> None:
        self.out, self.log = out, out.with_suffix(".log")
        command = [sys.executable, "-m", "formnet", "run", "--no-figures"]
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [*command, *map(str, arguments), "--out", str(out)],
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**os.environ, **environment},
            )

    def wait(self, timeout_s: float = 90.0) -> int:
        return self.process.wait(timeout_s)

    def output(self) -> str:
        return self.log.read_text(encoding="utf-8", errors="replace")

    def verdict(self) -> dict:
        return json.loads((self.out / "verdict.json").read_text(encoding="utf-8"))

    def events(self) -> list[dict]:
        path = self.out / "events.jsonl"
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        return [json.loads(line) for line in text.splitlines()]

    def until_event(self, kind: str) -> None:
        until(lambda: any(e["event"] == kind for e in self.events()), f"event {kind}", self.output)

    def children(self) -> list[psutil.Process]:
        """The processes that it started, and theirs, but for those that have ended."""
        found = psutil.Process(self.process.pid).children(recursive=True)
        return [c for c in found if c.is_running() and c.status() != psutil.STATUS_ZOMBIE]

    def child(self, *words: str) -> psutil.Process:
        """The one that has all of these arguments."""
        (found,) = [c for c in self.children() if set(words) <= set(c.cmdline())]
        return found

    def end(self) -> None:
        """Kill what is left of it."""
        if self.process.poll() is None:
            left = self.children()
            self.process.kill()
            for child in left:
                child.kill()
            self.process.wait()
