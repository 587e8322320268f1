"""Where the processes of a run are to be, from what the user says of it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from formnet.formation.records import events
from formnet.formation.records.stream import Sink
from formnet.formation.scenario.hosts import Host, Hosts, HostsError, load_hosts
from formnet.formation.scenario.model import Scenario
from formnet.formation.wire import bus
from formnet.formation.wire.security import PLANT, Credentials, KeysError, robot_name
from formnet.lab.launch.launch import Child, Place
from formnet.lab.runs.build import install
from formnet.netem.files.printable import printable


class BadPlace(ValueError):
    """What was asked for cannot be; the text says why."""


class HostUnreachable(RuntimeError):
    """A host on which a robot was to run cannot be reached."""


@dataclass(frozen=True)
class Where:
    """``--hosts``, ``--keys``, ``--plaintext`` and ``--connect`` (a Zenoh router's endpoint).

    Without ``--hosts``, a scenario's own are taken, if it has any.
    """

    file: Path | None = None
    keys: Path | None = None
    plaintext: bool = False
    router: str | None = None

    def hosts(self, scenario: Scenario) -> Hosts | None:
        """The hosts, which must suit the scenario and the keys.

        Raises:
            BadPlace: they do not.
        """
        if self.router is not None:
            try:
                bus.check_endpoint(
                    self.router, secure=self.keys is not None, plaintext=self.plaintext
                )
            except bus.BusError as error:
                raise BadPlace(f"--connect: {error}") from None
        hosts = scenario.hosts
        if self.file is not None:
            try:
                hosts = load_hosts(self.file)
            except HostsError as error:
                raise BadPlace(str(error)) from None
        if hosts is not None:
            if find_spec("asyncssh") is None:
                raise BadPlace(f"hosts need the package asyncssh: {install('hosts')}")
            self._check(scenario, hosts)
        try:
            if self.keys is not None:
                Credentials(self.keys, PLANT)
                for robot in scenario.ids:
                    if hosts is None or hosts.of(robot) is None:
                        Credentials(self.keys, robot_name(robot))
        except KeysError as error:
            raise BadPlace(f"--keys: {error}") from None
        return hosts

    def _check(self, scenario: Scenario, hosts: Hosts) -> None:
        source = self.file or "[hosts]"
        for host in hosts.hosts:
            for robot in host.robots:
                if robot not in scenario.ids:
                    place = f"{source}: hosts.{host.name}.robots"
                    raise BadPlace(f"{place}: robot {robot} is not in the scenario")
            if self.keys is not None and host.keys is None:
                raise BadPlace(f"{source}: hosts.{host.name}.keys: is required with --keys")
        least_s = 2.0 * bus.LEASE_S
        if scenario.run.patience_s < least_s:
            raise BadPlace(
                f"run.patience_s = {scenario.run.patience_s:g}: must be at least {least_s:g} with "
                f"hosts: a silent connection holds others up for {bus.LEASE_S:g} s"
            )
        secure = hosts.listen.startswith("tls/")
        if secure and self.keys is None:
            raise BadPlace(f"{source}: listen = {hosts.listen!r} needs --keys DIR")
        if not secure and not self.plaintext and not bus.on_loopback(hosts.listen):
            raise BadPlace(
                f"{source}: listen = {hosts.listen!r}: off loopback it must be tls/HOST:PORT, "
                "with --keys DIR (or --plaintext, on a network that you trust)"
            )

    @contextmanager
    def place(self, hosts: Hosts | None, sink: Sink, now_ns: Callable[[], int]) -> Iterator[Place]:
        """Where it is; connections to hosts are closed at the end.

        ``sink`` hears of lost hosts, at ``now_ns()`` of the run's time.
        """
        if hosts is None:
            yield Place(self.router, self.keys, self.plaintext, self.router is not None)
            return
        from formnet.lab.machines.hosts import Fleet, HostLost

        def lost(host: Host, why: str) -> None:
            sink(events.HostLost(now_ns(), host.name, tuple(host.robots), why))

        source = self.file or "the scenario's file"
        with Fleet(lost) as fleet:

            def elsewhere(robot: int, arguments: list[str], log: Path) -> Child | None:
                host = hosts.of(robot)
                if host is None:
                    return None
                options = ["--keys", host.keys] if host.keys is not None else []
                options += ["--plaintext"] if self.plaintext else []
                stream = log.open("a", encoding="utf-8", buffering=1)
                try:
                    return fleet.start(
                        host,
                        [*arguments, *options],
                        lambda line: print(
                            printable(f"[{host.name}] {line}", lines=True), end="", file=stream
                        ),
                    )
                except HostLost as error:
                    remedy = f"`formnet doctor --hosts {source}` shows more"
                    raise HostUnreachable(f"{error} ({remedy})") from None

            meeting = self.router or hosts.listen
            yield Place(meeting, self.keys, self.plaintext, self.router is not None, elsewhere)


HERE = Where()
"""On this machine alone."""
