"""(d) How many messages a second go through a link in virtual time, on one core.

Delay with jitter and Gilbert-Elliott loss; every message is sent, and taken off
the link when it is due.
"""

import time

from benchmarks.plan import Plan
from benchmarks.table import Row, Target
from formnet.netem import LinkSettings

TARGET = Target(">=", 150_000)
_SETTINGS = {
    "delay": {"distribution": "normal", "mean_s": 0.02, "stddev_s": 0.005},
    "loss": {"model": "gilbert_elliott", "p": 0.01, "r": 0.3},
}
_SPACING_NS = 1_000_000


def measure(plan: Plan) -> list[Row]:
    """All rounds."""
    plan.say("d: link throughput")
    rates = [_rate(plan.throughput_messages) for _ in range(plan.rounds)]
    note = "normal delay, Gilbert-Elliott loss, 100 bytes"
    return [Row("d", "link in virtual time", rates, "msg/s", TARGET, note)]


def _rate(messages: int) -> float:
    link = LinkSettings.model_validate(_SETTINGS).link(seed=1, source=1, destination=2)
    payload = bytes(100)
    started_s = time.perf_counter()
    for number in range(messages):
        now_ns = number * _SPACING_NS
        link.send(now_ns, number, payload)
        link.deliver(now_ns)
    return messages / (time.perf_counter() - started_s)
