"""Run folders from strangers, the short form of ``make prove PROVE=folders``."""

import pytest
from proofs.folders import COMMANDS, fuzz_folders

FOLDERS, SEED = 60, 2026


@pytest.mark.processes
@pytest.mark.long
def test_mutated_folders_do_no_harm():
    print(f"seed {SEED}")
    commands = tuple(name for name in COMMANDS if name != "plot")  # which draws for a second each
    found = fuzz_folders(FOLDERS, SEED, commands=commands)
    assert found.failures == []
    assert found.calls == dict.fromkeys(commands, FOLDERS)


@pytest.mark.processes
def test_a_command_that_does_harm_is_told(monkeypatch):
    """Else the test above could not fail."""

    def harm(run, good):
        (run.parents[1] / "outside" / "secret").write_text("changed")
        print((good / ".." / "outside" / "secret").read_text())
        raise RuntimeError("a traceback")

    monkeypatch.setitem(COMMANDS, "list", harm)
    failures = "\n".join(fuzz_folders(1, SEED, commands=("list",)).failures)
    for words in ("list ended with 99", "a traceback", "outside was changed", "what lies outside"):
        assert words in failures
