"""A control endpoint from its option to its end: address, token, file of the token, server."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from formnet.lab.control.address import close, listening, parse
from formnet.lab.control.gate import Gate, new_token
from formnet.lab.control.server import Answering, serving
from formnet.lab.control.token_file import token_file


class Asked(NamedTuple):
    """``HOST:PORT``, the file for the token (None: a temporary one), and whether off loopback."""

    control: str
    token: Path | None = None
    anywhere: bool = False


class Endpoint(NamedTuple):
    """One that listens: its page's address with the token, where that is written, its sockets."""

    url: str
    token: Path
    sockets: list[socket.socket]
    gate: Gate

    def serve(self, stack: ExitStack, answering: Answering) -> None:
        """Answer from now on, until ``stack`` ends."""
        stack.enter_context(serving(self.sockets, answering, self.gate))


@contextmanager
def opened(asked: Asked) -> Iterator[Endpoint]:
    """An endpoint with a new token.

    Raises:
        BadAddress: no HOST:PORT, or off loopback where that was not allowed.
        FileExistsError: there is something in the token's place.
        OSError: no such address here, or the token cannot be written.
    """
    address = parse(asked.control)
    gate = Gate(address.host, new_token(), asked.anywhere)
    sockets = listening(address, anywhere=asked.anywhere)
    try:
        with token_file(gate.token, asked.token) as place:
            port = sockets[0].getsockname()[1]
            yield Endpoint(f"{address.url(port)}#token={gate.token}", place, sockets, gate)
    finally:
        close(sockets)
