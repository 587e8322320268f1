"""Names and addresses of machines, as files and options give them: what is none is refused."""

import re
from ipaddress import IPv6Address, ip_address
from typing import NamedTuple

_LABEL = re.compile(r"[A-Za-z0-9_]([A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?", re.ASCII)
_USER = re.compile(r"[A-Za-z0-9_.][A-Za-z0-9_.@\\+$-]*", re.ASCII)
_LONGEST_NAME = 253


class BadAddress(ValueError):
    """A text is no address; what it must be instead."""


def host(text: str, *, zone: bool = False) -> str:
    """A host name (RFC 1123, underscores allowed) or an IP address, without brackets around it.

    ``zone``: an IPv6 address may name an interface, as in ``fe80::1%eth0`` (RFC 4007).

    Raises:
        BadAddress: it is neither.
    """
    if not text:
        raise BadAddress("must name a machine")
    if not text.isprintable() or any(letter.isspace() for letter in text):
        raise BadAddress("must have no spaces or control characters")
    if not text.isascii():
        raise BadAddress("must be ASCII: write the A-label (xn--...) of an international name")
    bare = text[1:-1] if text.startswith("[") and text.endswith("]") else text
    if ":" in bare or bare != text:
        return _ipv6(bare, zone=zone)
    last = bare.rpartition(".")[2]
    if last.isdigit():
        try:
            return str(ip_address(bare))
        except ValueError:
            raise BadAddress("must be an IPv4 address such as 192.168.1.10") from None
    if len(bare) > _LONGEST_NAME or not all(_LABEL.fullmatch(part) for part in bare.split(".")):
        raise BadAddress("must be one address or host name: letters, digits, hyphens, dots")
    return bare


def _ipv6(bare: str, *, zone: bool) -> str:
    address, percent, interface = bare.partition("%")
    try:
        found = IPv6Address(address)
    except ValueError:
        raise BadAddress("must be an IPv6 address such as fd00::10") from None
    if percent and not zone:
        raise BadAddress("must have no zone (%...): it means something on one machine only")
    if percent and not _LABEL.fullmatch(interface):
        raise BadAddress("must name an interface after %")
    return f"{found}{percent}{interface}"


def port(digits: str) -> int:
    """The number of a TCP port.

    Raises:
        BadAddress: it is none.
    """
    if not re.fullmatch(r"[0-9]{1,5}", digits) or not 1 <= int(digits) <= 65535:
        raise BadAddress("must have a port from 1 to 65535")
    return int(digits)


class Target(NamedTuple):
    """Where SSH logs in; an empty ``user``, or the port 0, is for SSH's configuration to say."""

    user: str
    address: str
    port: int


def ssh_target(text: str) -> Target:
    """``user@address:port`` in parts; user and port may be missing, IPv6 needs brackets for one.

    Raises:
        BadAddress: it is none.
    """
    user, at, place = text.rpartition("@")
    if at and not _USER.fullmatch(user):
        raise BadAddress("must be user@address:port, with a plain user name before the @")
    name, digits = place, ""
    if place.startswith("["):
        name, bracket, rest = place.partition("]")
        name += bracket
        if rest and not rest.startswith(":"):
            raise BadAddress("must be user@[address]:port")
        digits = rest
    elif place.count(":") == 1:
        name, colon, number = place.partition(":")
        digits = colon + number
    return Target(user, host(name, zone=True), port(digits[1:]) if digits else 0)


def endpoint(text: str) -> tuple[str, str, int]:
    """``tcp/ADDRESS:PORT`` or ``tls/ADDRESS:PORT``: protocol, address, port; no settings after it.

    Raises:
        BadAddress: it is none, or of no one machine (``0.0.0.0``).
    """
    protocol, slash, place = text.partition("/")
    name, colon, digits = place.rpartition(":")
    if protocol not in ("tcp", "tls") or not slash or not colon:
        raise BadAddress("must be tls/ADDRESS:PORT (or tcp/ADDRESS:PORT with --plaintext)")
    if ":" in name and not name.startswith("["):
        raise BadAddress("must have brackets around an IPv6 address: tls/[fd00::10]:7447")
    number, address = port(digits), host(name)
    if address in ("0.0.0.0", "::"):
        raise BadAddress("must be an address of this machine that the hosts can reach")
    return protocol, address, number
