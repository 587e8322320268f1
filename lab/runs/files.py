"""Files of a run's folder, which may be anybody's.

They are written whole or not at all: half of one is never seen, and never left behind. Of what
lies in such a folder no symbolic link is followed, whether it is read or written.
"""

import errno
import os
import secrets
import shutil
import stat
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from io import FileIO
from itertools import islice
from pathlib import Path
from typing import IO

from formnet.netem.files import regular
from formnet.netem.files.regular import blamed_on

_NO_HARD_LINKS = (errno.EPERM, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EMLINK)
"""What link(2) says on file systems that have no hard links (FAT, some on networks)."""


MOST_BYTES = 2**26
"""A longer file in a run's folder is not read, but for tables."""
MOST_VALUES = 3_000_000
"""JSON with more values is not read: each takes some hundred bytes of memory."""
MOST_NAMES = 10_000
"""How many names of a folder that may be anybody's are looked at."""


def write_new(path: Path, data: str | bytes, mode: int = 0o666) -> None:
    """Write a new file, text as UTF-8, with the permissions ``mode`` less the umask.

    It appears under its name once it is whole, and nothing is ever overwritten.

    Raises:
        FileExistsError: there is something of that name.
        OSError: it cannot be written; nothing is left behind.

    Either names ``path`` as its ``filename``.
    """
    content = as_bytes(data)
    with blamed_on(path):
        if os.path.lexists(path):  # before anything is written: the disk may be full
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
        with _part(path.parent, mode) as (part, stream):
            stream.write(content)
            stream.close()
            _name(part, path, mode)


@contextmanager
def new(path: Path) -> Iterator[IO[bytes]]:
    """A new file to write to, which appears under its name once it is whole.

    Raises:
        FileExistsError: there is something of that name; nothing is overwritten.
        OSError: it cannot be written; nothing is left behind.
    """
    with _part(path.parent, 0o666) as (part, stream):
        yield stream
        stream.close()
        with blamed_on(path):
            _name(part, path, 0o666)


def replace(path: Path, data: str | bytes) -> None:
    """Write a file, text as UTF-8, in the place of what is there.

    Who reads it sees the old file or the new one, whole. Permissions stay. What is no regular
    file, such as a link, is not followed or written to: the new file takes its place.

    Raises:
        OSError: it cannot be written; what was there still is. ``filename`` is ``path``.
    """
    content = as_bytes(data)
    with blamed_on(path):
        try:
            before = path.lstat().st_mode
        except FileNotFoundError:
            before = 0
        with _part(path.parent, 0o666) as (part, stream):
            stream.write(content)
            stream.close()
            if stat.S_ISREG(before) and before & 0o777:
                part.chmod(before & 0o777)
            part.replace(path)


def write_to(path: Path, data: str | bytes) -> None:
    """:func:`replace`, of a path that the user named.

    A symbolic link is followed, and what is no regular file, such as a pipe, is written to.

    Raises:
        OSError: as there.
    """
    with blamed_on(path):
        if path.exists() and not path.is_file():
            with path.open("wb") as stream:
                stream.write(as_bytes(data))
            return
        replace(path.resolve(), data)


def replace_all(new: Sequence[tuple[Path, bytes, int]]) -> None:
    """Write files with their permissions in the place of what is there, links included.

    All are on the disk before the first takes its place, and they take it in this order.

    Raises:
        OSError: one cannot be written, and none was replaced; or one cannot be replaced.
            ``filename`` is its path.
    """
    with ExitStack() as parts:
        ready = []
        for path, content, mode in new:
            with blamed_on(path):
                part, stream = parts.enter_context(_part(path.parent, mode))
                stream.write(content)
                stream.close()
                ready.append((part, path))
        for part, path in ready:
            with blamed_on(path):
                part.replace(path)


def reading(path: Path, most_bytes: int = MOST_BYTES) -> IO[bytes]:
    """Open a file in a folder that may be anybody's (:func:`netem.files.regular.reading`)."""
    return regular.reading(path, most_bytes)


def read_json(path: Path) -> bytes:
    """JSON in a folder that may be anybody's, not parsed; of at most MOST_VALUES values.

    Raises:
        OSError: as :func:`reading`, or it has more.
    """
    with reading(path) as stream:
        content = stream.read(MOST_BYTES)
    if sum(map(content.count, (b",", b"[", b"{"))) > MOST_VALUES:
        raise OSError(errno.EFBIG, f"it has more than {MOST_VALUES} values", str(path))
    return content


def subfolder(folder: Path, name: str, *, made: bool = False) -> Path:
    """A folder in one that may be anybody's; ``made``: it is made if it is not there.

    Raises:
        OSError: it is a symbolic link, which is not followed, or no folder, or cannot be made.
    """
    place = folder / name
    with blamed_on(place):
        if made:
            with suppress(FileExistsError):
                place.mkdir()
        try:
            mode = place.lstat().st_mode
        except FileNotFoundError:
            return place
        if stat.S_ISLNK(mode):
            raise OSError(errno.ELOOP, "it is a symbolic link, which is not followed")
        if not stat.S_ISDIR(mode):
            raise OSError(errno.ENOTDIR, "it is no folder")
    return place


def is_file(folder: Path, name: str) -> bool:
    """Whether a folder that may be anybody's has a regular file of that name; no link is one."""
    return _is(stat.S_ISREG, folder / name)


def is_folder(path: Path) -> bool:
    """Whether there is a folder; no link is one."""
    return _is(stat.S_ISDIR, path)


def _is(kind: Callable[[int], bool], path: Path) -> bool:
    try:
        return kind(path.lstat().st_mode)
    except (OSError, ValueError):
        return False


def names(folder: Path) -> list[str]:
    """What is in a folder that may be anybody's, ascending; of MOST_NAMES at most.

    Raises:
        OSError: it cannot be looked into.
    """
    with os.scandir(folder) as found:
        return sorted(entry.name for entry in islice(found, MOST_NAMES))


def appending(path: Path) -> IO[str]:
    """A file of ours, to add lines to; no link is followed. Raises OSError."""
    return open(path, "a", encoding="utf-8", opener=_no_links)


def binary(path: Path, *, made: bool) -> FileIO:
    """A file of ours to write to, unbuffered: a new one, or (``made``) one that is there.

    Raises:
        OSError: there is one, or (``made``) none, or it is a link.
    """
    return open(path, "r+b" if made else "xb", buffering=0, opener=_no_links)


def _no_links(path: str, flags: int) -> int:
    return os.open(path, flags | regular.NO_LINKS, 0o666)


def as_bytes(data: str | bytes) -> bytes:
    """Text as UTF-8; what is none, such as a part of a file's name, is escaped."""
    return data.encode("utf-8", "backslashreplace") if isinstance(data, str) else data


def as_text(path: Path) -> str:
    """The last name of ``path`` as text, whatever bytes it is made of."""
    return os.fsencode(path.name).decode("utf-8", "backslashreplace")


def attempt(write: Callable[[], object]) -> list[OSError]:
    """Do it; returns the error, if one of the system's keeps it from being done."""
    try:
        write()
    except OSError as error:
        return [error]
    return []


@contextmanager
def _part(folder: Path, mode: int) -> Iterator[tuple[Path, IO[bytes]]]:
    """A file of some new name in ``folder``, which is gone in the end unless it was moved."""
    part = folder / f".formnet-{secrets.token_hex(8)}.part"
    stream = _created(part, mode)
    try:
        with stream:
            yield part, stream
    finally:
        part.unlink(missing_ok=True)


def _name(part: Path, path: Path, mode: int) -> None:
    """Give ``part`` the name ``path``; raises FileExistsError if something has it."""
    try:
        os.link(part, path)  # unlike rename(2), this does not replace what is there
    except OSError as error:
        if error.errno not in _NO_HARD_LINKS:
            raise
        with _created(path, mode) as stream:
            try:
                with part.open("rb") as source:
                    shutil.copyfileobj(source, stream)
            except BaseException:
                path.unlink()
                raise


def _created(path: Path, mode: int) -> IO[bytes]:
    """A file that was not there: O_EXCL follows no link either (open(2))."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | regular.NO_LINKS
    return os.fdopen(os.open(path, flags, mode), "wb")
