"""Who may say what: certificates by name, and the hub's access control.

Every party has a certificate of one authority, whose common name says who it is, and which of its
certificates that is: ``plant.1``, ``robot-3.2``, ``monitor.1``. The hub (the plant's session)
checks it (mutual TLS) and lets each party put and hear only what is its own, if its certificate
is the one that counts (:mod:`formation.machines.generations`). Files of a folder of keys:
``ca.pem``, ``generations.json`` where the plant is, and for each party ``<name>.pem`` and
``<name>-key.pem`` (mode 0600).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from os.path import lexists
from pathlib import Path
from typing import Any

from formnet.formation.machines import generations
from formnet.formation.machines.custody import (
    AUTHORITY,
    AUTHORITY_KEY,
    KeysError,
    check_file,
    check_folder,
)
from formnet.formation.machines.generations import Generations
from formnet.formation.machines.matching import check_pair, common_name_of

PLANT, MONITOR = "plant", "monitor"


def robot_name(robot: int) -> str:
    """The name of a robot in certificates."""
    return f"robot-{robot}"


@dataclass(frozen=True)
class Credentials:
    """The certificate and the private key of ``name``, and the authority's certificate.

    Raises:
        KeysError: a file is not there or a link; the folder or a file is another user's, or others
            may change it, or read a private key; key, certificate and authority do not belong
            together; or the certificate is not one of ``name`` that counts.
    """

    folder: Path
    name: str

    def __post_init__(self) -> None:
        check_folder(self.folder)
        check_file(self.authority, secret=False)
        signing = self.folder / AUTHORITY_KEY
        if lexists(signing):
            check_file(signing, secret=True)
            check_pair(self.authority, signing, "copy both again from where they were made")
        renew = f"where {AUTHORITY_KEY} is, `formnet keys renew DIR {self.name}` makes another"
        check_file(self.certificate, secret=False)
        check_file(self.private_key, secret=True, make=renew)
        common = common_name_of(self.authority, self.certificate, self.private_key, renew)
        name, generation = generations.parted(common)
        if name != self.name:
            raise KeysError(f"{self.certificate} is of {common!r}", renew)
        if generation == 0:
            raise KeysError(
                f"{self.certificate} was made by an earlier version and has no generation",
                f"where {AUTHORITY_KEY} is, `formnet keys renew DIR` makes all again",
            )
        known = name == PLANT or lexists(self.folder / generations.FILE)  # hosts need not know
        if known and self.generations().admitted(name) != common:
            raise KeysError(f"{self.certificate} ({common}) is revoked or was renewed", renew)

    def generations(self) -> Generations:
        """Which certificates the hub admits.

        Raises:
            KeysError: it cannot be known.
        """
        return Generations.read(self.folder)

    @property
    def authority(self) -> Path:
        """The certificate that all others are checked against."""
        return self.folder / AUTHORITY

    @property
    def certificate(self) -> Path:
        """The own certificate."""
        return self.folder / f"{self.name}.pem"

    @property
    def private_key(self) -> Path:
        """The own private key."""
        return self.folder / f"{self.name}-key.pem"

    def tls(self, *, listening: bool) -> dict[str, Any]:
        """Zenoh's ``transport.link.tls``: both ends show who they are, while that is valid.

        (When the other's certificate expires, the connection is closed.)
        """
        side = "listen" if listening else "connect"
        return {
            "root_ca_certificate": str(self.authority),
            f"{side}_private_key": str(self.private_key),
            f"{side}_certificate": str(self.certificate),
            "enable_mtls": True,
            "close_link_on_expiration": True,
        }


def access_control(robots: Iterable[int], counting: Generations) -> dict[str, Any]:
    """Zenoh's ``access_control`` for a hub: nothing is allowed but what stands here.

    A robot puts on its own keys and hears the plant and other robots; a monitor hears
    what robots broadcast and what is recorded, and puts nothing. A certificate that is not
    ``counting`` is allowed nothing.

    Runs have keys ``formnet/<run>/...``.
    """
    allowed: dict[str, list[dict[str, Any]]] = {}
    for robot in robots:
        name = robot_name(robot)
        allowed[name] = list(
            _rules(
                name,
                puts=[f"formnet/*/from-robot/{robot}", f"formnet/*/broadcast/{robot}"],
                hears=[f"formnet/*/to-robot/{robot}", "formnet/*/broadcast/*"],
                alive=f"formnet/*/alive/robot/{robot}",
                watches=["formnet/*/alive/plant"],
            )
        )
    allowed[MONITOR] = list(
        _rules(
            MONITOR,
            puts=[],
            hears=["formnet/*/broadcast/*", "formnet/*/watch"],
            alive=None,
            watches=["formnet/*/alive/**"],
            asks=["formnet/*/history"],
        )
    )
    admitted = {name: counting.admitted(name) for name in allowed}
    known = {name: common for name, common in admitted.items() if common is not None}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for name in known for rule in allowed[name]],
        "subjects": [{"id": name, "cert_common_names": [common]} for name, common in known.items()],
        "policies": [
            {"rules": [rule["id"] for rule in allowed[name]], "subjects": [name]} for name in known
        ],
    }


def _rules(
    name: str,
    *,
    puts: list[str],
    hears: list[str],
    alive: str | None,
    watches: list[str],
    asks: Sequence[str] = (),
) -> Iterator[dict[str, Any]]:
    """What ``name`` may send to the hub (ingress) and get from it (egress)."""

    def rule(what: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, Any]:
        return {
            "id": f"{name}-{what}",
            "permission": "allow",
            "flows": [flow],
            "messages": messages,
            "key_exprs": keys,
        }

    if puts:
        yield rule("puts", "ingress", ["put"], puts)
        # Without it, a publisher thinks that nobody listens. Who does is no secret.
        listeners = ["formnet/*/from-robot/*", "formnet/*/broadcast/*"]
        yield rule("is-heard", "egress", ["declare_subscriber"], listeners)
    yield rule("subscribes", "ingress", ["declare_subscriber"], hears)
    yield rule("hears", "egress", ["put"], hears)
    if asks:
        yield rule("asks", "ingress", ["query"], [*asks])
        yield rule("is-answered", "egress", ["declare_queryable", "reply"], [*asks])
    if alive is not None:
        yield rule("is-alive", "ingress", ["liveliness_token"], [alive])
    yield rule(
        "asks-who-is-alive",
        "ingress",
        ["declare_liveliness_subscriber", "liveliness_query"],
        watches,
    )
    yield rule("sees-who-is-alive", "egress", ["liveliness_token"], watches)
