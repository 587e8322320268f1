"""Files that are whole or not there."""

import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer


def replace(path: Path, data: "str | ReadableBuffer") -> None:
    """Put ``data`` (text as UTF-8) into ``path`` in one step: nobody ever reads half of it.

    Raises:
        OSError: it cannot be written; ``filename`` is ``path``, which is as it was.
    """
    with _beside(path) as part:
        with part.open("xb") as stream:
            stream.write(data.encode("utf-8") if isinstance(data, str) else data)
        part.replace(path)


def attempt(write: Callable[[], object]) -> list[OSError]:
    """Do it; returns the error, if one of the system's keeps it from being done."""
    try:
        write()
    except OSError as error:
        return [error]
    return []


@contextmanager
def _beside(path: Path) -> Iterator[Path]:
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        yield part
    except OSError as error:
        error.filename = str(path)
        error.filename2 = None
        raise
    finally:
        with suppress(OSError):
            part.unlink()
