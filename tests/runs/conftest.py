"""A recorded run, for tests that damage copies of it."""

import pytest
from in_process import formnet

from formnet.lab.scenarios.packaged import CONFIGS


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """The folder of a run of 0.2 s."""
    out = tmp_path_factory.mktemp("hostile") / "good"
    words = ("--inline", "--no-scene", "--no-figures", "--no-lookahead", "--set", "duration_s=0.2")
    assert formnet("run", CONFIGS / "paper" / "section5.toml", *words, "--out", out)[0] == 1
    (out / "figures").mkdir()  # so that nobody draws them
    return out
