"""Files written whole or not at all: half of one is never seen, and never left behind."""

import errno
import os
import secrets
import stat
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO

_NO_LINKS = (errno.EPERM, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EMLINK)
"""What link(2) says on file systems that have no hard links (FAT, some on networks)."""


MOST_BYTES = 2**26
"""A longer file in a run's folder is not read, but for tables."""
_NO_SURPRISES = sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC"))


def write_new(path: Path, data: str | bytes, mode: int = 0o666) -> None:
    """Write a new file, text as UTF-8, with the permissions ``mode`` less the umask.

    It appears under its name once it is whole, and nothing is ever overwritten.

    Raises:
        FileExistsError: there is something of that name.
        OSError: it cannot be written; nothing is left behind.

    Either names ``path`` as its ``filename``.
    """
    content = as_bytes(data)
    with _blamed_on(path):
        if os.path.lexists(path):  # before anything is written: the disk may be full
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
        with _part(path.parent, content, mode) as part:
            try:
                os.link(part, path)  # unlike rename(2), this does not replace what is there
            except OSError as error:
                if error.errno not in _NO_LINKS:
                    raise
                _create(path, content, mode)


def replace(path: Path, data: str | bytes) -> None:
    """Write a file, text as UTF-8, in the place of what is there, which keeps its permissions.

    Who reads it sees the old file or the new one, whole. A symbolic link is followed, and what is
    no regular file, such as a pipe, is written to.

    Raises:
        OSError: it cannot be written; what was there still is. ``filename`` is ``path``.
    """
    content = as_bytes(data)
    with _blamed_on(path):
        try:
            before = path.stat().st_mode
        except FileNotFoundError:
            before = stat.S_IFREG
        if not stat.S_ISREG(before):
            with path.open("wb") as stream:
                stream.write(content)
            return
        target = path.resolve()
        with _part(target.parent, content, 0o666) as part:
            if stat.S_IMODE(before):
                part.chmod(stat.S_IMODE(before))
            part.replace(target)


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
            with _blamed_on(path):
                ready.append((parts.enter_context(_part(path.parent, content, mode)), path))
        for part, path in ready:
            with _blamed_on(path):
                part.replace(path)


def reading(path: Path, most_bytes: int = MOST_BYTES) -> IO[bytes]:
    """Open a file in a folder that may be anybody's: a regular one, of at most so many bytes.

    Raises:
        OSError: it is not there, is longer, or is a link, a pipe or a device, none of which is
            followed or waited for. ``filename`` is ``path``.
    """
    with _blamed_on(path):
        try:
            handle = os.open(path, os.O_RDONLY | _NO_SURPRISES)
        except OSError as error:
            if error.errno == errno.ELOOP:
                error.strerror = "it is a symbolic link, which is not followed"
            raise
        try:
            found = os.fstat(handle)
            if not stat.S_ISREG(found.st_mode):
                raise OSError(errno.EINVAL, "it is no regular file")
            if found.st_size > most_bytes:
                raise OSError(errno.EFBIG, f"it is longer than {most_bytes >> 20} MiB")
        except OSError:
            os.close(handle)
            raise
        return os.fdopen(handle, "rb")


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
def _part(folder: Path, content: bytes, mode: int) -> Iterator[Path]:
    """A file of some new name in ``folder``, which is gone in the end unless it was moved."""
    part = folder / f".formnet-{secrets.token_hex(8)}.part"
    _create(part, content, mode)
    try:
        yield part
    finally:
        part.unlink(missing_ok=True)


def _create(path: Path, content: bytes, mode: int) -> None:
    """A file that was not there; none if it cannot be written whole."""
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
    except BaseException:
        path.unlink()
        raise


@contextmanager
def _blamed_on(path: Path) -> Iterator[None]:
    """Every OSError is one of ``path``, whichever file or descriptor it was about."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
