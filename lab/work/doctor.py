"""``formnet doctor``: what a run over these hosts needs and lacks, and what to do about it."""

import os
import shlex
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from formnet.formation.machines.custody import KeysError
from formnet.formation.machines.generations import Generations, parties
from formnet.formation.machines.hosts import Host, Hosts, HostsError, load_hosts
from formnet.formation.wire.security import MONITOR, PLANT
from formnet.lab.launch.interpreter import SAFE
from formnet.lab.machines.probe import Answer, certificate, probe
from formnet.lab.runs.build import install, missing
from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT, BROKEN
from formnet.lab.scene.viewer import ViewerFailed, binary
from formnet.lab.text.streams import styled
from formnet.netem.files.printable import printable

if TYPE_CHECKING:
    from formnet.lab.machines.hosts import Fleet

MOST_CLOCK_OFFSET_S = 0.5
"""A host whose clock differs by more has none that is kept; its logs and certificates suffer."""
SOON_S = 7 * 86400.0
"""A certificate that ends sooner is worth a word."""
_PROBE_S = 30.0


class Check(NamedTuple):
    """One thing that was looked at: ``problem`` is empty if it is as it should be.

    ``soon``: it will not be for long.
    """

    where: str
    what: str
    found: str
    problem: str = ""
    remedy: str = ""
    soon: bool = False


def examine(path: Path | None, keys: Path | None) -> int:
    """Look at this machine and the hosts in ``path``; the exit code of ``formnet doctor``."""
    hosts = None
    try:
        hosts = None if path is None else load_hosts(path)
    except HostsError as error:
        for problem in error.problems:
            _say(f"{error.file}:", str(problem), fg="red")
        return BAD_INPUT
    bad = 0
    for check in checks(hosts, keys):
        mark, colour = ("✗", "red") if check.problem else ("✓", "green")
        if check.soon:
            mark, colour = "!", "yellow"
        told = check.problem or check.found
        _say(mark, f"{check.where}: {check.what}: {told}", fg=colour)
        bad += bool(check.problem)
        if check.problem or check.soon:
            _say(f"    {check.remedy}", bold=True)
    click.echo("no problems found" if not bad else f"problems: {bad}")
    return BROKEN if bad else ALL_HOLD


def _say(head: str, text: str = "", **style: Any) -> None:
    """A line that begins with what has a style."""
    begins = click.style(printable(head, lines=True), **style)
    line = f"{begins} {printable(text, lines=True)}" if text else begins
    click.echo(line, file=styled(sys.stdout))


def checks(hosts: Hosts | None, keys: Path | None) -> Iterator[Check]:
    """Everything, one after another: this machine first."""
    here = probe(None, None, [])
    yield Check("here", "formnet", _versions(here))
    for extra, purpose in (
        ("lab", "to run, watch and judge; a robot needs none of it"),
        ("hosts", "robots on other hosts, and certificates"),
        ("export", "formnet export --format mcap"),
    ):
        lacks = f"not installed; {purpose}: {install(extra)}"
        yield Check("here", f"extra {extra}", lacks if missing(extra) else purpose)
    if not missing("lab"):
        yield from _watching()
    if keys is not None:
        for name in sorted({PLANT, MONITOR, *(parties(keys) if keys.is_dir() else ())}):
            yield _certificate("here", name, certificate(keys, name), None)
    if hosts is None:
        return
    try:
        from formnet.lab.machines.hosts import Fleet
    except ModuleNotFoundError:
        yield Check("here", "SSH", "", "the package asyncssh is missing", install("hosts"))
        return
    with _listening(hosts.listen) as trouble, Fleet() as fleet:
        yield Check(
            "here",
            "port",
            f"can listen at {hosts.listen}",
            trouble and f"cannot listen at {hosts.listen}: {trouble}",
            "stop the program that listens there, or choose another address or port of this "
            "machine as `listen` in the hosts file",
        )
        plant = None if keys is None else _plant(keys)
        for host in hosts.hosts:
            yield from _of_host(fleet, host, hosts.listen, here, plant, open_=not trouble)


def _watching() -> Iterator[Check]:
    """Whether a run can be watched, and where."""
    try:
        found = binary()
    except ViewerFailed as error:
        yield Check("here", "viewer", "", str(error), "pip install --force-reinstall rerun-sdk")
        return
    shown = sys.platform != "linux" or {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()
    how = "--view and --web" if shown else "only --web: there is no display for a window"
    yield Check("here", "viewer", f"{found}; {how}")


def _of_host(
    fleet: "Fleet",
    host: Host,
    listen: str,
    here: dict[str, Any],
    plant: "Plant | None",
    *,
    open_: bool,
) -> Iterator[Check]:
    from formnet.lab.machines.hosts import HostLost

    try:
        fleet.run(host, "true")
    except HostLost as error:
        yield Check(
            host.name,
            "SSH",
            "",
            str(error),
            f"make sure that `ssh {host.ssh} true` works "
            "without a password, and that the host's key is known",
        )
        return
    yield Check(host.name, "SSH", f"{host.ssh} accepts the connection")
    place = listen.partition("/")[2]
    command = [
        host.python,
        SAFE,
        "-m",
        "formnet.lab.machines.probe",
        *(["--reach", place] if open_ else []),
    ]
    if host.keys is not None:
        command += ["--keys", host.keys, "--robots", ",".join(map(str, host.robots))]
    said = ""
    try:
        before_s = time.time()
        _, said = fleet.run(host, shlex.join(command), _PROBE_S)
        after_s = time.time()
        there = Answer.model_validate_json(said.splitlines()[-1]).model_dump()
    except (HostLost, ValueError, IndexError) as error:
        reason = said.splitlines()[-1][:200] if said else str(error)
        yield Check(
            host.name,
            "formnet",
            "",
            f"{host.python} has no formnet: {reason}",
            "install the same version there, and set `python` to its interpreter",
        )
        return
    yield from _version(host, here, there)
    yield _clock(host, before_s, there["unix_s"], after_s)
    if open_:
        yield Check(
            host.name,
            "port",
            f"reaches {place}",
            there["reach"] and f"cannot reach {place}: {there['reach']}",
            f"open that port for {host.name} in the firewall here, or set `listen` to an "
            "address by which it can reach this machine",
        )
    for name, found in there.get("keys", {}).items():
        yield _certificate(host.name, name, found, plant)


def _versions(found: dict[str, Any]) -> str:
    names = ", ".join(f"{name} {number}" for name, number in found["packages"].items())
    return f"{names}, protocol {found['protocol']}" + (
        "" if found["compiled"] else ", not compiled"
    )


def _version(host: Host, here: dict[str, Any], there: dict[str, Any]) -> Iterator[Check]:
    same = (here["packages"], here["protocol"]) == (there["packages"], there["protocol"])
    problem = "" if same else f"has {_versions(there)}, and here is {_versions(here)}"
    version = here["packages"].get("formnet", "")
    yield Check(
        host.name,
        "formnet",
        _versions(there),
        problem,
        f"install the same there: {host.python} -m pip install 'formnet=={version}'",
    )


def _clock(host: Host, before_s: float, there_s: float, after_s: float) -> Check:
    """The host's clock was read between two instants of ours."""
    least_s, most_s = there_s - after_s, there_s - before_s
    middle_s, error_s = (least_s + most_s) / 2, (most_s - least_s) / 2
    off = abs(middle_s) - error_s > MOST_CLOCK_OFFSET_S
    found = f"{middle_s:+.2f} s ± {error_s:.2f} s from ours"
    return Check(
        host.name,
        "clock",
        found,
        found if off else "",
        "run an NTP client there and here (chrony, systemd-timesyncd)",
    )


def _certificate(where: str, name: str, found: dict[str, Any], plant: "Plant | None") -> Check:
    """What ``found`` says of a certificate, which must be one that ``plant`` admits, if known."""
    from formnet.lab.machines.certificates import BadCertificate, examine

    what = f"certificate of {name}"
    try:
        seen = examine(found)
    except BadCertificate as error:
        return Check(where, what, "", str(error), error.remedy)
    if plant is not None and seen.authority_sha256 != plant.authority_sha256:
        problem = "is signed by another authority than the plant's"
        return Check(where, what, "", problem, "copy ca.pem and certificates signed by it there")
    if plant is not None and plant.counting.admitted(name) != seen.common_name:
        return Check(
            where,
            what,
            "",
            f"{seen.common_name} is revoked or was renewed",
            f"copy {name}.pem and {name}-key.pem there; if there are no newer ones where "
            f"ca-key.pem is, `formnet keys renew DIR {name}` makes them",
        )
    found_it = f"{seen.common_name}, valid until {seen.expires.isoformat(timespec='minutes')}"
    if seen.expires.timestamp() - time.time() > SOON_S:
        return Check(where, what, found_it)
    if seen.authority_expires == seen.expires:
        remedy = "its authority ends then: make a new one in another folder (`formnet keys init`)"
    else:
        remedy = f"where ca-key.pem is: `formnet keys renew DIR {name}`; copy its files there"
    return Check(where, what, f"{found_it}, soon", remedy=remedy, soon=True)


class Plant(NamedTuple):
    """What the plant accepts: certificates of one authority, those that count."""

    authority_sha256: str
    counting: Generations


def _plant(keys: Path) -> Plant | None:
    """What it accepts with its keys in ``keys``; None if they are invalid."""
    from formnet.lab.machines.certificates import BadCertificate, examine

    try:
        sha256 = examine(certificate(keys, PLANT)).authority_sha256
        return Plant(sha256, Generations.read(keys))
    except (BadCertificate, KeysError):
        return None


@contextmanager
def _listening(endpoint: str) -> Iterator[str]:
    """Listen where the plant will; yields why that cannot be, if so."""
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        server = socket.create_server((host.strip("[]"), int(port)), family=family)
    except OSError as error:
        yield str(error)
        return
    with server:
        threading.Thread(target=_accept, args=(server,), daemon=True).start()
        yield ""


def _accept(server: socket.socket) -> None:
    while True:
        try:
            server.accept()[0].close()
        except OSError:  # closed
            return
