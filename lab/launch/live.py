"""Runs that go on on this machine: where each can be watched stands in its folder meanwhile."""

import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pydantic_core import from_json

from formnet.lab.runs import files

FILE = "live.json"


@contextmanager
def noted(folder: Path, endpoint: str, run: str) -> Iterator[None]:
    """Say in a run's folder where it goes on, as long as it does; on a full disk, nowhere."""
    file = folder / FILE
    with suppress(OSError):
        files.replace(file, json.dumps({"endpoint": endpoint, "run": run}) + "\n")
    try:
        yield
    finally:
        with suppress(OSError):
            file.unlink()


def find(folder: Path | None) -> tuple[str, str]:
    """Endpoint and run of ``folder``; None: of the newest below ``runs``.

    Raises:
        LookupError: no run in progress there.
    """
    candidates = [folder / FILE] if folder is not None else list(Path("runs").glob(f"*/{FILE}"))
    there = [file for file in candidates if file.is_file()]
    if folder is not None and not folder.exists():
        raise LookupError(f"{folder}: no such folder")
    if not there:
        where = folder or "runs"
        raise LookupError(
            f"{where}: no run in progress there (on another machine: --connect with the "
            f"endpoint in {FILE} of the run folder there)"
        )
    with files.reading(max(there, key=lambda file: file.stat().st_mtime)) as stream:
        found = from_json(stream.read())
    return found["endpoint"], found["run"]
