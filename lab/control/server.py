"""The control endpoint's HTTP server: Tornado's, in a thread of its own.

What others can make it hold is bounded: connections, heads and bodies in number and bytes, and
the time in which a head, a body or the next request must have come. Whoever keeps connections
open without using them loses the oldest to whoever comes next.
"""

import asyncio
import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream
from tornado.web import Application, RequestHandler, stream_request_body

from formnet.lab.control.gate import Gate
from formnet.lab.control.page import HEADERS, page
from formnet.netem.bridge.control import Answer, refusal

LONGEST_BODY = 1_000_000
MOST_SKIPPED = 64_000_000
"""Bytes of a body that is refused, and taken in so that its sender hears why."""
MOST_CONNECTIONS = 100
HEAD_S, BODY_S = 10.0, 10.0
"""How long a head and a body may take from beginning to end; an idle connection waits as long for
its next head."""
LONGEST_HEAD = 16_384

Answering = Callable[[str, str, bytes], Answer]
"""What is asked: method, path and body."""


@stream_request_body  # the head is looked at before a body is kept
class _Requests(RequestHandler):
    SUPPORTED_METHODS = ("GET", "POST")

    def initialize(self, answering: Answering, gate: Gate) -> None:
        self._answering, self._gate = answering, gate
        self._body = bytearray()
        self._refusal: Answer | None = None

    def set_default_headers(self) -> None:
        self.clear_header("Server")
        for name, value in HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        method = str(self.request.method)
        self._refusal = self._gate.refused(
            method, self.request.headers, public=self._is_page(method)
        )
        if method == "POST" and "Content-Length" not in self.request.headers:
            self._refusal = self._refusal or refusal(411, "a body's Content-Length must be stated")

    def compute_etag(self) -> None:
        """None: nothing is kept by whoever asks."""

    def data_received(self, chunk: bytes) -> None:
        if self._refusal is None and len(self._body) + len(chunk) > LONGEST_BODY:
            self._refusal = refusal(413, f"a body has at most {LONGEST_BODY} bytes")
        if self._refusal is None:
            self._body += chunk
        else:
            self._body.clear()

    def get(self) -> None:
        if self._refusal is None and self._is_page("GET"):
            self.set_header("Content-Type", "text/html; charset=utf-8")
            self.set_header("Content-Security-Policy", page().policy)
            self.finish(page().text)
        else:
            self._respond("GET")

    def post(self) -> None:
        self._respond("POST")

    def write_error(self, status_code: int, **_: Any) -> None:
        self._say(self._refusal or refusal(status_code, self._reason))

    def _is_page(self, method: str) -> bool:
        return method == "GET" and self.request.path == "/"

    def _respond(self, method: str) -> None:
        self._say(self._refusal or self._answering(method, self.request.path, bytes(self._body)))

    def _say(self, answer: Answer) -> None:
        self.set_status(answer.status)
        if answer.status == 401:
            self.set_header("WWW-Authenticate", "Bearer")
        self.set_header("Content-Type", "application/json")
        self.finish(json.dumps(answer.content, indent=2) + "\n")


class _Server(HTTPServer):
    """One that has at most so many connections, those that came last."""

    def initialize(self, *arguments: Any, **options: Any) -> None:
        super().initialize(*arguments, **options)
        self._open: list[IOStream] = []

    def handle_stream(self, stream: IOStream, address: Any) -> None:
        self._open = [one for one in self._open if not one.closed()]
        while len(self._open) >= MOST_CONNECTIONS:
            self._open.pop(0).close()
        self._open.append(stream)
        super().handle_stream(stream, address)


@contextmanager
def serving(sockets: list[socket.socket], answering: Answering, gate: Gate) -> Iterator[None]:
    """Serve at ``sockets``, which listen and are closed in the end, in another thread."""
    loop = asyncio.new_event_loop()
    ended = asyncio.Event()

    async def serve() -> None:
        server = _Server(
            Application(
                [(r".*", _Requests, {"answering": answering, "gate": gate})],
                log_function=lambda _: None,  # the terminal is the bridge's
            ),
            max_header_size=LONGEST_HEAD,
            max_body_size=MOST_SKIPPED,
            idle_connection_timeout=HEAD_S,
            body_timeout=BODY_S,
        )
        server.add_sockets(sockets)
        await ended.wait()
        server.stop()
        await server.close_all_connections()

    def run() -> None:
        with asyncio.Runner(loop_factory=lambda: loop) as runner:
            runner.run(serve())

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        loop.call_soon_threadsafe(ended.set)
        thread.join()
