"""Where the processes of a run are to be, from what the user says of it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from formnet.formation.machines.custody import KeysError
from formnet.formation.machines.hosts import Host, Hosts, HostsError, load_hosts
from formnet.formation.records import events
from formnet.formation.records.stream import Sink
from formnet.formation.scenario.model import Scenario
from formnet.formation.wire import bus
from formnet.formation.wire.security import PLANT, Credentials, robot_name
from formnet.lab.launch.launch import Child, Place
from formnet.lab.machines.privacy import Private
from formnet.lab.runs.build import install
from formnet.netem.files.printable import printable


class BadPlace(ValueError):
    """What was asked for cannot be; the text says why."""


class HostUnreachable(RuntimeError):
    """A host on which a robot was to run cannot be reached; ``recorded`` is for the run's folder,
    and tells of no machine."""

    def __init__(self, text: str, recorded: str) -> None:
        self.recorded = recorded
        super().__init__(text)


@dataclass(frozen=True)
class Where:
    """``--hosts``, ``--keys``, ``--plaintext`` and ``--connect`` (a Zenoh router's endpoint).

    ``file`` has the hosts, or the scenario itself with ``own`` (``--hosts scenario``). A
    scenario's own are never taken unasked: whoever wrote it would log in as its user.
    """

    file: Path | None = None
    keys: Path | None = None
    plaintext: bool = False
    router: str | None = None
    own: bool = False

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
        hosts = self.named(scenario)
        if hosts is not None:
            if find_spec("asyncssh") is None:
                raise BadPlace(f"hosts need the package asyncssh: {install('hosts')}")
            self._check(scenario, hosts)
        try:
            if self.keys is not None:
                counting = Credentials(self.keys, PLANT).generations()
                for name, robot in ((robot_name(robot), robot) for robot in scenario.ids):
                    if hosts is None or hosts.of(robot) is None:
                        Credentials(self.keys, name)
                    elif counting.admitted(name) is None:
                        what = "is revoked" if name in counting.issued else "is missing"
                        make = "renew DIR {name}" if name in counting.issued else "init"
                        raise KeysError(
                            f"the certificate of {name} {what}",
                            f"where ca-key.pem is, `formnet keys {make.format(name=name)}`",
                        )
        except KeysError as error:
            raise BadPlace(f"--keys: {error}") from None
        return hosts

    def named(self, scenario: Scenario) -> Hosts | None:
        """The hosts that the user named, whose robots are in the scenario; None: none.

        Raises:
            BadPlace: the file cannot be used, has other robots, or the scenario has no hosts.
        """
        if self.own and scenario.hosts is None:
            raise BadPlace("--hosts scenario: the scenario has no [hosts]")
        hosts = scenario.hosts if self.own else None
        if self.file is not None:
            try:
                hosts = load_hosts(self.file)
            except HostsError as error:
                raise BadPlace(str(error)) from None
        for host in () if hosts is None else hosts.hosts:
            for robot in host.robots:
                if robot not in scenario.ids:
                    place = f"{self._source}: hosts.{host.name}.robots"
                    raise BadPlace(f"{place}: robot {robot} is not in the scenario")
        return hosts

    @property
    def _source(self) -> str:
        return "[hosts]" if self.file is None else str(self.file)

    def _check(self, scenario: Scenario, hosts: Hosts) -> None:
        source = self._source
        for host in hosts.hosts:
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
        private = self.private(hosts)
        if hosts is None:
            yield Place(
                self.router,
                self.keys,
                self.plaintext,
                self.router is not None,
                private=None if self.keys is None else private,
            )
            return
        from formnet.lab.machines.hosts import Fleet, HostLost

        def lost(host: Host, why: str) -> None:
            sink(events.HostLost(now_ns(), hosts.number(host), tuple(host.robots), why))

        source = self.file or "the scenario's file"
        with Fleet(lost) as fleet:

            def elsewhere(robot: int, arguments: list[str], log: Path) -> Child | None:
                host = hosts.of(robot)
                if host is None:
                    return None
                number = hosts.number(host)
                options = ["--keys", host.keys] if host.keys is not None else []
                options += ["--plaintext"] if self.plaintext else []
                stream = log.open("a", encoding="utf-8", buffering=1)
                try:
                    return fleet.start(
                        host,
                        [*arguments, *options],
                        lambda line: print(
                            printable(f"[{number}] {private(line)}", lines=True),
                            end="",
                            file=stream,
                        ),
                    )
                except HostLost as error:
                    remedy = f"`formnet doctor --hosts {source}` shows more"
                    recorded = f"{number}, of robot {robot}, cannot be reached over SSH"
                    raise HostUnreachable(f"{error} ({remedy})", recorded) from None

            yield Place(
                self.router or hosts.listen,
                self.keys,
                self.plaintext,
                self.router is not None,
                elsewhere,
                private,
            )

    def private(self, hosts: Hosts | None) -> Private:
        """What takes from texts what they tell of machines and keys."""
        return Private(hosts, self.keys)


HERE = Where()
"""On this machine alone."""
