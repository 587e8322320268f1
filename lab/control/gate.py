"""Who may use the control endpoint: the decision about each request, by its head alone.

A page of any other site can send requests to a loopback address from the browser of whoever looks
at it, and with a name that it makes lead there (DNS rebinding) even read what is answered. So a
request must name this server as its Host (RFC 9110, section 7.2), come from no other page (Origin:
RFC 6454), bring the token (RFC 6750, section 2.1), which no page knows, and say that it brings
JSON, which no form can. Reading needs the token as well: whoever may connect, such as another user
of this machine, could see which links there are and what passes over them.
"""

import secrets
from collections.abc import Mapping
from ipaddress import ip_address
from typing import NamedTuple
from urllib.parse import urlsplit

from formnet.netem.bridge.control import Answer, refusal


def new_token() -> str:
    """256 random bits, as text for an URL."""
    return secrets.token_urlsafe(32)


class Gate(NamedTuple):
    """``host`` is what --control names, ``anywhere`` whether it may be off loopback."""

    host: str
    token: str
    anywhere: bool = False

    def refused(
        self, method: str, headers: Mapping[str, str], *, public: bool = False
    ) -> Answer | None:
        """Why a request is refused; None if it is not.

        ``headers`` are found by any spelling of their names; ``public`` is what needs no token.
        """
        host = headers.get("Host")
        if host is None or not self._is_mine(host):
            return refusal(
                403, "Host must name this endpoint: localhost, its address, or what --control names"
            )
        origin = headers.get("Origin")
        if origin is not None and origin.lower() != f"http://{host}".lower():
            return refusal(403, "Origin: pages of other sites may not use this endpoint")
        if public:
            return None
        scheme, _, token = headers.get("Authorization", "").partition(" ")
        same = secrets.compare_digest(token.strip().encode(), self.token.encode())
        if scheme.lower() != "bearer" or not same:
            return refusal(
                401,
                "the token is missing or wrong; the bridge says at its start which file has it: "
                'curl -H "Authorization: Bearer $(cat FILE)"',
            )
        kind = headers.get("Content-Type", "").partition(";")[0].strip().lower()
        if method == "POST" and kind != "application/json":
            return refusal(415, "Content-Type must be application/json (curl --json does so)")
        return None

    def _is_mine(self, host: str) -> bool:
        """Whether a Host header names this endpoint, on any port: it may be behind a tunnel.

        An address is no name that somebody else could make lead here.
        """
        try:
            parts = urlsplit(f"//{host}")
            name, _ = parts.hostname or "", parts.port
        except ValueError:
            return False
        if parts.netloc != host or "@" in host:
            return False
        if name in ("localhost", self.host.lower()):
            return True
        try:
            return ip_address(name).is_loopback or self.anywhere
        except ValueError:
            return False
