"""What is found out before a run, with laws that do not behave."""

import sys

import pytest
from click.testing import CliRunner
from plugin import install

from formnet.agent.law import installed
from formnet.formation.scenario.loading import load
from formnet.lab.cli import main
from formnet.lab.forecast import foresight
from formnet.lab.forecast.foresight import foresee

pytestmark = pytest.mark.processes

LAW = """\
import os, sys
{head}
class Law:
    def __init__(self, situation):
        self.robot = situation.robot
        {init}
    def command(self, now_ns, own, heard):
        {command}
"""


@pytest.fixture
def scenario(root):
    return load(root / "configs" / "yard.toml", ["law.kind=odd", "clock.mode=lockstep"])


@pytest.fixture
def law(tmp_path, monkeypatch):
    """A function that installs a law with these lines in it."""

    def made(head="", init="pass", command="return 0.0, 0.0"):
        install(tmp_path, "odd", LAW.format(head=head, init=init, command=command))
        monkeypatch.syspath_prepend(tmp_path)
        installed.cache_clear()

    yield made
    monkeypatch.undo()
    installed.cache_clear()
    assert "odd_law" not in sys.modules, "it was imported here"


@pytest.mark.parametrize(
    ("lines", "problem"),
    [
        ({"head": "1 / 0"}, "ZeroDivisionError: division by zero (odd_law.py:2)"),
        ({"head": "sys.exit(3)"}, "cannot be imported: SystemExit: 3"),
        (
            {"head": "os._exit(0)"},
            "ended its process (exit code 0) while it was imported and constructed",
        ),
        ({"head": "os.abort()"}, "crashed its process (signal 6) while it was imported and"),
        (
            {"init": "raise ValueError('mine')"},
            "law 'odd' refuses robot 1: mine (odd_law.py:6)",
        ),
        ({"init": "sys.exit(5)"}, "law 'odd' fails for robot 1: SystemExit: 5 (odd_law.py:6)"),
    ],
    ids=str,
)
def test_a_law_that_cannot_be_had(law, scenario, lines, problem):
    law(**lines)
    found = foresee(scenario)
    assert problem in (found.problem or "")
    assert found.warnings == []


@pytest.mark.parametrize(
    ("command", "warning"),
    [
        (
            "return 1 / 0, 0.0",
            "before the run: robot 1: ZeroDivisionError: division by zero (odd_law.py:8)",
        ),
        ("sys.exit(1)", "before the run: robot 1: SystemExit: 1 (odd_law.py:8)"),
        (
            "return None",
            "robot 1: TypeError: the law must return two numbers, not None (odd_law.py:7)",
        ),
        ("raise KeyboardInterrupt", "before the run: robot 1: KeyboardInterrupt (odd_law.py:8)"),
        ("return 'fast', 0.0", "TypeError: the law must return two numbers, not ('fast', 0.0)"),
        ("os._exit(7)", "law 'odd' ended its process (exit code 7) in the trial before"),
    ],
)
def test_a_law_that_fails_is_had_and_warned_of(law, scenario, command, warning):
    law(command=command)
    found = foresee(scenario)
    assert found.problem is None
    assert warning in found.warnings[-1]


def test_of_a_law_that_behaves_nothing_is_feared(law, scenario):
    law(command="return 0.0, -0.001 * own.heading_rad")
    found = foresee(scenario)
    assert found.problem is None
    assert found.warnings == []


def test_a_law_that_never_comes_back_is_given_up(law, scenario, monkeypatch):
    law(command="while True: pass")
    monkeypatch.setattr(foresight, "FOLLOW_S", 0.5)
    found = foresee(scenario)
    assert found.problem is None
    assert found.warnings[-1] == (
        "law 'odd' did not return within 0.5 s in the trial before the run"
    )


def test_a_law_that_is_never_there_is_given_up_and_it_is_said_where_it_is(
    law, scenario, monkeypatch
):
    law(init="while True: pass")
    monkeypatch.setattr(foresight, "GET_S", 8.0)
    said = []
    found = foresee(scenario, said.append)
    assert said == ["the law has not returned yet; it is at odd_law.py:6"]
    assert found.problem == "law 'odd' was not ready within 8 s (it is at odd_law.py:6)"


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ("while True: pass", "law 'odd' was not ready within 1 s"),
        ("1 / 0", "(odd_law:Law) cannot be imported: ZeroDivisionError"),
        ("os._exit(3)", "law 'odd' ended its process (exit code 3)"),
        ("", None),
    ],
)
def test_the_list_of_laws_says_which_cannot_be_imported(law, monkeypatch, head, words):
    law(head=head)
    if words is not None and "within" in words:
        monkeypatch.setattr(foresight, "IMPORT_S", 1.0)
    result = CliRunner().invoke(main, ["laws"])
    assert result.exit_code == 0
    lines = result.output.splitlines()
    assert [line.split()[0] for line in lines if line[0] != " "] == [
        "cooperative",
        "leader_follower",
        "odd",
    ]
    problems = [line.strip() for line in lines if line[0] == " "]
    assert len(problems) == (words is not None)
    assert words is None or words in problems[0]
