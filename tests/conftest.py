"""What all tests share: the paper's scenarios, and random tests that repeat."""

import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from guard import Guard
from hypothesis import settings
from processes import missing

from formnet.formation.scenario.loading import load
from formnet.formation.scenario.model import Scenario
from formnet.lab.runs.build import stale

ROOT = Path(__file__).resolve().parents[1]

# Derandomized: every run of a test draws the same examples, so a failure repeats.
settings.register_profile(
    "formnet", derandomize=True, deadline=None, max_examples=50, database=None
)
settings.load_profile("formnet")


def pytest_configure(config: pytest.Config) -> None:
    """Refuse to test compiled modules that are older than their source; signals as at a terminal.

    What is started in the background, or by nohup, ignores them, and so would what it starts.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    problem = stale()
    if problem is not None:
        raise pytest.UsageError(problem)
    guard = Guard()
    guard.install()
    config.pluginmanager.register(guard, "guard")


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository."""
    return ROOT


@pytest.fixture(scope="session")
def paper() -> Callable[..., Scenario]:
    """``paper("theorem4", "law.beta=5", ...)``: a scenario of configs/paper, overridden."""

    def scenario(name: str, *overrides: str) -> Scenario:
        return load(ROOT / "configs" / "paper" / f"{name}.toml", overrides)

    return scenario


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium; the name ``rebound.test`` leads to this machine in it, as in an attack by DNS."""
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium")
    if program is None:
        missing("chromium")
    with sync_playwright() as tool:
        chromium = tool.chromium.launch(
            executable_path=program,
            args=[
                "--no-sandbox",
                "--disable-background-networking",
                "--disable-component-update",
                "--disable-sync",
                "--no-first-run",
                "--host-resolver-rules=MAP rebound.test 127.0.0.1",
            ],
        )
        yield chromium
        chromium.close()
