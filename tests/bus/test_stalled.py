"""A client with a valid certificate that does not read: see :mod:`bus.stalled`, which has them all."""

import json

import pytest
from bus.stalled import Kind, run
from in_process import formnet

from formnet.lab.scenarios.packaged import CONFIGS

DURATION_S = 8.0
"""Long enough that all buffers for such a client are full well before the end."""


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """The trajectory of the run in which nobody disturbs."""
    out = tmp_path_factory.mktemp("inline") / "run"
    scenario = CONFIGS / "paper" / "section5-delay.toml"
    options = ("--inline", "--no-figures", "--set", f"duration_s={DURATION_S}", "--out", out)
    assert formnet("run", scenario, *options)[0] == 1
    return json.loads((out / "verdict.json").read_text())["trajectory_sha256"]


@pytest.mark.processes
@pytest.mark.parametrize(
    ("kind", "copies"),
    [
        (Kind("monitor", low_latency=True, stops="process"), 1),
        (Kind("robot-3", low_latency=True, stops="process"), 6),
        (Kind("robot-3", low_latency=False, stops="network"), 1),
    ],
    ids=lambda value: str(value),
)
def test_who_does_not_read_is_disconnected_and_holds_up_nobody(tmp_path, expected, kind, copies):
    found = run(tmp_path, kind, DURATION_S, copies)
    assert found.outcome == "completed", found
    assert found.lost == []
    assert found.disconnected == [kind.who]
    assert found.sha256 == expected
