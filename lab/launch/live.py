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
    candidates = [folder / FILE] if folder is not None else _below(Path("runs"))
    there = [file for file in candidates if files.is_file(file.parent, FILE)]
    if folder is not None and not folder.exists():
        raise LookupError(f"{folder}: no such folder")
    if not there:
        where = folder or "runs"
        raise LookupError(
            f"{where}: no run in progress there (on another machine: --connect with the "
            f"endpoint in {FILE} of the run folder there)"
        )
    newest = max(there, key=lambda file: file.stat().st_mtime)
    try:
        found = from_json(files.read_json(newest))
        endpoint, run = found["endpoint"], found["run"]
        if not isinstance(endpoint, str) or not isinstance(run, str):
            raise TypeError
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise LookupError(f"{newest}: does not say where a run goes on") from error
    return endpoint, run


def _below(folder: Path) -> list[Path]:
    """The files of runs in a folder of runs."""
    try:
        return [folder / name / FILE for name in files.names(folder)]
    except OSError:
        return []
