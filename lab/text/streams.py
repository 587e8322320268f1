"""Standard output and error that do not end a command: what cannot be printed is left out.

A character that the terminal's encoding lacks is escaped, a pipe that is closed takes no more, and
a stream that was closed from the beginning leads nowhere. Characters that would act on a terminal
or hide in a log are escaped, whoever prints them; only a console writes its own styles past that.
"""

import errno
import io
import os
import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO, TYPE_CHECKING, Any, cast

from formnet.netem.files.printable import printable

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

_GONE = {errno.EPIPE, errno.ECONNRESET, errno.EIO}
"""Nobody reads any more: a pipe that is closed, a terminal that was hung up."""


class _Raw(io.RawIOBase):
    """Writes to a file descriptor; after an error, nowhere. ``error`` is the first one."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self.error: OSError | None = None

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._descriptor

    def isatty(self) -> bool:
        return os.isatty(self._descriptor)

    def write(self, data: "ReadableBuffer") -> int:
        size = memoryview(data).nbytes
        while self.error is None:
            try:
                return os.write(self._descriptor, data)
            except BlockingIOError:  # whoever reads has made it so
                select.select([], [self._descriptor], [])
            except OSError as error:
                self.error = error
        return size


class _Printable(io.TextIOWrapper):
    """Takes text of any characters, of which those that act or hide are escaped."""

    def write(self, text: str) -> int:
        return super().write(printable(text, lines=True))


class _Styled:
    """The same stream for what escapes by itself, and writes styles."""

    def __init__(self, stream: _Printable) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        return io.TextIOWrapper.write(self._stream, text)


def styled(stream: IO[str]) -> IO[str]:
    """``stream`` without the escaping, for a console that does it before it adds its styles."""
    return cast(IO[str], _Styled(stream)) if isinstance(stream, _Printable) else stream


def _stream(descriptor: int, encoding: str, *, lines: bool) -> tuple[io.TextIOWrapper, _Raw]:
    raw = _Raw(descriptor)
    text = _Printable(
        io.BufferedWriter(raw), encoding, "backslashreplace", line_buffering=lines or raw.isatty()
    )
    return text, raw


@contextmanager
def lenient() -> Iterator[list[OSError]]:
    """Standard output and error are such streams meanwhile.

    At the end, the list holds what went wrong with them, but for readers that are gone.
    """
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:  # closed: the next file that is opened would take its place
            os.open(os.devnull, os.O_RDWR)
    before = sys.stdout, sys.stderr
    encodings = [getattr(stream, "encoding", None) or "utf-8" for stream in before]
    sys.stdout, out = _stream(1, encodings[0], lines=False)
    sys.stderr, err = _stream(2, encodings[1], lines=True)
    trouble: list[OSError] = []
    try:
        yield trouble
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(ValueError):  # somebody closed it
                stream.flush()
        found = [raw.error for raw in (out, err) if raw.error is not None]
        trouble += [error for error in found if error.errno not in _GONE]
