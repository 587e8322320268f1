"""What a broadcast weighs on a link that has a rate, a queue or slots: a matter of the scenario.

The name of a run decides nothing.
"""

import pytest
from in_process import collected

from formnet.formation.wire.broadcast import BROADCAST_BYTES
from formnet.lab.runs.recording import trajectory_sha256
from formnet.netem.core.statistics import Fate, summarise

LINKS = {
    "rate": "rate={bits_per_s=80000}",
    "queue": "queue={bytes=700}, rate={bits_per_s=60000}",
    "slots": "slots={min_s=0.02, max_s=0.04, bytes=200}",
    "cells": "rate={bits_per_s=100000, cell_bytes=48, cell_overhead_bytes=5}",
}


@pytest.mark.parametrize("link", LINKS)
def test_a_run_s_name_decides_nothing(paper, link):
    delay = 'delay={distribution="constant", mean_s=0.1}'
    scenario = paper(
        "section5-delay", "duration_s=2.0", f"network.default={{{delay}, {LINKS[link]}}}"
    )
    runs = [
        collected(scenario.model_copy(update={"name": name}))
        for name in ("a", "a-much-longer-name-of-the-same-run")
    ]
    assert len({trajectory_sha256(run.samples) for run in runs}) == 1
    assert runs[0].sorted_link_rows == runs[1].sorted_link_rows


def test_a_rate_adds_the_same_time_to_every_message(paper):
    """72 bytes at 80 kbit/s are 7.2 ms on the line, less than the 10 ms to the next message."""
    delay = 'delay={distribution="constant", mean_s=0.1}'
    run = collected(
        paper("section5-delay", "duration_s=2.0", f"network.default={{{delay}, {LINKS['rate']}}}"),
    )
    assert BROADCAST_BYTES == 72
    arrived = [row for row in run.link_rows if row.t_usable_ns is not None]
    assert len(arrived) > 1000
    assert {row.t_usable_ns - row.t_sent_ns for row in arrived} == {107_200_000}
    fates = [
        Fate(row.sequence, row.t_sent_ns, row.t_usable_ns, row.fate)
        for row in arrived
        if (row.source, row.destination) == (1, 2)
    ]
    assert summarise(fates, 2 * 10**9).jitter_s == 0.0
