"""Which certificates count: each name's newest generation, unless it is revoked.

The common name of a certificate is the name of its party and a generation, ``robot-3.2``; names
have no dot, so no two parties' common names are the same. ``generations.json`` beside ``ca.pem``
says which was issued last, and which of these are revoked. It is public; who may write it
decides who is admitted (:mod:`formation.machines.custody`).
"""

import re
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError

from formnet.formation.machines.custody import KeysError, check_file
from formnet.netem.files.tables import Table

FILE = "generations.json"
_PARTY = "(plant|monitor|robot-[0-9]{1,18})"
_MOST_BYTES = 2**24

Name = Annotated[str, Field(pattern=f"^{_PARTY}$")]
LAST = 10**9 - 1
"""The greatest generation: a common name has room for nine digits of it."""
Generation = Annotated[int, Field(ge=1, le=LAST)]


def common_name(name: str, generation: int) -> str:
    """That of the certificate of ``name`` with this generation."""
    return f"{name}.{generation}"


def parted(common: str) -> tuple[str, int]:
    """Name and generation of a common name; generation 0 of one that has none."""
    match = re.fullmatch(r"([a-z]+(?:-[0-9]+)?)(?:\.([1-9][0-9]{0,8}))?", common, re.ASCII)
    if match is None:
        return common, 0
    return match[1], int(match[2] or 0)


def parties(folder: Path) -> list[str]:
    """Of whom a folder of keys has a certificate or a private key, ascending."""
    matches = (re.fullmatch(rf"{_PARTY}(-key)?\.pem", path.name) for path in folder.iterdir())
    return sorted({match[1] for match in matches if match is not None})


class Generations(Table):
    """What was ``issued`` last, by name, and the names of which that is ``revoked``."""

    issued: dict[Name, Generation] = {}
    revoked: list[Name] = []

    @classmethod
    def read(cls, folder: Path) -> "Generations":
        """Those of a folder of keys.

        Raises:
            KeysError: there are none, as in a folder that an earlier version made; or somebody
                else may write them; or they are not as this version writes them.
        """
        path = folder / FILE
        check_file(
            path,
            secret=False,
            make="copy it from where ca-key.pem is; if it is not there either, an earlier version "
            f"made these keys, and `formnet keys renew {folder}` there makes new ones of the "
            "same authority",
            most_bytes=_MOST_BYTES,
        )
        try:
            with path.open("rb") as stream:
                return cls.model_validate_json(stream.read(_MOST_BYTES))
        except (OSError, ValidationError) as error:
            reason = error.strerror if isinstance(error, OSError) else "its format is unknown"
            raise KeysError(
                f"{path} cannot be read: {reason}", "copy it again from where ca-key.pem is"
            ) from None

    def admitted(self, name: str) -> str | None:
        """The common name that counts as ``name``; None if there is none."""
        if name not in self.issued or name in self.revoked:
            return None
        return common_name(name, self.issued[name])

    def reissued(self, names: Collection[str]) -> "Generations":
        """With the next generation of each of ``names``.

        Raises:
            KeysError: one of them has had the last that there is.
        """
        for name in names:
            if self.issued.get(name, 0) >= LAST:
                raise KeysError(
                    f"{name} has had generation {LAST}, the last that there is",
                    "make a new authority in another folder (`formnet keys init`)",
                )
        new = {name: self.issued.get(name, 0) + 1 for name in names}
        left = [name for name in self.revoked if name not in new]
        return Generations(issued={**self.issued, **new}, revoked=left)

    def without(self, names: Iterable[str]) -> "Generations":
        """With what was issued for ``names`` revoked."""
        return Generations(issued=self.issued, revoked=sorted({*self.revoked, *names}))
