"""What the help says and the shell completes, and what is imported for that."""

import os
import re
import shutil
import subprocess
import sys

import pytest
from click.shell_completion import BashComplete
from click.testing import CliRunner

from formnet.lab import cli
from formnet.lab.cli import SECTIONS, load, main
from formnet.lab.commands import look
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


# --- the help, and what is imported for it ----------------------------------------------------

LINES = {name: line for commands in SECTIONS.values() for name, line in commands.items()}


def imported(*words, complete=None):
    """The modules of commands that a process imports to answer; ``complete`` words instead."""
    code = (
        "import sys\n"
        "from formnet.lab.cli import main\n"
        "try: main(prog_name='formnet')\n"
        "except SystemExit: pass\n"
        "print(*sys.modules, file=sys.stderr)"
    )
    asked = (
        {}
        if complete is None
        else {
            "_FORMNET_COMPLETE": "bash_complete",
            "COMP_WORDS": f"formnet {complete}",
            "COMP_CWORD": str(len(complete.split(" "))),
        }
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | asked,
    )
    assert done.stdout
    found = (name.removeprefix("formnet.lab.") for name in done.stderr.split())
    return {name for name in found if name.startswith("commands")}


def of(folder, command):
    """The modules that one command needs."""
    shared = {"commands", "commands.complete", "commands.options"}
    return shared | {f"commands.{folder}", f"commands.{folder}.{command}"}


def test_the_help_shows_every_command_once_and_whole():
    shown = CliRunner().invoke(main, ["--help"], terminal_width=80).output
    for name, line in LINES.items():
        assert re.findall(rf"^  {name} +(.*)$", shown, re.MULTILINE) == [line]
    assert shown.count("...") == 1  # COMMAND [ARGS]...
    assert max(map(len, shown.splitlines())) <= 80


@pytest.mark.parametrize("name", LINES)
def test_a_command_begins_its_own_help_as_the_list_says(name):
    command = load(name)
    assert command.name == name
    assert command.help.partition("\n\n")[0] == LINES[name]
    shown = CliRunner().invoke(main, [name, "--help"], prog_name="formnet").output
    assert shown.startswith(f"Usage: formnet {name} ")


def test_a_new_command_is_one_file(tmp_path, monkeypatch):
    """Its first line is what the list shows; the file alone makes it a command."""
    (tmp_path / "look").mkdir()
    (tmp_path / "look" / "throw_away.py").write_text(
        '"""Throw RUN away."""\n\nimport click\n\n'
        '@click.command("throw-away")\ndef command():\n    click.echo("thrown")\n',
        encoding="utf-8",
    )
    monkeypatch.setattr(cli, "_FOLDER", tmp_path)
    assert cli._lines("look", ()) == {"throw-away": "Throw RUN away."}
    monkeypatch.setitem(cli.SECTIONS, ("Look back", "look"), cli._lines("look", ()))
    monkeypatch.setattr(look, "__path__", [*look.__path__, str(tmp_path / "look")])
    assert CliRunner().invoke(load("throw-away"), []).output == "thrown\n"


@pytest.mark.processes
@pytest.mark.parametrize(
    ("words", "modules"),
    [(("--help",), set()), (("--version",), set()), (("run", "--help"), of("run", "run"))],
)
def test_help_imports_no_other_command(words, modules):
    assert imported(*words) == modules


@pytest.mark.processes
@pytest.mark.parametrize(
    ("complete", "modules"),
    [("ne", set()), ("keys in", of("machines", "keys")), ("run --in", of("run", "run"))],
)
def test_completion_imports_no_other_command(complete, modules):
    assert imported(complete=complete) == modules


@pytest.mark.processes
def test_no_command_imports_its_work_to_be_declared():
    code = (
        "import sys\nfrom formnet.lab.cli import SECTIONS, load\n"
        "for commands in SECTIONS.values():\n    for name in commands: load(name)\n"
        "print(*sys.modules)"
    )
    loaded = set(subprocess.check_output([sys.executable, "-c", code], text=True).split())
    assert "formnet.lab.commands.run.run" in loaded
    heavy = {"numpy", "pyarrow", "pydantic", "rerun", "rich", "scipy", "zenoh"}
    assert heavy.isdisjoint(loaded)
    assert not {name for name in loaded if name.startswith("formnet.lab.work")}


@pytest.mark.processes
def test_a_run_without_scene_and_lookahead_loads_neither_rerun_nor_scipy(here):
    code = (
        "import sys\nfrom formnet.lab.cli import main\n"
        "try: main(prog_name='formnet')\nexcept SystemExit: pass\n"
        "print(*sys.modules)"
    )
    words = ["run", "section5-delay", "--inline", "--set", "duration_s=0.5", "--out", "out"]
    words += ["--no-figures", "--no-scene", "--no-lookahead"]
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True)
    loaded = done.stdout.splitlines()[-1].split()
    assert "formnet.lab.work.run" in loaded
    assert {"rerun", "scipy", "matplotlib", "networkx"}.isdisjoint(loaded)
    assert (here / "out" / "verdict.json").exists()
    assert not (here / "out" / "run.rrd").exists()
    assert (here / "out" / "report.html").exists()


def test_without_lookahead_a_control_period_that_is_too_long_is_not_warned_of():
    slow = ["check", "section5-delay", "--set", "clock.control_period_s=0.05"]
    slow += ["--set", "clock.broadcast_period_s=0.05"]
    warned = CliRunner().invoke(main, slow)
    trusted = CliRunner().invoke(main, [*slow, "--no-lookahead"])
    assert (warned.exit_code, trusted.exit_code) == (0, 0)
    assert "too long for these gains" in warned.output
    assert "too long for these gains" not in trusted.output


@pytest.mark.parametrize(("words", "near"), [(("nemessis",), "nemesis"), (("keys", "int"), "init")])
def test_an_unknown_command_is_told_what_is_near(words, near):
    told = CliRunner().invoke(main, words)
    assert told.exit_code == 2
    assert f"No such command '{words[-1]}'. Did you mean '{near}'?" in told.output


# --- what the shell completes ------------------------------------------------------------------


def test_commands():
    assert ("plain", "check") in completed("ch")
    assert completed("ne") == [("plain", "nemesis"), ("plain", "netem-bridge"), ("plain", "new")]
    assert [value for _, value in completed("")] == sorted(LINES)
    assert completed("keys", "") == [("plain", name) for name in ("init", "renew", "revoke")]


def test_options():
    assert ("plain", "--inline") in completed("run", "--in")
    assert completed("keys", "init", "--ro") == [("plain", "--robots")]


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


@pytest.mark.processes
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_asks_formnet(shell):
    result = CliRunner().invoke(main, ["completion", shell])
    assert result.exit_code == 0
    assert f"_FORMNET_COMPLETE={shell}_complete" in result.output


@pytest.mark.processes
def test_bash_takes_the_script(tmp_path):
    bash = shutil.which("bash")
    assert bash
    script = tmp_path / "complete.sh"
    script.write_text(CliRunner().invoke(main, ["completion", "bash"]).stdout, encoding="utf-8")
    done = subprocess.run(
        [bash, "--norc", "-c", f"source {script} && complete -p formnet"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "complete -o nosort -F _formnet_completion formnet\n"


def test_another_shell_is_refused():
    assert CliRunner().invoke(main, ["completion", "tcsh"]).exit_code == 2
