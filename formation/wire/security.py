"""Who may say what: certificates by name, and the hub's access control.

Every party has a certificate of one authority, whose common name says who it is: ``plant``,
``robot-3``, ``monitor``. The hub (the plant's session) checks it (mutual TLS) and lets each
party put and hear only what is its own. Files of a folder of keys: ``ca.pem``, and for each
party ``<name>.pem`` and ``<name>-key.pem`` (mode 0600).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PLANT, MONITOR = "plant", "monitor"


def robot_name(robot: int) -> str:
    """The common name of a robot's certificate."""
    return f"robot-{robot}"


class KeysError(ValueError):
    """A folder of keys lacks something; the text says what, and how to get it."""


@dataclass(frozen=True)
class Credentials:
    """The certificate and the private key of ``name``, and the authority's certificate.

    Raises:
        KeysError: one of the files is not there, or others may read the private key.
    """

    folder: Path
    name: str

    def __post_init__(self) -> None:
        for path in (self.authority, self.certificate, self.private_key):
            if not path.is_file():
                raise KeysError(f"{path} is missing: make it with `formnet keys init`")
        if self.private_key.stat().st_mode & 0o077:
            raise KeysError(f"{self.private_key} can be read by others: chmod 600 it")

    @property
    def authority(self) -> Path:
        """The certificate that all others are checked against."""
        return self.folder / "ca.pem"

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


def access_control(robots: Iterable[int]) -> dict[str, Any]:
    """Zenoh's ``access_control`` for a hub: nothing is allowed but what stands here.

    A robot puts on its own keys and hears the plant and other robots; a monitor hears
    what robots broadcast and what is recorded, and puts nothing.

    Runs have keys ``formnet/<run>/...``.
    """
    rules: list[dict[str, Any]] = []
    subjects, policies = [], []
    for robot in robots:
        name = robot_name(robot)
        own = [f"formnet/*/from-robot/{robot}", f"formnet/*/broadcast/{robot}"]
        heard = [f"formnet/*/to-robot/{robot}", "formnet/*/broadcast/*"]
        mine = list(
            _rules(
                name,
                puts=own,
                hears=heard,
                alive=f"formnet/*/alive/robot/{robot}",
                watches=["formnet/*/alive/plant"],
            )
        )
        rules += mine
        subjects.append({"id": name, "cert_common_names": [name]})
        policies.append({"rules": [rule["id"] for rule in mine], "subjects": [name]})
    watching = list(
        _rules(
            MONITOR,
            puts=[],
            hears=["formnet/*/broadcast/*", "formnet/*/watch"],
            alive=None,
            watches=["formnet/*/alive/**"],
            asks=["formnet/*/history"],
        )
    )
    rules += watching
    subjects.append({"id": MONITOR, "cert_common_names": [MONITOR]})
    policies.append({"rules": [rule["id"] for rule in watching], "subjects": [MONITOR]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
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
