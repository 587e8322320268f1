"""Reading files that may be anybody's: regular ones, of bounded length."""

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

NO_LINKS: int = getattr(os, "O_NOFOLLOW", 0)
_NO_SURPRISES = sum(getattr(os, name, 0) for name in ("O_NONBLOCK", "O_CLOEXEC"))


def reading(path: Path, most_bytes: int, *, follow: bool = False) -> IO[bytes]:
    """Open a regular file of at most so many bytes.

    ``follow``: the user named it, and it may be a symbolic link; in a folder that may be anybody's
    it may not (open(2), O_NOFOLLOW). No pipe and no device is waited for.

    Raises:
        OSError: it is not there, is longer, is none, or has a name that no file can have.
            ``filename`` is ``path``.
    """
    with blamed_on(path):
        try:
            handle = os.open(path, os.O_RDONLY | _NO_SURPRISES | (0 if follow else NO_LINKS))
        except OSError as error:
            if error.errno == errno.ELOOP and not follow:
                error.strerror = "it is a symbolic link, which is not followed"
            raise
        except ValueError as error:  # a null character in its name
            raise OSError(errno.EINVAL, str(error)) from None
        try:
            found = os.fstat(handle)
            if not stat.S_ISREG(found.st_mode):
                raise OSError(errno.EINVAL, "it is no regular file")
            if found.st_size > most_bytes:
                raise OSError(errno.EFBIG, f"it is longer than {in_words(most_bytes)}")
        except OSError:
            os.close(handle)
            raise
        return os.fdopen(handle, "rb")


def read(path: Path, most_bytes: int, *, follow: bool = False) -> bytes:
    """All of such a file; raises as :func:`reading`. One that grows meanwhile is cut."""
    with reading(path, most_bytes, follow=follow) as stream:
        return stream.read(most_bytes)


def in_words(count: int) -> str:
    """A number of bytes for people."""
    return f"{count >> 20} MiB" if count >= 2**20 else f"{count} bytes"


@contextmanager
def blamed_on(path: Path) -> Iterator[None]:
    """Every OSError is one of ``path``, whichever file or descriptor it was about."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
