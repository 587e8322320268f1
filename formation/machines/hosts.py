"""On which machines the robots run: a file of hosts, or ``[hosts]`` in a scenario."""

import re
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field, ValidationError, model_validator

from formnet.formation.machines.addresses import Target, endpoint, ssh_target
from formnet.formation.plan.selectors import RobotId
from formnet.netem.files.problems import Problem, problems
from formnet.netem.files.tables import Table
from formnet.netem.files.toml import read_toml

_PROGRAM = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+-]*", re.ASCII)


def _listen(text: str) -> str:
    endpoint(text)
    return text


def _ssh(text: str) -> str:
    ssh_target(text)
    return text


def _path(text: str) -> str:
    """A path on another machine, where no shell expands it."""
    if not text or not text.isprintable() or text != text.strip():
        raise ValueError("must be a path, without control characters or spaces around it")
    if text.startswith("-"):
        raise ValueError("must not begin with -, which would make it an option")
    if text.startswith("~"):
        raise ValueError("must be the whole path: ~ is not expanded")
    return text


def _python(text: str) -> str:
    """A path, or the name of a program."""
    _path(text)
    if "/" not in text and not _PROGRAM.fullmatch(text):
        raise ValueError("must be the interpreter alone: a path, or a name such as python3")
    return text


class Host(Table):
    """``[[hosts]]``: a machine and the robots it runs."""

    name: str = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", max_length=80, description="Name of the host."
    )
    ssh: Annotated[str, AfterValidator(_ssh)] = Field(
        description="`user@address:port`, or a name in ~/.ssh/config.",
        json_schema_extra={"minLength": 1},
    )
    robots: list[RobotId] = Field(min_length=1, description="Ids of the robots that run there.")
    python: Annotated[str, AfterValidator(_python)] = Field(
        default="python3", description="Python interpreter there, of an environment with formnet."
    )
    keys: Annotated[str, AfterValidator(_path)] | None = Field(
        default=None, description="Folder there with ca.pem and its robots' certificates."
    )

    @property
    def target(self) -> Target:
        """Where SSH logs in."""
        return ssh_target(self.ssh)


class Hosts(Table):
    """``[hosts]``: where robots reach the plant on this machine, and the other machines."""

    listen: Annotated[str, AfterValidator(_listen)] = Field(
        description="Endpoint of the plant for robots: `tls/ADDRESS:PORT` of this machine.",
        json_schema_extra={"pattern": r"^(tcp|tls)/.+:\d+$"},
    )
    hosts: list[Host] = Field(min_length=1, description="The other machines.")

    def of(self, robot: int) -> Host | None:
        """Where ``robot`` runs; None: here."""
        return next((host for host in self.hosts if robot in host.robots), None)

    def number(self, host: Host) -> str:
        """What a record calls ``host``, whose name is nobody else's business: ``host 2``."""
        return f"host {1 + self.hosts.index(host)}"

    @model_validator(mode="after")
    def _one_host_each(self) -> "Hosts":
        seen: dict[int, str] = {}
        names: set[str] = set()
        for host in self.hosts:
            if host.name in names:
                raise ValueError(f"two hosts are called {host.name}")
            names.add(host.name)
            for robot in host.robots:
                if robot in seen:
                    raise ValueError(f"robot {robot} runs on {seen[robot]} and on {host.name}")
                seen[robot] = host.name
        return self


class HostsError(ValueError):
    """A file of hosts that cannot be used; ``problems`` holds everything found."""

    def __init__(self, file: str, problems: list[Problem]) -> None:
        self.file, self.problems = file, problems
        super().__init__("\n".join(f"{file}: {problem}" for problem in problems))


def load_hosts(path: Path) -> Hosts:
    """Read and check a file of hosts, or those of a scenario that has them.

    Raises:
        HostsError: with every problem found.
    """
    try:
        data = read_toml(path)
    except ValueError as error:
        raise HostsError(str(path), [Problem("", None, str(error))]) from None
    if isinstance(data.get("hosts"), dict):  # a scenario's
        data = data["hosts"]
    try:
        return Hosts.model_validate(data)
    except ValidationError as error:
        raise HostsError(str(path), problems(Hosts, data, error)) from None
