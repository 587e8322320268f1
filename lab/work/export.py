"""``formnet export``: a run for other programs, as CSV or MCAP."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.csv

from formnet.formation.scenario.loading import ScenarioError
from formnet.lab.runs import files
from formnet.lab.runs.events_file import read_events
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT, in_words
from formnet.lab.runs.exits import of as code_of
from formnet.lab.runs.folders import RunExists, filled
from formnet.lab.runs.recording import LINKS, LINKS_SCHEMA, STATES, STATES_SCHEMA
from formnet.lab.runs.tables import read_table
from formnet.lab.text.console import Console, escape
from formnet.lab.text.problems import report_problems
from formnet.lab.verdict.files import Unreadable
from formnet.lab.verdict.recorded import Recorded, read_whole


def export_run(folder: Path, kind: str, out: Path | None) -> int:
    """Write a run as ``kind``, to a place of its own; the exit code of ``formnet export``."""
    console = Console(stderr=True, highlight=False)
    write, name = _FORMATS[kind]
    place = out or folder / name
    try:
        run = read_whole(folder)
        write(run, files.subfolder(folder, name) if out is None and kind == "csv" else place)
    except ScenarioError as error:
        report_problems(console, error)
        return BAD_INPUT
    except Unreadable as error:
        console.print(f"[red]{escape(str(folder))}:[/] {escape(str(error))}", soft_wrap=True)
        return BAD_INPUT
    except OSError as error:
        if error.errno is not None and error.filename is None:
            error.filename = str(place)
        console.print(f"[red]not written:[/] {escape(in_words(error))}", soft_wrap=True)
        return code_of(error)
    console.print(f"written: {escape(str(place))}", soft_wrap=True)
    return ALL_HOLD


def write_csv(run: Recorded, folder: Path) -> None:
    """``states.csv``, ``links.csv`` and ``events.csv``, with the columns of the run's own files.

    Raises:
        RunExists: ``folder`` exists and is not empty.
        OSError: a file cannot be read or written.
    """
    with filled(folder, "events.csv"):
        _write_all(run, folder)


def _write_all(run: Recorded, folder: Path) -> None:
    for name, schema in ((STATES, STATES_SCHEMA), (LINKS, LINKS_SCHEMA)):
        table = read_table(run.folder / name, schema)
        _write_csv(table, (folder / name).with_suffix(".csv"))
    lines = list(read_events(run.folder, run.scenario.vehicles))
    records = [line.record for line in lines]
    events = {
        "t_s": [record.t_ns / 1e9 for record in records],
        "event": [record.name for record in records],
        "wall": [line.wall for line in lines],
        "details": [json.dumps(record.details, ensure_ascii=False) for record in records],
    }
    _write_csv(pa.table(events), folder / "events.csv")


def _write_csv(table: pa.Table, file: Path) -> None:
    whole = pa.BufferOutputStream()
    pyarrow.csv.write_csv(table, whole)
    files.replace(file, whole.getvalue().to_pybytes())


def write_mcap(run: Recorded, file: Path) -> None:
    """One MCAP file (:mod:`formnet.lab.scene.foxglove`).

    Raises:
        RunExists: ``file`` exists.
        ModuleNotFoundError: there is no package mcap.
        OSError: the file cannot be written.
    """
    from formnet.lab.scene import foxglove

    if os.path.lexists(file):
        raise RunExists(file)
    file.parent.mkdir(parents=True, exist_ok=True)
    with files.new(file) as stream:
        foxglove.write(run, stream)


_FORMATS: dict[str, tuple[Callable[[Recorded, Path], None], str]] = {
    "csv": (write_csv, "csv"),
    "mcap": (write_mcap, "run.mcap"),
}
