"""Code in files that a scenario names is executed only if its user has said so, and as it was read."""

import importlib.util
import json
import os
import py_compile
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

import formnet
from formnet.agent.law import UnknownLaw, load
from formnet.agent.law_file import MOST_BYTES, LawFile
from formnet.formation.scenario.loading import ScenarioError
from formnet.lab.cli import main
from formnet.lab.code import allowed
from formnet.lab.scenarios.packaged import CONFIGS

LAW = """\
from pathlib import Path

from formnet import Command

with Path({said!r}).open("a") as stream:
    stream.write("executed\\n")


class MyLaw:
    def __init__(self, situation):
        self.gain = 0.01 * situation.robot

    def command(self, now_ns, own, heard):
        return Command(self.gain, 0.1 * own.heading_rad)
"""
SHORT = ("--set", "duration_s=0.5", "--set", "clock.mode=lockstep")
QUIET = ("--no-figures", "--no-scene")


@pytest.fixture
def received(tmp_path, monkeypatch):
    """A folder with a scenario whose law is code that lies beside it and says that it ran."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    folder = tmp_path / "received"
    folder.mkdir()
    text = (CONFIGS / "yard.toml").read_text()
    mine = text.replace('kind = "cooperative"', 'kind = "laws.py:MyLaw"')
    assert mine != text
    (folder / "scenario.toml").write_text(mine)
    (folder / "laws.py").write_text(LAW.format(said=str(tmp_path / "said")))
    monkeypatch.chdir(tmp_path)
    return folder


def executed(folder):
    """How often the code has been executed since this was asked last."""
    said = folder.parent / "said"
    times = said.read_text().count("executed") if said.exists() else 0
    said.unlink(missing_ok=True)
    return times


def called(*words):
    result = CliRunner().invoke(main, list(map(str, words)))
    assert not result.exception or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


def verdict(folder):
    return json.loads((folder / "verdict.json").read_text())


# --- what nobody has allowed is not executed -------------------------------------------


@pytest.mark.parametrize(
    "words",
    [
        ["run", "scenario.toml", *SHORT, *QUIET, "--out", "out"],
        ["run", "scenario.toml", "--inline", *SHORT, *QUIET, "--out", "out"],
        ["nemesis", "scenario.toml", "--inline", "--runs", "1", *SHORT, "--out", "out"],
    ],
    ids=["run", "inline", "nemesis"],
)
def test_a_law_in_a_file_is_refused_before_anything_is_written(received, monkeypatch, words):
    monkeypatch.chdir(received)
    code, said = called(*words)
    assert code == 2
    assert "law.kind = 'laws.py:MyLaw': MyLaw is code in the file laws.py" in said
    assert executed(received) == 0
    assert not (received / "out").exists()


def test_check_names_what_would_be_executed_and_executes_nothing(received):
    code, said = called("check", received / "scenario.toml", *SHORT)
    assert code == 0, said
    digest = LawFile.read(f"{received / 'laws.py'}:MyLaw").sha256
    assert f"MyLaw is code in the file laws.py (SHA-256 {digest})" in said
    assert executed(received) == 0


def test_the_api_executes_nothing_either(received):
    for call in (formnet.run, formnet.check):
        with pytest.raises(ScenarioError, match="code in the file"):
            call(received / "scenario.toml", {"clock.mode": "lockstep"})
    assert executed(received) == 0


def test_a_robot_executes_no_file_that_only_the_plant_has_named():
    with pytest.raises(UnknownLaw, match="not given to this process"):
        load("laws.py:MyLaw")


def test_what_is_not_python_or_not_there_is_said_without_executing_it(received):
    for source, words in (
        ("class Other: pass\n", "laws.py defines no 'MyLaw' at its top"),
        ("def MyLaw(:\n", "laws.py, line 1: not Python"),
        ("x = " + "(" * 100_000, "not Python"),
        ("x = " + "-" * 300_000 + "1", "not Python"),
        ("\0", "not Python"),
        ("#" * (MOST_BYTES + 1), "laws.py cannot be read: it is longer than 1 MiB"),
    ):
        (received / "laws.py").write_text(source)
        code, said = called("check", received / "scenario.toml", "--allow-code", *SHORT)
        assert code == 2
        assert words in said, said


@pytest.mark.parametrize(
    "kind", ["../laws.py:MyLaw", "/tmp/laws.py:MyLaw", "laws.py:os.system", ".laws.py:MyLaw", "a:b"]
)
def test_only_a_file_below_the_scenario_can_be_named(received, kind):
    words = ["--set", f"law.kind={kind}", "--allow-code", *SHORT]
    code, said = called("check", received / "scenario.toml", *words)
    assert code == 2
    assert "with a file below the scenario's folder" in said


def test_links_pipes_and_folders_are_no_laws(received):
    elsewhere = received.parent / "elsewhere"
    elsewhere.mkdir()
    shutil.move(received / "laws.py", elsewhere / "laws.py")
    (received / "laws.py").symlink_to(elsewhere / "laws.py")
    (received / "linked").symlink_to(elsewhere)
    (received / "folder.py").mkdir()
    os.mkfifo(received / "pipe.py")
    for kind, words in (
        ("laws.py:MyLaw", "leads out of the scenario's folder"),
        ("linked/laws.py:MyLaw", "leads out of the scenario's folder"),
        ("folder.py:MyLaw", "cannot be read"),
        ("pipe.py:MyLaw", "cannot be read: it is no regular file"),
    ):
        options = ["--set", f"law.kind={kind}", "--allow-code", *SHORT]
        code, said = called("check", received / "scenario.toml", *options)
        assert code == 2
        assert words in said, said
    assert executed(received) == 0


# --- what is allowed, is -----------------------------------------------------------------


@pytest.mark.processes
def test_what_was_allowed_once_is_executed_until_it_changes(received):
    scenario = received / "scenario.toml"
    words = [scenario, "--inline", *SHORT, *QUIET, "--out"]
    code, said = called("allow", received)
    assert (code, "allowed: 1 file in" in said) == (0, True)
    assert executed(received) == 0
    assert called("run", *words, "first")[0] in (0, 1)
    assert executed(received) > 0

    with (received / "laws.py").open("a") as stream:
        stream.write("#")
    assert called("run", *words, "second")[0] == 2
    assert called("allow", received)[0] == 0
    assert called("run", *words, "second")[0] in (0, 1)

    copy = received.parent / "copy"
    shutil.copytree(received, copy)
    executed(received)
    assert called("run", copy / "scenario.toml", *words[1:], "third")[0] == 2
    assert called("allow", "--forget", received)[0] == 0
    assert called("allow", "--list")[1] == ""
    assert called("run", *words, "third")[0] == 2
    assert executed(received) == 0


@pytest.mark.processes
def test_a_compiled_copy_is_not_looked_at(received):
    """Of the same name, time and length as what was allowed, and other code."""
    law = received / "laws.py"
    hostile = received.parent / "hostile.py"
    bait = received.parent / "bait"
    hostile.write_text(f"open({str(bait)!r}, 'w')\nclass MyLaw: pass\n")
    compiled = Path(importlib.util.cache_from_source(str(law)))
    py_compile.compile(str(hostile), cfile=str(compiled), dfile=str(law), doraise=True)
    content = bytearray(compiled.read_bytes())
    found = law.stat()
    content[8:12] = int(found.st_mtime).to_bytes(4, "little")
    content[12:16] = found.st_size.to_bytes(4, "little")
    compiled.write_bytes(content)

    spec = importlib.util.spec_from_file_location("laws", law)
    spec.loader.exec_module(importlib.util.module_from_spec(spec))
    assert bait.exists(), "Python itself takes the bait, or this shows nothing"
    bait.unlink()
    executed(received)

    words = [received / "scenario.toml", "--allow-code", "--inline", *SHORT, *QUIET]
    assert called("run", *words, "--out", "out")[0] in (0, 1)
    assert executed(received) > 0
    assert not bait.exists()


@pytest.mark.processes
def test_what_lies_beside_a_law_is_not_imported(received):
    (received / "helper.py").write_text((received / "laws.py").read_text())
    (received / "laws.py").write_text("import helper\nMyLaw = helper.MyLaw\n")
    code, said = called("check", received / "scenario.toml", "--allow-code", *SHORT)
    assert code == 2
    assert "a law in a file imports only what is installed" in said
    assert executed(received) == 0


def test_a_file_that_changed_since_it_was_read_is_not_executed(received):
    law = LawFile.read(f"{received / 'laws.py'}:MyLaw")
    (received / "laws.py").write_text("class MyLaw: pass\n")
    with pytest.raises(UnknownLaw, match="has changed since the run began"):
        LawFile.read(law.argument, law.sha256)


@pytest.mark.parametrize("fault", ["file", "folder", "link", "owner", "nonsense", "deep"])
def test_a_list_that_others_could_have_written_is_not_trusted(received, fault):
    called("allow", received)
    listed = allowed.place()
    match fault:
        case "file":
            listed.chmod(0o662)
        case "folder":
            listed.parent.chmod(0o777)
        case "link":
            listed.rename(listed.with_name("other"))
            listed.symlink_to("other")
        case "owner":
            if os.getuid() != 0:
                pytest.skip("only root can give a file away")
            os.chown(listed, 65534, -1)
        case "nonsense":
            listed.write_text('{"a": 1}')
        case "deep":
            listed.write_text("[" * 200_000)
    for words in (["check", received / "scenario.toml", *SHORT], ["allow", received]):
        code, said = called(*words)
        assert code == 2
        assert str(listed.parent) in said, said
    assert executed(received) == 0


@pytest.mark.processes
def test_a_law_in_a_file_has_the_same_bits_in_every_engine_and_verify_names_what_changed(received):
    law = received / "laws.py"
    (received / "scenario.toml").write_text((CONFIGS / "yard.toml").read_text())
    words = ["run", received / "scenario.toml", "--law", f"{law}:MyLaw", *SHORT, *QUIET]
    assert called(*words, "--inline", "--out", "inline")[0] in (0, 1)
    assert called(*words, "--out", "distributed")[0] in (0, 1)
    first, second = verdict(Path("inline")), verdict(Path("distributed"))
    assert first["trajectory_sha256"] == second["trajectory_sha256"]
    digest = LawFile.read(f"{law}:MyLaw").sha256
    assert first["code"] == second["code"] == {"laws.py": digest}

    executed(received)
    code, said = called("verify", "inline")
    assert (code, "--law FILE:NAME names it" in said) == (2, True)
    assert executed(received) == 0
    for engine in ([], ["--distributed"]):
        code, said = called("verify", "inline", "--law", f"{law}:MyLaw", *engine)
        assert (code, "identical" in said) == (0, True), said
        assert "is not what was executed then" not in said
    law.write_text(law.read_text().replace("0.01", "0.02"))
    code, said = called("verify", "inline", "--law", f"{law}:MyLaw")
    assert code == 1
    assert f"laws.py is not what was executed then: its SHA-256 was {digest}" in said


@pytest.mark.processes
def test_a_law_in_a_file_goes_to_no_other_machine(received):
    hosts = received / "hosts.toml"
    hosts.write_text(
        'listen = "tcp/127.0.0.1:7447"\n[[hosts]]\nname = "far"\nssh = "far"\nrobots = [1]\n'
    )
    words = [received / "scenario.toml", "--allow-code", "--hosts", hosts, *SHORT, *QUIET]
    code, said = called("run", *words, "--set", "run.patience_s=10", "--out", "out")
    assert code == 2
    assert "install the law as a package there" in said, said
    assert not Path("out").exists()
