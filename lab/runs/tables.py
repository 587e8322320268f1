"""The tables of a run's folder, ``states.parquet`` and ``links.parquet``, read back.

A folder may be anybody's, so a file says what it holds before it is read: as many rows as the
scenario can have made, of the columns and types that are written, and not packed tighter than they
are. A file of some megabytes can otherwise unpack to any size.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from formnet.formation.records.rows import LinkRow, Sample
from formnet.formation.scenario.model import Scenario
from formnet.lab.runs import files
from formnet.lab.runs.recording import LINKS, LINKS_SCHEMA, STATES, STATES_SCHEMA
from formnet.netem.core.transit import FATES
from formnet.netem.files.tables import nanoseconds

MOST_ROWS = 4_000_000
"""A table that is longer is not read: as Python's objects a row takes some 500 bytes of memory,
however little it takes in the file."""
MOST_BYTES_OF_A_ROW, _MOST_BYTES_BESIDE = 200, 2**20
_CODECS = {"SNAPPY", "UNCOMPRESSED"}
"""What is written (Snappy unpacks to some twenty times as much at most; Zstandard has no bound)."""
_ENCODINGS = {"PLAIN", "RLE", "BIT_PACKED", "PLAIN_DICTIONARY", "RLE_DICTIONARY"}
"""What is written (others hold any number of values in some bytes)."""
_AT_ONCE = 2**16
"""So many rows of a table are turned into Python's objects at once."""
_MOST_IN_LIST, _MOST_IN_TEXT = 10_000, 2**20
"""Of the file's metadata: row groups and columns, and a text."""
_TWINS, _SPARE = 2, 10
"""A message can be duplicated once. Clocks in real time may add a few instants."""


def read_states(folder: Path, scenario: Scenario | None = None) -> list[Sample]:
    """The samples in a run's folder; of ``scenario``, if that is known.

    Raises:
        OSError, ValueError: there is no such table, or it is another.
    """
    table = read_table(folder / STATES, STATES_SCHEMA, most_samples(scenario))
    _no_nulls(table, STATES, STATES_SCHEMA.names[:-2])  # the kinematic level has no torques
    if scenario is not None:
        _check_states(table, scenario)
    return [Sample(*row) for row in _rows(table)]


def read_links(folder: Path, scenario: Scenario | None = None) -> list[LinkRow]:
    """The fates of messages in a run's folder; raises as :func:`read_states`."""
    table = read_table(folder / LINKS, LINKS_SCHEMA, _most_messages(scenario))
    _no_nulls(table, LINKS, [name for name in LINKS_SCHEMA.names if name != "t_usable_ns"])
    if scenario is not None:
        _check_links(table, scenario)
    return [LinkRow(*row) for row in _rows(table)]


def read_table(
    file: Path, schema: pa.Schema, most_rows: int = MOST_ROWS, columns: list[str] | None = None
) -> pa.Table:
    """A table in a run's folder, or these of its columns.

    Raises:
        OSError, ValueError: there is no such table, or one that is too long or another.
    """
    names = schema.names if columns is None else columns
    most_bytes = most_rows * MOST_BYTES_OF_A_ROW + _MOST_BYTES_BESIDE
    try:
        with files.reading(file, most_bytes) as stream:  # its name may be no text
            size = stream.seek(0, 2)
            stream.seek(0)
            parquet = pq.ParquetFile(
                stream,
                thrift_string_size_limit=_MOST_IN_TEXT,
                thrift_container_size_limit=_MOST_IN_LIST,
            )
            _check_metadata(file.name, parquet, schema, names, most_rows, size)
            # With threads, a process that ends early under load aborts at its end more often.
            found = parquet.read(names, use_threads=False)
            if len(found) != parquet.metadata.num_rows:
                raise ValueError(f"{file.name} has other rows than it says")
            return found
    except (pa.ArrowException, MemoryError, OverflowError) as error:  # pyarrow has many
        raise ValueError(f"{file.name} is damaged: {str(error)[:200]}") from None


def most_samples(scenario: Scenario | None) -> int:
    """How many rows ``states.parquet`` of a run can have."""
    if scenario is None:
        return MOST_ROWS
    return min(MOST_ROWS, len(scenario.robots) * _instants(scenario))


def _most_messages(scenario: Scenario | None) -> int:
    if scenario is None:
        return MOST_ROWS
    links = 2 * len(scenario.formation.edges)
    return min(MOST_ROWS, _TWINS * links * _instants(scenario))


def _instants(scenario: Scenario) -> int:
    """Of broadcasts, at which robots are sampled too; and the end of the run."""
    return scenario.ticks // max(1, scenario.clock.broadcast_every) + _SPARE


def _check_metadata(
    name: str,
    parquet: pq.ParquetFile,
    schema: pa.Schema,
    names: list[str],
    most_rows: int,
    size: int,
) -> None:
    found, types = parquet.metadata, parquet.schema_arrow
    if found.num_rows > most_rows:
        raise ValueError(f"{name} has {found.num_rows} rows; at most {most_rows} are read")
    if size > found.num_rows * MOST_BYTES_OF_A_ROW + _MOST_BYTES_BESIDE:
        raise ValueError(f"{name} has {size} bytes for {found.num_rows} rows")
    for wanted in names:
        if types.names.count(wanted) != 1:
            raise ValueError(f"{name} must have one column {wanted}")
        must, is_ = (_with_any_index(some.field(wanted).type) for some in (schema, types))
        if must != is_:
            raise ValueError(f"{name}, column {wanted}: must be {must}, not {str(is_)[:60]}")
    for group in range(found.num_row_groups):
        row_group = found.row_group(group)
        for index in range(row_group.num_columns):
            column = row_group.column(index)
            if column.compression not in _CODECS:
                raise ValueError(f"{name} is compressed with {column.compression}; must be SNAPPY")
            if other := set(column.encodings) - _ENCODINGS:
                raise ValueError(
                    f"{name} is encoded as {min(other)}; must be PLAIN or a dictionary"
                )


def _with_any_index(type_: pa.DataType) -> pa.DataType:
    """The type of a column; of a dictionary's indices each version of Arrow has its own."""
    if not pa.types.is_dictionary(type_):
        return type_
    return pa.dictionary(pa.int32(), type_.value_type, type_.ordered)


def _no_nulls(table: pa.Table, name: str, columns: list[str]) -> None:
    for column in columns:
        if table.column(column).null_count:
            raise ValueError(f"{name}, column {column}: has empty cells")


def _check_states(table: pa.Table, scenario: Scenario) -> None:
    """Whole instants, which ascend within the run, of the robots in their order."""
    count = len(scenario.robots)
    robots, t_ns = (table.column(name).to_numpy() for name in ("robot", "t_ns"))
    if len(robots) % count or not np.array_equal(
        robots, np.tile(scenario.ids, len(robots) // count)
    ):
        raise ValueError(f"{STATES} is not about the scenario's robots in their order")
    instants = t_ns.reshape(-1, count)
    ascend = bool((np.diff(instants[:, 0]) > 0).all()) if len(instants) else True
    end_ns = nanoseconds(scenario.duration_s)
    if not ascend or (instants != instants[:, :1]).any() or _outside(t_ns, end_ns):
        raise ValueError(f"{STATES}: t_ns must ascend from 0 to the end of the run")


def _check_links(table: pa.Table, scenario: Scenario) -> None:
    """Messages of links that there are, within the run."""
    known = np.array([source << 32 | other for source, other in scenario.directed_links])
    source, other, sent, sequence = (
        table.column(name).to_numpy().astype(np.int64)
        for name in ("source", "destination", "t_sent_ns", "sequence")
    )
    if not np.isin(source << 32 | other, known).all():
        raise ValueError(f"{LINKS} is about links that the scenario has not")
    if _outside(sent, nanoseconds(scenario.duration_s)) or (sequence < 0).any():
        raise ValueError(f"{LINKS}: messages must be sent within the run, their numbers from 0")
    usable = table.column("t_usable_ns").drop_null().to_numpy()
    if _outside(usable, 2**62):
        raise ValueError(f"{LINKS}: t_usable_ns must be from 0 to 2^62")
    for piece in table.column("fate").chunks:
        words = piece.dictionary
        if len(words) > len(FATES) or not FATES.issuperset(words.to_pylist()):
            raise ValueError(f"{LINKS}: fates must be of {', '.join(sorted(FATES))}")


def _outside(values: Any, end: int) -> bool:
    return bool(len(values)) and bool(values.min() < 0 or values.max() > end)


def _rows(table: pa.Table) -> Iterator[tuple[Any, ...]]:
    for piece in table.to_batches(_AT_ONCE):
        yield from zip(*(column.to_pylist() for column in piece.columns), strict=True)
