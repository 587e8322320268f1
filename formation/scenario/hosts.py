"""On which machines the robots run: a file of hosts, or ``[hosts]`` in a scenario."""

from pathlib import Path

from pydantic import Field, ValidationError, model_validator

from formnet.formation.plan.selectors import RobotId
from formnet.netem.files.problems import Problem, problems
from formnet.netem.files.tables import Table
from formnet.netem.files.toml import read_toml


class Host(Table):
    """``[[hosts]]``: a machine and the robots it runs."""

    name: str = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", max_length=80, description="Name of the host."
    )
    ssh: str = Field(min_length=1, description="`user@address:port`, or a name in ~/.ssh/config.")
    robots: list[RobotId] = Field(min_length=1, description="Ids of the robots that run there.")
    python: str = Field(
        default="python3", description="Python interpreter there, of an environment with formnet."
    )
    keys: str | None = Field(
        default=None, description="Folder there with ca.pem and its robots' certificates."
    )


class Hosts(Table):
    """``[hosts]``: where robots reach the plant on this machine, and the other machines."""

    listen: str = Field(
        pattern=r"^(tcp|tls)/.+:\d+$",
        description="Endpoint of the plant for robots: `tls/ADDRESS:PORT` of this machine.",
    )
    hosts: list[Host] = Field(min_length=1, description="The other machines.")

    def of(self, robot: int) -> Host | None:
        """Where ``robot`` runs; None: here."""
        return next((host for host in self.hosts if robot in host.robots), None)

    @model_validator(mode="after")
    def _one_host_each(self) -> "Hosts":
        seen: dict[int, str] = {}
        for host in self.hosts:
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
