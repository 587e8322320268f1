"""What the shell completes, by click's own way of asking."""

import shutil
import subprocess

import pytest
from click.shell_completion import BashComplete
from click.testing import CliRunner

from formnet.lab.cli import main
from formnet.lab.scenarios.packaged import packaged


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """A folder with scenarios, other files and runs."""
    for name in (
        "yard.toml",
        "yellow.toml",
        "notes.txt",
        "paper/one.toml",
        "runs/yard-1/verdict.json",
        ".x.toml",
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def completed(*words):
    """``(type, value)`` of everything offered for the last word."""
    found = BashComplete(main, {}, "formnet", "_FORMNET_COMPLETE").get_completions(
        list(words[:-1]), words[-1]
    )
    return [(item.type, item.value) for item in found]


def test_the_help_shows_every_command_once_and_whole():
    from formnet.lab.cli import SECTIONS

    assert sorted(sum(SECTIONS.values(), ())) == sorted(main.commands)
    shown = CliRunner().invoke(main, ["--help"], terminal_width=80).output
    assert shown.count("...") == 1  # COMMAND [ARGS]...
    assert max(map(len, shown.splitlines())) <= 80


def test_commands():
    assert ("plain", "check") in completed("ch")
    assert {"new", "netem-bridge", "nemesis"} <= {value for _, value in completed("ne")}


@pytest.mark.parametrize("command", ["run", "check", "nemesis"])
def test_scenarios_are_toml_files(command):
    there = ["yard.toml", "yellow.toml", "paper/", "runs/"]
    assert completed(command, "") == [("plain", name) for name in [*there, *packaged()]]
    assert completed(command, "ya") == [("plain", "yard.toml"), ("plain", "yard")]
    ours = [name for name in packaged() if name.startswith("paper/")]
    assert completed(command, "paper/") == [("plain", name) for name in ["paper/one.toml", *ours]]
    assert completed(command, "./y") == [("plain", "./yard.toml"), ("plain", "./yellow.toml")]


def test_where_no_scenario_is_near_the_shell_completes_folders():
    assert completed("run", "ru") == [("dir", "ru")]
    assert completed("run", "none/x") == []


def test_run_folders():
    assert completed("verify", "ru") == [("dir", "ru")]
    assert completed("verify", "runs/yard-1", "ru") == [("dir", "ru")]


def test_choices():
    assert completed("new", "x", "--graph", "r") == [("plain", "ring"), ("plain", "random")]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_asks_formnet(shell):
    result = CliRunner().invoke(main, ["completion", shell])
    assert result.exit_code == 0
    assert f"_FORMNET_COMPLETE={shell}_complete" in result.output


def test_bash_takes_the_script(tmp_path):
    bash = shutil.which("bash")
    assert bash
    script = tmp_path / "complete.sh"
    script.write_text(CliRunner().invoke(main, ["completion", "bash"]).stdout, encoding="utf-8")
    done = subprocess.run(
        [bash, "--norc", "-c", f"source {script} && complete -p formnet"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout == "complete -o nosort -F _formnet_completion formnet\n"


def test_another_shell_is_refused():
    assert CliRunner().invoke(main, ["completion", "tcsh"]).exit_code == 2
