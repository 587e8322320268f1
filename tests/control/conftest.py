"""A control endpoint over the links of a bridge that carries nothing."""

from contextlib import ExitStack, contextmanager
from functools import partial
from typing import NamedTuple

import pytest

from formnet.lab.control.endpoint import Asked, opened
from formnet.netem.bridge.control import answer
from formnet.netem.bridge.lanes import LaneFile, Lanes

HOSTILE = "a/\u202e\x1b]0;x\x07<img src=x onerror=alert(1)>"
"""A key expression, and so the name of a link."""


class Links:
    """What of a bridge its control endpoint uses."""

    def __init__(self):
        rules = {"network": {"links": [{"key": "robot/**"}, {"key": HOSTILE}]}}
        self.lanes = Lanes(LaneFile.model_validate(rules))

    def do(self, request):
        return self.lanes.do(request, 0)

    def settings(self):
        return self.lanes.described()

    def statistics(self):
        return [
            {"link": lane.name, "direction": lane.direction, **lane.statistics(0)._asdict()}
            for lane in self.lanes
        ]

    @property
    def cut(self):
        return [lane["link"] for lane in self.settings() if lane["cut"]]


class Open(NamedTuple):
    """An endpoint that is served: its port, its token and where that is, and its links."""

    url: str
    port: int
    token: str
    token_file: object
    links: Links


@contextmanager
def served(port=0):
    """An endpoint on a port of loopback."""
    links = Links()
    with ExitStack() as stack:
        endpoint = stack.enter_context(opened(Asked(f"127.0.0.1:{port}")))
        endpoint.serve(stack, partial(answer, links))
        port = endpoint.sockets[0].getsockname()[1]
        token = endpoint.token.read_text(encoding="ascii").strip()
        yield Open(endpoint.url, port, token, endpoint.token, links)


@pytest.fixture
def control():
    with served() as found:
        yield found


@pytest.fixture
def control_at():
    """To open one on a given port."""
    return served
