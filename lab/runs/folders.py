"""New folders for what a command leaves: nothing is overwritten, and no two commands share one."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from itertools import count
from pathlib import Path
from typing import TypeVar

Claimed = TypeVar("Claimed")


class RunExists(FileExistsError):
    """The place for a new folder or file is taken."""

    def __init__(self, place: Path) -> None:
        super().__init__(f"{place} exists already; nothing is overwritten")


def check_free(folder: Path) -> None:
    """See whether ``folder`` can be a new one; nothing is made.

    Raises:
        RunExists: ``folder`` exists and is not empty.
        OSError: it cannot be looked at.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise RunExists(folder)


def fresh_folder(folder: Path, first: str) -> Path:
    """Make ``folder``, or take it if it is empty, by making the file ``first`` in it.

    Of several commands that want one folder at the same time, at most one gets it.

    Raises:
        RunExists: ``folder`` exists and is not empty, or another command was faster.
        OSError: ``folder`` or ``first`` cannot be made.
    """
    there = folder.exists()
    try:
        check_free(folder)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / first).open("xb").close()
        if any(item.name != first for item in folder.iterdir()):  # another command, as fast
            (folder / first).unlink()
            raise RunExists(folder)
    except RunExists:
        raise
    except FileExistsError:
        raise RunExists(folder) from None
    except OSError as error:
        with suppress(OSError):
            if not there:
                folder.rmdir()
        raise OSError(error.errno, f"cannot be made: {error.strerror}", str(folder)) from None
    return folder


def forget(folder: Path, first: str) -> None:
    """Take an empty ``first`` away again, and ``folder`` if that was all: nothing came of it."""
    with suppress(OSError):
        if (folder / first).stat().st_size == 0:
            (folder / first).unlink()
            folder.rmdir()


@contextmanager
def filled(folder: Path, first: str) -> Iterator[Path]:
    """:func:`fresh_folder`, to be filled here: if that fails, nothing of it is left."""
    there = folder.exists()
    fresh_folder(folder, first)
    try:
        yield folder
    except BaseException:
        for file in folder.iterdir():
            with suppress(OSError):
                file.unlink()
        if not there:
            with suppress(OSError):
                folder.rmdir()
        raise


def claimed(out: Path | None, stem: str, claim: Callable[[Path], Claimed]) -> Claimed:
    """``claim(out)`` or, without ``out``, of ``runs/<stem>-<time>`` and -2, -3 if that is taken.

    Raises:
        RunExists: ``out`` is taken.
        OSError: what else ``claim`` raised.
    """
    if out is not None:
        return claim(out)
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    for number in count(1):
        with suppress(RunExists):
            return claim(Path("runs", f"{stem}-{stamp}" + (f"-{number}" if number > 1 else "")))
    raise AssertionError("there is always another number")
