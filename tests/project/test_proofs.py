"""Results of proofs that are committed are well-formed; a proof of a changed tree is refused."""

import json
import subprocess

import pytest
from proofs.prove import PROOFS, Asked, broken_messages, nemesis
from proofs.result import Result, clean_tree
from pydantic import ValidationError

RESULT = Result(
    proof="fuzz",
    tree="0" * 40,
    seed=7,
    counts={"messages": 10},
    failures=[],
    hashes={},
    versions={"python": "3.11.0"},
    cores=2,
    wall_s=1.5,
)


def test_committed_results_are_well_formed_and_of_proofs_that_hold(root):
    for file in (root / "docs" / "proofs").glob("*.json"):
        result = Result.model_validate_json(file.read_text(encoding="utf-8"))
        assert result.proof == file.stem
        assert result.proof in PROOFS
        assert result.failures == []
        assert result.counts


@pytest.mark.parametrize(
    ("key", "value"),
    [("tree", "HEAD"), ("seed", -1), ("hashes", {"a": "b"}), ("wall_s", 0), ("more", 1)],
)
def test_a_result_that_is_not_well_formed_is_refused(tmp_path, key, value):
    text = RESULT.write(tmp_path).read_text(encoding="utf-8")
    assert Result.model_validate_json(text) == RESULT
    with pytest.raises(ValidationError, match=key):
        Result.model_validate_json(json.dumps(json.loads(text) | {key: value}))


@pytest.mark.processes
def test_a_tree_that_is_not_what_was_committed_is_refused(tmp_path):
    def git(*words):
        who = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
        subprocess.run(["git", *who, *words], cwd=tmp_path, check=True, capture_output=True)

    git("init")
    (tmp_path / "file").write_text("one")
    git("add", "file")
    git("commit", "-m", "one")
    assert len(clean_tree(tmp_path)) == 40
    RESULT.write(tmp_path / "docs" / "proofs")  # of the proof before
    assert len(clean_tree(tmp_path)) == 40
    (tmp_path / "file").write_text("two")
    with pytest.raises(ValueError, match="commit first:\n M file"):
        clean_tree(tmp_path)


def test_fuzzing_counts_what_it_did():
    found = broken_messages(Asked(seed=1, schedules=0, messages=50, duration_s=0.0), bool)
    assert found.failures == []
    assert found.counts["lockstep: messages"] == 50
    assert 0 < found.counts["lockstep: refused"] <= 50


@pytest.mark.processes
def test_a_schedule_that_does_not_recover_is_a_failure():
    """Two seconds are too short to form up; the hash is over both trajectories."""
    found = nemesis(Asked(seed=1, schedules=1, messages=0, duration_s=2.0), bool)
    assert found.counts["distributed and inline"] == 1
    assert any("seed 1: does not converge" in text for text in found.failures)
    assert len(found.hashes["all trajectories"]) == 64
