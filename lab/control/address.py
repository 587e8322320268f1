"""Where a control endpoint listens: on this machine alone, unless more is asked for."""

import errno
import socket
from ipaddress import ip_address
from typing import NamedTuple

from tornado.netutil import bind_sockets

_NOT_HERE = {errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT}
"""Of an address that a name has and the machine has not: ``localhost`` in IPv6, say."""


class BadAddress(ValueError):
    """No HOST:PORT, or one off loopback that was not allowed."""


class Address(NamedTuple):
    """``host`` is a name or an address without brackets, ``port`` 0 for any that is free."""

    host: str
    port: int

    def url(self, port: int) -> str:
        """The address of a page; ``port`` is the one that was given."""
        return f"http://{f'[{self.host}]' if ':' in self.host else self.host}:{port}/"


def parse(text: str) -> Address:
    """``HOST:PORT`` as an address.

    Raises:
        BadAddress: it is none.
    """
    host, colon, port = text.rpartition(":")
    digits = port.isascii() and port.isdigit() and len(port) <= 5
    if not colon or not host or not digits or int(port) > 65535:
        raise BadAddress(f"--control {text}: must be HOST:PORT, such as 127.0.0.1:8765")
    return Address(host.strip("[]"), int(port))


def listening(address: Address, *, anywhere: bool) -> list[socket.socket]:
    """Sockets that listen at every address that the host has, all on one port.

    Raises:
        BadAddress: one of them is off loopback, and not ``anywhere``.
        OSError: they cannot be had.
    """
    # What was checked is what is bound: a name is looked up once.
    kind, passive = socket.SOCK_STREAM, socket.AI_PASSIVE
    found = socket.getaddrinfo(address.host, address.port, type=kind, flags=passive)
    hosts = list(dict.fromkeys(str(entry[4][0]) for entry in found))
    if not anywhere:
        for host in hosts:
            if not ip_address(host.partition("%")[0]).is_loopback:
                raise BadAddress(
                    f"--control {address.host}:{address.port}: {host} is off loopback: whoever can "
                    "reach it can listen to what is sent, the token with it. Use 127.0.0.1 and an "
                    "SSH tunnel, or allow it with --control-anywhere, on a network that you trust"
                )
    sockets: list[socket.socket] = []
    for host in hosts:
        port = sockets[0].getsockname()[1] if sockets else address.port
        try:
            sockets += bind_sockets(port, host)
        except OSError as error:
            if error.errno not in _NOT_HERE or (host == hosts[-1] and not sockets):
                close(sockets)
                raise
    return sockets


def close(sockets: list[socket.socket]) -> None:
    """Close them all."""
    for one in sockets:
        one.close()
