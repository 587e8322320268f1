"""What a proof writes down: of which tree, with which seed, how much of what, and what failed."""

import json
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

GitName = Annotated[str, Field(pattern=r"^[0-9a-f]{40}$")]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Count = Annotated[int, Field(ge=0)]


class Result(BaseModel):
    """A file ``docs/proofs/<proof>.json``."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    proof: str
    tree: GitName
    """``git rev-parse HEAD^{tree}`` of the commit that was checked out, with nothing changed."""
    seed: Count
    counts: dict[str, Count]
    failures: list[str]
    hashes: dict[str, Sha256]
    """Of trajectories, by the name of a run; or one over those of all runs, in order."""
    versions: Mapping[str, str]
    cores: Annotated[int, Field(ge=1)]
    wall_s: Annotated[FiniteFloat, Field(gt=0)]

    def write(self, folder: Path) -> Path:
        """Write ``folder/<proof>.json``; raises OSError."""
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / f"{self.proof}.json"
        text = json.dumps(self.model_dump(), indent=2, ensure_ascii=False)
        file.write_text(text + "\n", encoding="utf-8")
        return file


def clean_tree(root: Path) -> str:
    """The hash of the tree that is checked out.

    Raises:
        ValueError: it is not what was committed, results of proofs aside; says which files.
    """

    def git(*words: str) -> str:
        return subprocess.run(
            ["git", *words], cwd=root, check=True, capture_output=True, text=True
        ).stdout.rstrip()

    changed = git("status", "--porcelain", "--", ".", ":!docs/proofs")
    if changed:
        raise ValueError(f"the tree is not what was committed; commit first:\n{changed}")
    return git("rev-parse", "HEAD^{tree}")
