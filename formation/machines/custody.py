"""Whose a folder of keys is, and who may write or read it: looked at before anything is used.

The rules are those of ``StrictModes`` in sshd_config(5), for the folder and all above it, and
none of the files may be a link. On a system without POSIX owners nothing of that can be asked.
"""

import os
import stat
from pathlib import Path

from formnet.netem.files.regular import in_words

AUTHORITY, AUTHORITY_KEY = "ca.pem", "ca-key.pem"
MOST_BYTES = 2**16
"""A certificate or a private key that is longer is none (ours have some 1000 bytes)."""


class KeysError(ValueError):
    """A folder of keys cannot be used: ``problem`` says why, ``remedy`` what to do about it."""

    def __init__(self, problem: str, remedy: str) -> None:
        self.problem, self.remedy = problem, remedy
        super().__init__(f"{problem}: {remedy}")


def check_folder(folder: Path) -> None:
    """See that nobody else can change what lies in ``folder``, or put another in its place.

    Raises:
        KeysError: somebody can, or there is no such folder.
    """
    try:
        real = folder.resolve(strict=True)
        chain = [(place, place.stat()) for place in (real, *real.parents)]
    except (OSError, RuntimeError) as error:  # a circle of links
        reason = error.strerror if isinstance(error, OSError) else "its links form a circle"
        raise KeysError(
            f"{folder} cannot be used: {reason}", "make it with `formnet keys init`"
        ) from None
    if not stat.S_ISDIR(chain[0][1].st_mode):
        raise KeysError(f"{folder} is no folder", "give the folder with ca.pem")
    for place, found in chain:
        _check_owner(place, found)
        others = found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        sticky = place != real and found.st_mode & stat.S_ISVTX  # others' entries stay theirs
        if _has_owners() and others and not sticky:
            what = "lies below a folder" if place != real else "is a folder"
            raise KeysError(
                f"{folder} {what} into which others may write ({place})", f"chmod go-w {place}"
            )


def check_file(
    path: Path,
    *,
    secret: bool,
    make: str = "make it with `formnet keys init`",
    most_bytes: int = MOST_BYTES,
) -> None:
    """See that a file of keys is there and of its owner; a ``secret`` is for nobody else to read.

    It has ``most_bytes`` at most. ``make`` is the remedy if it is not there.

    Raises:
        KeysError: it is not so.
    """
    try:
        found = path.lstat()
    except FileNotFoundError:
        raise KeysError(f"{path} is missing", make) from None
    except OSError as error:
        raise KeysError(f"{path} cannot be looked at: {error.strerror}", "see to that") from None
    if not stat.S_ISREG(found.st_mode):
        raise KeysError(
            f"{path} is a link or no regular file", "put the file itself there, as a copy"
        )
    if found.st_size > most_bytes:
        raise KeysError(f"{path} is longer than {in_words(most_bytes)}", "copy it again")
    _check_owner(path, found)
    if not _has_owners():
        return
    if secret and found.st_mode & 0o077:
        raise KeysError(
            f"{path} can be read by others",
            f"chmod 600 it; if others were there, {_renewal(path)}",
        )
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise KeysError(f"{path} can be changed by others", f"chmod go-w {path}")


def _renewal(path: Path) -> str:
    if path.name == AUTHORITY_KEY:
        return "make a new authority in another folder"
    return f"`formnet keys renew {path.parent} {path.name.removesuffix('-key.pem')}`"


def _check_owner(place: Path, found: os.stat_result) -> None:
    if _has_owners() and found.st_uid not in (0, os.geteuid()):
        raise KeysError(
            f"{place} belongs to another user (uid {found.st_uid})",
            "use a folder of keys that is yours, below folders that are yours or root's",
        )


def _has_owners() -> bool:
    return hasattr(os, "geteuid")
