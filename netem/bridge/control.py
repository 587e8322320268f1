"""What the control endpoint of a bridge answers. No socket: ``lab/control/`` serves it."""

import json
from typing import Any, NamedTuple

from pydantic import ValidationError

from formnet.netem.bridge.bridge import Bridge
from formnet.netem.bridge.lanes import ChangeRequest, CutRequest, HealRequest, Request
from formnet.netem.files.problems import problems
from formnet.netem.settings.links import SettingError

HELP = {
    "GET /statistics": "what became of the messages of every link",
    "GET /network": "the settings of every link",
    "POST /network": 'exactly what is named changes, e.g. {"link": "default", "direction": '
    '"forward", "delay": {"mean_s": 0.1}}; without link and direction: all',
    "POST /cut": '{"link": ..., "direction": ..., "in_flight": "kept" | "lost"}',
    "POST /heal": '{"link": ..., "direction": ...}',
}
"""Every request and what it is for."""
_REQUESTS: dict[str, type[Request]] = {
    "/network": ChangeRequest,
    "/cut": CutRequest,
    "/heal": HealRequest,
}


class Answer(NamedTuple):
    """An HTTP status, and what JSON says; ``{"problems": [...]}`` if the status is no 200."""

    status: int
    content: Any


def refusal(status: int, *rules: str) -> Answer:
    """The answer to a request that is not met, and why."""
    return Answer(status, {"problems": rules})


def answer(bridge: Bridge, method: str, path: str, body: bytes) -> Answer:
    """Show or change ``bridge``; ``method`` is GET or POST, ``body`` what a POST brings."""
    if method == "POST":
        return _done(bridge, path, body)
    if path == "/statistics":
        return Answer(200, bridge.statistics())
    if path == "/network":
        return Answer(200, bridge.settings())
    return refusal(404, f"there is no {path}; there are: {', '.join(HELP)}")


def _done(bridge: Bridge, path: str, body: bytes) -> Answer:
    kind = _REQUESTS.get(path)
    if kind is None:
        return refusal(404, f"there is no POST {path}; there are: {', '.join(HELP)}")
    try:
        data = json.loads(body or b"{}")
    except (ValueError, RecursionError) as error:
        return refusal(400, f"not JSON: {error}")
    try:
        lanes = bridge.do(kind.model_validate(data))
    except ValidationError as error:
        return refusal(400, *map(str, problems(kind, data, error)))
    except (SettingError, LookupError) as error:
        return refusal(400, str(error))
    return Answer(
        200, {"done": [{"link": lane.name, "direction": lane.direction} for lane in lanes]}
    )
