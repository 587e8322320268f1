"""What this machine has, as a line of JSON for ``formnet doctor``: a program, run over SSH."""

import argparse
import json
import socket
import time
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from pydantic import BaseModel, FiniteFloat

from formnet.formation.machines.custody import KeysError
from formnet.formation.wire.messages import PROTOCOL
from formnet.formation.wire.security import Credentials, robot_name
from formnet.lab.runs.build import compiled

REACH_S = 5.0


class Answer(BaseModel):
    """What a probe prints, or a program that only claims to be one; see :func:`probe`."""

    protocol: int
    compiled: bool
    packages: dict[str, str]
    unix_s: FiniteFloat
    reach: str = ""
    keys: dict[str, dict[str, str]] = {}


def probe(reach: str | None, keys: Path | None, names: list[str]) -> dict[str, Any]:
    """What is here; ``reach`` is the HOST:PORT to try, ``names`` whose keys to look at."""
    found: dict[str, Any] = {"protocol": PROTOCOL, "compiled": compiled(), "packages": {}}
    for package in ("formnet", "eclipse-zenoh"):
        with suppress(PackageNotFoundError):
            found["packages"][package] = version(package)
    if reach is not None:
        found["reach"] = _reach(reach)
    if keys is not None:
        found["keys"] = {name: certificate(keys, name) for name in names}
    found["unix_s"] = time.time()  # last: what comes after is on the way
    return found


def certificate(folder: Path, name: str) -> dict[str, Any]:
    """The certificate of ``name`` and its authority's, in PEM, and its file; or the ``problem``
    and its ``remedy``.

    They are public. Whoever asks looks into them, so that a host needs no package for it.
    """
    try:
        credentials = Credentials(folder, name)
        return {
            "file": str(credentials.certificate),
            "certificate": credentials.certificate.read_text(encoding="ascii"),
            "authority": credentials.authority.read_text(encoding="ascii"),
        }
    except KeysError as error:
        return {"problem": error.problem, "remedy": error.remedy}
    except (OSError, UnicodeDecodeError) as error:
        return {"problem": str(error)}


def _reach(place: str) -> str:
    """Whether a TCP connection to HOST:PORT comes about; empty, or why not."""
    host, _, port = place.rpartition(":")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), REACH_S):
            return ""
    except OSError as error:
        return str(error)


def main() -> None:
    """Print what is here."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--reach")
    parser.add_argument("--keys", type=Path)
    parser.add_argument("--robots", default="")
    asked = parser.parse_args()
    names = [robot_name(int(robot)) for robot in asked.robots.split(",") if robot]
    print(json.dumps(probe(asked.reach, asked.keys, names)))


if __name__ == "__main__":
    main()
