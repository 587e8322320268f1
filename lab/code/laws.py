"""The law of a scenario: an installed one, or one in a file that may be executed."""

import os
from pathlib import Path
from typing import NamedTuple

from formnet.agent.law import UnknownLaw
from formnet.agent.law_file import LawFile
from formnet.formation.scenario.law import BY_FILE, LawSettings
from formnet.lab.code import allowed


class Given(NamedTuple):
    """What the user says of the files that a scenario names: ``--law FILE:NAME``, ``--allow-code``
    and ``--allow-outside`` (of its folder)."""

    law: str | None = None
    allow_code: bool = False
    allow_outside: bool = False


NOTHING = Given()


class NotAllowed(ValueError):
    """The scenario names code that nobody has allowed; the text says which, and how to."""


class NoLaw(ValueError):
    """The file of a law is not there, or has no such law; the text says why."""


def kind_of(given: Given) -> str | None:
    """What ``law.kind`` becomes by ``--law``; None without it.

    Raises:
        NoLaw: it is no ``FILE.py:NAME``.
    """
    if given.law is None:
        return None
    file, colon, name = given.law.rpartition(":")
    kind = f"{Path(file).name}:{name}"
    if not colon or not BY_FILE.fullmatch(kind):
        raise NoLaw(
            f"--law {given.law}: must be FILE.py:NAME, the file's name of letters, digits, . _ "
            "and - alone"
        )
    return kind


def law_of(settings: LawSettings, folder: Path | None, given: Given = NOTHING) -> LawFile | None:
    """The file whose law a scenario in ``folder`` has (None: it lies nowhere), if it has one.

    Reads a file, and executes nothing yet.

    Raises:
        NotAllowed: it is code in a file, and nobody has allowed it.
        NoLaw: there is no such file, or nothing of that name in it.
        BadList: the list of what is allowed cannot be trusted.
    """
    if given.law is not None:
        file, _, name = given.law.rpartition(":")
        return _read(settings.kind, file, name)
    if settings.file is None:
        return None
    file, name = settings.file
    if folder is None:
        raise NoLaw(f"{file} is no file here: --law FILE:NAME says where it is")
    root = folder.resolve()
    real = Path(os.path.realpath(root / file))
    if root not in real.parents:
        raise NoLaw(f"{file} leads out of the scenario's folder")
    found = _read(settings.kind, str(real), name)
    if not given.allow_code and not allowed.has(real, found.sha256):
        raise NotAllowed(
            f"{name} is code in the file {file} (SHA-256 {found.sha256}), which is executed only "
            f"with --allow-code, or once `formnet allow {folder}` has allowed it as it is"
        )
    return found


def _read(kind: str, path: str, name: str) -> LawFile:
    try:
        found = LawFile.read(f"{path}:{name}", kind=kind)
    except UnknownLaw as error:
        raise NoLaw(str(error)) from None
    problem = found.problem()
    if problem is not None:
        raise NoLaw(problem)
    return found


def executed(law: LawFile | None) -> dict[str, str]:
    """The files of code that a run executes, as they were named, and the SHA-256 of each."""
    return {} if law is None else {law.file: law.sha256}
