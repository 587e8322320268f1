"""``formnet keys``: a folder with an authority of one's own and a certificate for everybody.

Everything that is there is looked at before anything is written, so that an interrupted command
can be repeated, or is refused with what to do, and never makes things worse.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from os.path import lexists
from pathlib import Path
from typing import TypeVar

from cryptography import x509

from formnet.formation.machines.addresses import BadAddress, host
from formnet.formation.machines.custody import (
    AUTHORITY,
    AUTHORITY_KEY,
    MOST_BYTES,
    KeysError,
    check_folder,
)
from formnet.formation.machines.generations import FILE, Generations, common_name, parted, parties
from formnet.formation.wire.security import MONITOR, PLANT, Credentials, robot_name
from formnet.lab.machines.authority import LOCAL, Authority, Pair
from formnet.lab.runs import files
from formnet.netem.files.regular import read

MOST_ROBOTS = 100_000
_KEY_END = "-key.pem"

Found = TypeVar("Found")


class KeysExist(FileExistsError):
    """All that was asked for is there already; none is ever overwritten but by a renewal."""


class Unusable(ValueError):
    """A folder of keys is not as it must be; the text has every problem and its remedy."""

    def __init__(self, problems: Sequence[KeysError]) -> None:
        super().__init__("\n".join(map(str, problems)))


def robots_of(text: str) -> list[int]:
    """The ids in ``1-5,8``, ascending.

    Raises:
        ValueError: it is no such list.
    """
    found: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"\s*([0-9]{1,18})\s*(?:-\s*([0-9]{1,18})\s*)?", part)
        if match is None:
            raise ValueError(f"{part!r} is neither a robot's id nor a range such as 1-5")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first or last - first > MOST_ROBOTS:
            raise ValueError(f"{part!r} is no range of robots' ids")
        found.update(range(first, last + 1))
    return sorted(found)


def hosts_of(text: str) -> list[str]:
    """The names and addresses in ``lab-pc, 10.0.0.9,fd00::1``, as certificates have them.

    Raises:
        ValueError: one of them is none.
    """
    found = []
    for part in text.split(",") if text else ():
        try:
            found.append(host(part.strip(" ")))
        except BadAddress as error:
            raise ValueError(f"{part!r}: {error}") from None
    return found


def make(folder: Path, robots: Sequence[int], hosts: Sequence[str], days: int) -> list[Path]:
    """Write an authority (unless there is one) and the certificates that are missing.

    ``hosts`` are the names and addresses at which the plant may be reached, beside
    this machine's own. Private keys have mode 0600. Returns what was written.

    Raises:
        KeysExist: everything is there already.
        Unusable: something of it is there and cannot be used; nothing was written.
        OSError: ``folder`` cannot be written.
    """
    new = not folder.exists()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    try:
        _all_or(partial(check_folder, folder))
    except Unusable:
        if new:
            folder.rmdir()
        raise
    authority, counting = _looked_at(folder)
    problems, wanted = [], []
    for name in (PLANT, MONITOR, *map(robot_name, robots)):
        there = [path.name for path in _pair(folder, name) if lexists(path)]
        if name == MONITOR and name in counting.revoked:
            continue  # it stays so until it is renewed
        if not there:
            wanted.append(name)
        elif len(there) == 1:
            renew = f"`formnet keys renew {folder} {name}` makes a new pair"
            problems.append(
                KeysError(f"{folder} has {there[0]} and not the other file of {name}", renew)
            )
        else:
            problems += _problems(partial(Credentials, folder, name))
    if problems:
        raise Unusable(problems)
    if not wanted:
        raise KeysExist(f"{folder} has all of these keys already; keys are never overwritten")
    written: list[Path] = []
    if authority is None:
        authority = Authority.made()
        if not lexists(folder / FILE):
            files.write_new(folder / FILE, _text(counting), 0o644)
            written.append(folder / FILE)
        written += _written(folder, "ca", authority.pair)
    counting = _all_or(partial(counting.reissued, wanted))
    files.replace_all([(folder / FILE, _text(counting), 0o644)])
    for name in wanted:
        served = [*LOCAL, *hosts] if name == PLANT else []
        pair = authority.issue(name, common_name(name, counting.issued[name]), served, days)
        written += _written(folder, name, pair)
    return written


def renew(
    folder: Path, names: Sequence[str], hosts: Sequence[str], days: int
) -> dict[str, list[Path]]:
    """Replace certificates and keys by new ones, which alone count from then on.

    ``names`` may be empty: all that are there. ``hosts``, if given, are the plant's as for
    :func:`make`; else it keeps those that it has. Returns what was written, by common name.

    Raises:
        Unusable: authority or folder cannot be used, or there is nothing to renew.
        OSError: ``folder`` cannot be written; unless that is said of a file, nothing was.
    """
    _all_or(partial(check_folder, folder))
    there = set(parties(folder))
    authority = _all_or(partial(Authority.read, folder))
    counting = Generations()
    if lexists(folder / FILE):
        counting = _all_or(partial(Generations.read, folder))
    known = there | counting.issued.keys()
    wanted = list(dict.fromkeys(names)) or sorted(known)
    problems = _unknown(folder, wanted, known)
    if not wanted:
        problems.append(KeysError(f"{folder} has nothing to renew", "`formnet keys init` makes it"))
    for path in (path for name in wanted for path in _pair(folder, name) if lexists(path)):
        if path.is_symlink() or not path.is_file():
            problems.append(KeysError(f"{path} is a link or no regular file", "remove it"))
    if problems:
        raise Unusable(problems)
    before = {name: _generation(folder, name) for name in wanted}
    issued = {name: max(before[name], counting.issued.get(name, 0)) for name in wanted}
    older = {name: number for name, number in issued.items() if number}
    counting = Generations(issued={**counting.issued, **older}, revoked=counting.revoked)
    counting = _all_or(partial(counting.reissued, wanted))
    new: list[tuple[Path, bytes, int]] = [(folder / FILE, _text(counting), 0o644)]
    found = {}
    for name in wanted:
        served = _served(folder, hosts) if name == PLANT else []
        common = common_name(name, counting.issued[name])
        pair = authority.issue(name, common, served, days)
        certificate, private_key = found[common] = [*_pair(folder, name)]
        new += [(private_key, pair.private_key, 0o600), (certificate, pair.certificate, 0o644)]
    files.replace_all(new)
    return found


def revoke(folder: Path, names: Sequence[str]) -> list[str]:
    """Make the certificates of ``names`` count no more; needs no authority's key.

    Returns the common names of which that is now so.

    Raises:
        Unusable: the folder cannot be used, or has issued none to one of ``names``.
        OSError: ``folder`` cannot be written.
    """
    _all_or(partial(check_folder, folder))
    counting = _all_or(partial(Generations.read, folder))
    problems = _unknown(folder, names, counting.issued)
    if PLANT in names:
        problems.append(
            KeysError(
                f"{PLANT} cannot be revoked: robots accept every plant's certificate of this "
                f"{AUTHORITY} until it expires",
                "make a new authority in another folder (`formnet keys init`)",
            )
        )
    if problems:
        raise Unusable(problems)
    files.replace_all([(folder / FILE, _text(counting.without(names)), 0o644)])
    return [common_name(name, counting.issued[name]) for name in dict.fromkeys(names)]


def _looked_at(folder: Path) -> tuple[Authority | None, Generations]:
    """The authority, if there is one, and what counts."""
    there = sorted(path.name for path in folder.iterdir() if path.name.endswith(".pem"))
    if not {AUTHORITY, AUTHORITY_KEY} & set(there):
        counting = Generations()
        if lexists(folder / FILE):
            counting = _all_or(partial(Generations.read, folder))
        if there or counting.issued:
            what = ", ".join(there[:5]) or FILE
            raise Unusable(
                [
                    KeysError(
                        f"{folder} has {what} and neither {AUTHORITY} nor {AUTHORITY_KEY}",
                        "copy both back from where they were made, or make others in a new folder",
                    )
                ]
            )
        return None, counting
    return (
        _all_or(partial(Authority.read, folder)),
        _all_or(partial(Generations.read, folder)),
    )


def _unknown(folder: Path, names: Iterable[str], known: Iterable[str]) -> list[KeysError]:
    listed = sorted(known)
    return [
        KeysError(
            f"{folder} has no certificate of {name!r}",
            f"it has those of {', '.join(listed[:8]) or 'nobody'}" + ", ..." * (len(listed) > 8),
        )
        for name in names
        if name not in listed
    ]


def _generation(folder: Path, name: str) -> int:
    """Of the certificate that is there; 0 if there is none, or none that can be read."""
    try:
        found = x509.load_pem_x509_certificate(read(folder / f"{name}.pem", MOST_BYTES))
        common = found.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)[0].value
    except (OSError, ValueError, IndexError):
        return 0
    return parted(str(common))[1]


def _served(folder: Path, hosts: Sequence[str]) -> list[str]:
    """Where the plant may be reached: at ``hosts``, or as its certificate says now."""
    if hosts:
        return [*LOCAL, *hosts]
    try:
        found = x509.load_pem_x509_certificate(read(folder / f"{PLANT}.pem", MOST_BYTES))
        names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (OSError, ValueError, x509.ExtensionNotFound):
        problem = f"{folder / PLANT}.pem does not say where the plant may be reached"
        raise Unusable([KeysError(problem, "give --hosts, as for `formnet keys init`")]) from None
    return [
        *names.get_values_for_type(x509.DNSName),
        *map(str, names.get_values_for_type(x509.IPAddress)),
    ]


def _pair(folder: Path, name: str) -> tuple[Path, Path]:
    return folder / f"{name}.pem", folder / f"{name}{_KEY_END}"


def _written(folder: Path, name: str, pair: Pair) -> list[Path]:
    """Two new files; the secret is never readable by others, not even for a moment."""
    certificate, private_key = _pair(folder, name)
    files.write_new(private_key, pair.private_key, 0o600)
    try:
        files.write_new(certificate, pair.certificate, 0o644)
    except OSError:
        private_key.unlink()  # without its certificate it would be in the way
        raise
    return [private_key, certificate]


def _text(counting: Generations) -> bytes:
    return counting.model_dump_json(indent=1).encode() + b"\n"


def _problems(look: Callable[[], object]) -> list[KeysError]:
    try:
        look()
    except KeysError as error:
        return [error]
    return []


def _all_or(look: Callable[[], Found]) -> Found:
    """What ``look`` finds, or its KeysError as all that is wrong."""
    try:
        return look()
    except KeysError as error:
        raise Unusable([error]) from None
