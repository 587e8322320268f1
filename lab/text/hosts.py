"""Where a run's robots would be started on other machines, in lines for people."""

from formnet.formation.machines.hosts import Hosts
from formnet.formation.records.events import named


def describe_hosts(hosts: Hosts) -> list[str]:
    """Who would be logged in to, what would be started there, and with which keys."""
    lines = [f"    the plant listens at {hosts.listen}"]
    for host in hosts.hosts:
        keys = "without keys" if host.keys is None else f"with the keys in {host.keys}"
        lines.append(
            f"    {hosts.number(host)} ({host.name}): logs in to {host.ssh} with your SSH keys and "
            f"starts {named(host.robots)} there with {host.python}, {keys}"
        )
    return lines


def describe_use(own: Hosts | None, used: Hosts | None) -> list[str]:
    """``own``, those of a scenario, and ``used``, which the user named; nothing without either."""
    lines = []
    if used is not None:
        lines += ["  hosts, to be used:", *describe_hosts(used)]
    if own is not None and used is not own:
        lines += ["  [hosts], used with --hosts scenario alone:", *describe_hosts(own)]
    return lines
