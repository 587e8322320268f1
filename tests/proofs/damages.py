"""What strangers do to a run's folder: files cut, swapped, linked, deep, long, huge, or another."""

import os
import random
import re
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

SECRET = "what lies outside, and is nobody's business "
FILES = ("scenario.toml", "verdict.json", "events.jsonl", "states.parquet", "links.parquet")
PLACES = (*FILES, "run.rrd", "report.html", "figures/paths.png", "figures/errors.svg")
_LONG = 2**24
SUBFOLDERS = ("figures", "logs", "csv")
Damage = Callable[[random.Random, Path, Path], None]
"""Does something to a run's folder; the last is a folder beside it, which is nobody's business."""


def _gone(path: Path) -> Path:
    """``path``, with nothing there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
    path.parent.mkdir(exist_ok=True)
    return path


def _content(path: Path) -> bytes:
    """What a file holds; nothing of one that is long, or that would be waited for."""
    if path.is_symlink() or not path.is_file() or path.stat().st_size > _LONG:
        return b""
    return path.read_bytes()


def _truncated(r: random.Random, run: Path, __: Path) -> None:
    file = run / r.choice(FILES)
    if file.is_file():
        os.truncate(file, r.randrange(file.stat().st_size + 1))


def _flipped(r: random.Random, run: Path, __: Path) -> None:
    file = run / r.choice(FILES)
    data = bytearray(_content(file))
    for _ in range(r.choice((1, 3, 30)) if data else 0):
        data[r.randrange(len(data))] = r.randrange(256)
    _gone(file).write_bytes(data)


def _swapped(r: random.Random, run: Path, __: Path) -> None:
    one, other = (run / name for name in r.sample(FILES, 2))
    if one.is_file() and other.is_file() and not (one.is_symlink() or other.is_symlink()):
        first, second = _content(one), _content(other)
        one.write_bytes(second)
        other.write_bytes(first)


def _missing(r: random.Random, run: Path, __: Path) -> None:
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


def _pipe(r: random.Random, run: Path, __: Path) -> None:
    os.mkfifo(_gone(run / r.choice((*PLACES, *SUBFOLDERS))))


def _a_folder(r: random.Random, run: Path, __: Path) -> None:
    _gone(run / r.choice(PLACES)).mkdir()


def _sparse(r: random.Random, run: Path, __: Path) -> None:
    with _gone(run / r.choice(PLACES)).open("wb") as stream:
        stream.write(r.choice((b"", b'{"a":[', b"PAR1", b'name = "x"\n', b"[")))
        stream.truncate(r.choice((2**24, 2**26, 2**31, 2**40)))


def _deep(r: random.Random, run: Path, __: Path) -> None:
    size = r.choice((200, 2000, 200_000))
    text = r.choice(("[" * size, '{"a":' * size, "a=" + "[" * size, "a" + ".a" * size + "=1"))
    text = r.choice((text, "[" + text + "]", "x=" + "{a=" * size))
    (_gone(run / r.choice((*FILES[:3], "claims.json", "nemesis.json")))).write_text(text + "\n")


def _long(r: random.Random, run: Path, __: Path) -> None:
    size = r.choice((10**5, 3 * 10**6, 2 * 10**7))
    text = r.choice(('"' + "x" * size, "9" * size, "[[],[]," * (size // 7), "a=1\n" * (size // 4)))
    name = r.choice((*FILES[:3], "claims.json", "nemesis.json"))
    if r.random() < 0.3:
        text = _content(run / name).decode(errors="replace") + text
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


def _numbers(r: random.Random, run: Path, __: Path) -> None:
    """Some number of a text, or word, becomes another value."""
    file = run / r.choice(FILES[:3])
    text = _content(file).decode(errors="replace")
    for _ in range(r.choice((1, 1, 1, 4))):
        found = list(
            re.finditer(r"(?<![\w.\"])-?\d+(\.\d+)?(e[-+]?\d+)?(?![\w.\"])|\"[^\"\n]*\"", text)
        )
        if found:
            hit = r.choice(found)
            text = text[: hit.start()] + r.choice(_NUMBERS) + text[hit.end() :]
    _gone(file).write_bytes(text.encode(errors="replace"))


def _encoded(r: random.Random, run: Path, __: Path) -> None:
    file = run / r.choice(FILES[:3])
    text = _content(file).decode(errors="replace") or "ü"
    _gone(file).write_bytes(
        text.encode(r.choice(("utf-16", "utf-32", "utf-8-sig", "cp500"))) + b"\xff"
    )


def _many(r: random.Random, run: Path, __: Path) -> None:
    place = run / r.choice(("figures", "logs", "cases", "."))
    place.mkdir(exist_ok=True)
    for number in range(2000):
        with suppress(OSError):
            (place / f"a{number}.png").touch()


def _lines(r: random.Random, run: Path, __: Path) -> None:
    """The lines of the events again and again, in another order, or without an end."""
    file = run / "events.jsonl"
    lines = _content(file).splitlines(keepends=True) or [b"{}\n"]
    kept = [r.choice(lines)[:10_000] for _ in range(r.choice((3, 300, 30_000)))]
    _gone(file).write_bytes(b"".join(kept) + r.choice((b"", b"{", b" " * 10**6)))


def _columns(r: random.Random, run: Path, __: Path) -> None:
    """A table with other values, types, columns or rows."""
    name = r.choice(FILES[3:])
    if not _content(run / name):
        return
    try:
        table = pq.read_table(run / name)
    except (OSError, pa.ArrowException):
        return
    index = r.randrange(table.num_columns)
    field = table.schema.field(index)
    rows = table.num_rows
    if not rows:
        return
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
            wild: tuple[object, ...] = (float("nan"), float("inf"), 1e308, -1e308, 1e-320, None)
            if pa.types.is_integer(field.type):
                wild = (0, -1, 2**62, 2**31 - 1, -(2**31))
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


def _bomb(r: random.Random, run: Path, __: Path) -> None:
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
