"""The control endpoint of a bridge: HTTP with JSON, for curl and scripts."""

import json
import socket
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from pydantic import ValidationError

from formnet.netem.bridge.bridge import Bridge
from formnet.netem.bridge.lanes import ChangeRequest, CutRequest, HealRequest, Request
from formnet.netem.files.problems import problems
from formnet.netem.settings.links import SettingError

_HELP = {
    "GET /statistics": "what became of the messages of every link",
    "GET /network": "the settings of every link",
    "POST /network": 'exactly what is named changes, e.g. {"link": "default", "direction": '
    '"forward", "delay": {"mean_s": 0.1}}; without link and direction: all',
    "POST /cut": '{"link": ..., "direction": ..., "in_flight": "kept" | "lost"}',
    "POST /heal": '{"link": ..., "direction": ...}',
}
_REQUESTS: dict[str, type[Request]] = {
    "/network": ChangeRequest,
    "/cut": CutRequest,
    "/heal": HealRequest,
}
_LONGEST_BODY = 1_000_000
_MOST_SKIPPED, _PIECE = 64_000_000, 65_536


class _Refused(Exception):
    """A request that cannot be met: the status and why."""

    def __init__(self, status: int, *rules: str) -> None:
        self.status = status
        self.rules = rules
        super().__init__("; ".join(rules))


def server(bridge: Bridge, host: str, port: int) -> ThreadingHTTPServer:
    """A server that shows and changes ``bridge`` at an address; the caller runs and closes it.

    Raises:
        OSError: the address cannot be had.
    """

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self._respond(lambda: _shown(bridge, self.path))

        def do_POST(self) -> None:
            self._respond(lambda: _done(bridge, self.path, self._body()))

        def log_message(self, *_: object) -> None:
            """Nothing: the terminal is the bridge's."""

        def _body(self) -> bytes:
            stated = self.headers.get("Content-Length", "0")
            length = int(stated) if stated.isdigit() else 0
            if not stated.isdigit() or length > _LONGEST_BODY:
                self._skip(min(length, _MOST_SKIPPED))
                raise _Refused(413, f"a body has at most {_LONGEST_BODY} bytes, stated beforehand")
            return self.rfile.read(length)

        def _skip(self, length: int) -> None:
            """Take in a body that is refused: who is still sending hears no answer."""
            while length > 0 and self.rfile.read(min(length, _PIECE)):
                length -= _PIECE

        def _respond(self, make: Callable[[], Any]) -> None:
            try:
                status, content = 200, make()
            except _Refused as error:
                status, content = error.status, {"problems": error.rules}
            text = json.dumps(content, indent=2, ensure_ascii=False).encode() + b"\n"
            self.send_response(status)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(text)))
            self.end_headers()
            self.wfile.write(text)

    class Server(ThreadingHTTPServer):
        address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        daemon_threads = True

    return Server((host, port), Handler)


def _shown(bridge: Bridge, path: str) -> Any:
    if path == "/":
        return _HELP
    if path == "/statistics":
        return bridge.statistics()
    if path == "/network":
        return bridge.settings()
    raise _Refused(404, f"there is no {path}; there are: {', '.join(_HELP)}")


def _done(bridge: Bridge, path: str, body: bytes) -> Any:
    kind = _REQUESTS.get(path)
    if kind is None:
        raise _Refused(404, f"there is no POST {path}; there are: {', '.join(_HELP)}")
    try:
        data = json.loads(body or b"{}")
    except (ValueError, RecursionError) as error:
        raise _Refused(400, f"not JSON: {error}") from None
    try:
        lanes = bridge.do(kind.model_validate(data))
    except ValidationError as error:
        raise _Refused(400, *map(str, problems(kind, data, error))) from None
    except (SettingError, LookupError) as error:
        raise _Refused(400, str(error)) from None
    return {"done": [{"link": lane.name, "direction": lane.direction} for lane in lanes]}
