"""The files of code that the user has allowed: by path and content, as direnv does.

They stand in one file of the user's own, which nobody else may write. A file that has changed
since is not allowed any more, nor is a copy of it somewhere else.
"""

import hashlib
import os
import re
import stat
from collections.abc import Mapping
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from formnet.agent.law_file import MOST_BYTES
from formnet.lab.runs import files

MOST_FILES = 1000
"""Of one folder."""
_MOST_LIST = 2**22
_LIST = TypeAdapter(dict[str, str])


class BadList(ValueError):
    """The list cannot be trusted or read; the text names it and says why, and what to do."""


def place() -> Path:
    """Where the list is: ``formnet/allowed.json`` in XDG_CONFIG_HOME (XDG Base Directory)."""
    base = os.environ.get("XDG_CONFIG_HOME", "")
    home = Path(base) if os.path.isabs(base) else Path.home() / ".config"
    return home / "formnet" / "allowed.json"


def listed() -> dict[str, str]:
    """Each allowed file (absolute, without links) and the SHA-256 of what it may contain.

    Raises:
        BadList: others could have written it, or it is not what ``allow`` writes.
    """
    path = place()
    try:
        for some in (path.parent, path):
            _check(some)
        with files.reading(path, _MOST_LIST) as stream:
            return _LIST.validate_json(stream.read(), strict=True)
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise BadList(f"{path} cannot be read: {error.strerror}") from None
    except ValidationError:
        raise BadList(
            f"{path} is not what `formnet allow` writes: remove it, and allow anew"
        ) from None


def has(path: Path, sha256: str) -> bool:
    """Whether ``path``, with content of this SHA-256, may be executed. Raises BadList."""
    return listed().get(str(path)) == sha256


def allow(folder: Path) -> dict[Path, str]:
    """Allow every file of Python in ``folder`` and below, as it is now; what was allowed there
    before and is gone or changed is not any more. Returns them with their SHA-256.

    Hidden files and folders are left out, and no link is followed.

    Raises:
        OSError: one cannot be read, is too long, or there are too many.
        BadList: see :func:`listed`.
    """
    root = folder.resolve(strict=True)
    found: dict[Path, str] = {}
    for path in _below(root):
        if len(found) == MOST_FILES:
            raise OSError(None, f"there are more than {MOST_FILES} files of Python", str(folder))
        with files.reading(path, MOST_BYTES) as stream:
            found[path] = hashlib.sha256(stream.read()).hexdigest()
    _write({**_outside(root), **{str(path): digest for path, digest in found.items()}})
    return found


def forget(folder: Path) -> int:
    """Allow nothing in ``folder`` and below any more; returns how many files that were.

    Raises:
        BadList: see :func:`listed`.
        OSError: the list cannot be written.
    """
    left = _outside(folder.resolve())
    gone = len(listed()) - len(left)
    if gone:
        _write(left)
    return gone


def _outside(root: Path) -> dict[str, str]:
    return {path: digest for path, digest in listed().items() if root not in Path(path).parents}


def _below(root: Path) -> list[Path]:
    """Files of Python, ascending; only names that ``law.kind`` can say."""
    found = []
    for folder, folders, names in os.walk(root, onerror=_raise):
        folders[:] = [name for name in folders if _NAME.fullmatch(name)]
        found += [
            Path(folder, name)
            for name in names
            if name.endswith(".py")
            and _NAME.fullmatch(name)
            and stat.S_ISREG(os.lstat(Path(folder, name)).st_mode)
        ]
    return sorted(found)


_NAME = re.compile(r"\w[\w.-]*", re.ASCII)


def _raise(error: OSError) -> None:
    raise error


def _check(path: Path) -> None:
    """Whether ``path`` is the user's, and only theirs to write. Raises BadList, OSError."""
    found = path.lstat()
    if stat.S_ISLNK(found.st_mode) or found.st_uid != os.getuid():
        raise BadList(f"{path} is a link, or somebody else's: it is not trusted; remove it")
    if found.st_mode & 0o022:
        raise BadList(f"{path} can be written by others: chmod go-w it, if its content is yours")


def _write(content: Mapping[str, str]) -> None:
    path = place()
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    _check(path.parent)
    data = _LIST.dump_json(dict(sorted(content.items())), indent=1) + b"\n"
    files.replace(path, data)
    path.chmod(0o600)
