"""``make prove``: long proofs, each of which writes its result to ``docs/proofs/<name>.json``.

``nemesis``: random failures, every run twice to the same bits, every tenth distributed.
``fuzz``: broken messages at every decoder. ``claims``: every run of the paper's claims, inline.
``folders``: mutated run folders through every command that reads one.
``processors``: the golden bits by other Pythons and processors.
The exit code is 0 if all hold, 1 if one does not, 2 if the tree is not what was committed.
"""

import argparse
import hashlib
import os
import platform
import secrets
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from fuzzing import fuzz
from proofs.folders import fuzz_folders
from proofs.processors import compared
from proofs.result import Result, clean_tree

from formnet.formation.scenario.loading import load
from formnet.lab.claims.catalogue import catalogue
from formnet.lab.claims.work import Work, cost, do
from formnet.lab.launch import pool
from formnet.lab.launch.engine import EngineName
from formnet.lab.launch.signals import stop_signals
from formnet.lab.nemesis.schedule import draw
from formnet.lab.nemesis.trial import Trial, tried
from formnet.lab.scenarios.packaged import CONFIGS

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("formnet", "eclipse-zenoh", "numpy", "scipy", "pyarrow", "pydantic", "msgpack")
EVERY = 10
"""Of the nemesis' schedules, every so many-th is run distributed as well."""
SCENARIOS = ("section5", "section5-delay")
CHAOS_SHARE = 0.25
LIMIT_S = 600.0


class Asked(NamedTuple):
    """How much is to be done, from which seed on."""

    seed: int
    schedules: int
    messages: int
    duration_s: float
    pythons: Sequence[str] = ()
    aarch64: Path | None = None
    folders: int = 0


class Found(NamedTuple):
    """How much was done, what failed (in words), and the hashes of what was run."""

    counts: dict[str, int]
    failures: list[str]
    hashes: dict[str, str]


def nemesis(asked: Asked, stopped: pool.Stopped) -> Found:
    """Random failures: every run ends, is consistent and repeats to the bit, inline or not."""
    trials = []
    for number in range(asked.schedules):
        name = SCENARIOS[number % len(SCENARIOS)]
        changes = [f"duration_s={asked.duration_s}", "timeline=[]"]
        scenario = load(CONFIGS / "paper" / f"{name}.toml", changes)
        seed = asked.seed + number
        episodes = draw(scenario, seed, CHAOS_SHARE * scenario.duration_s)
        engine: EngineName = "inline" if number % EVERY else "distributed"
        trials.append(Trial(scenario, seed, episodes, engine, True, LIMIT_S))
    alone = [trial for trial in trials if trial.engine == "distributed"]
    inline = [trial for trial in trials if trial.engine == "inline"]
    done = chain(pool.in_turn(tried, alone, stopped), pool.at_once(tried, inline, stopped))
    found = {trial.seed: finding for trial, finding in done}
    failures = [f"seed {seed}: {text}" for seed in sorted(found) for text in found[seed].problems]
    counts = {
        "schedules": len(trials),
        "distributed and inline": len(alone),
        "inline twice": len(inline),
        "episodes": sum(len(trial.episodes) for trial in trials),
    }
    return Found(counts, failures, _of_all(found[seed].trajectory_sha256 for seed in sorted(found)))


def broken_messages(asked: Asked, stopped: pool.Stopped) -> Found:
    """Broken messages: no decoder raises anything but a MessageError."""
    found = fuzz(asked.messages, asked.seed)
    counts = {f"{name}: messages": count for name, count in found.tried.items()}
    counts |= {
        f"{name}: refused": count - found.accepted[name] for name, count in found.tried.items()
    }
    return Found(counts, found.raised, {})


def folders(asked: Asked, stopped: pool.Stopped) -> Found:
    """Run folders from strangers: no traceback, bounded time and memory, nothing outside touched."""
    found = fuzz_folders(asked.folders, asked.seed, stopped)
    counts = {f"{name}: calls": count for name, count in found.calls.items()}
    counts |= {
        "folders": asked.folders,
        "most processor time (ms)": round(found.most_cpu_s * 1e3),
        "most memory (MiB)": found.most_resident >> 20,
    }
    return Found(counts, found.failures, {})


def claims(asked: Asked, stopped: pool.Stopped) -> Found:
    """Every run of every claim of the paper ends as is claimed."""
    with TemporaryDirectory() as place:
        work = [
            Work(claim.key, case, Path(place) / claim.key / case.name, "inline")
            for claim in catalogue()
            for case in claim.cases
        ]
        longest_first = sorted(work, key=lambda item: -cost(item.case))
        done = {
            f"{item.claim}/{item.case.name}": result
            for item, result in pool.at_once(do, longest_first, stopped)
        }
    return Found(
        {"claims": len(catalogue()), "runs": len(done)},
        [f"{name}: not as expected" for name in sorted(done) if not done[name].as_expected],
        {name: done[name].verdict.trajectory_sha256 for name in sorted(done)},
    )


def processors(asked: Asked, stopped: pool.Stopped) -> Found:
    """The golden bits by other Pythons, without compiled modules, and by other processors."""
    counts, failures = compared(asked.pythons, asked.aarch64)
    return Found(counts, failures, {})


PROOFS: dict[str, Callable[[Asked, pool.Stopped], Found]] = {
    "nemesis": nemesis,
    "fuzz": broken_messages,
    "folders": folders,
    "claims": claims,
    "processors": processors,
}


def _of_all(hashes: Iterable[str]) -> dict[str, str]:
    return {"all trajectories": hashlib.sha256("\n".join(hashes).encode()).hexdigest()}


def main() -> int:
    """The exit code of what is asked for."""
    try:
        return prove()
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2


def prove() -> int:
    """Do the proofs that are asked for; 0, 1 or 130. Raises ValueError: the tree is a changed one."""
    parser = argparse.ArgumentParser(prog="make prove", description=__doc__)
    parser.add_argument("proofs", nargs="*", metavar="PROOF", help=f"of {', '.join(PROOFS)}")
    parser.add_argument("--seed", type=int, default=secrets.randbits(31), help="a new one")
    parser.add_argument("--schedules", type=int, default=1000)
    parser.add_argument("--messages", type=int, default=1_000_000, help="for each decoder")
    parser.add_argument("--folders", type=int, default=2000)
    parser.add_argument("--duration", type=float, default=40.0, help="seconds of a schedule")
    parser.add_argument("--python", action="append", default=[], help="for processors; may repeat")
    parser.add_argument("--aarch64", type=Path, help="for processors: a root with its Python")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "proofs")
    words = parser.parse_args()
    if unknown := [name for name in words.proofs if name not in PROOFS]:
        parser.error(f"{unknown[0]}: must be one of {', '.join(PROOFS)}")
    if words.seed < 0 or min(words.schedules, words.messages, words.folders) < 1:
        parser.error(
            "--seed must not be negative, --schedules, --messages and --folders must be at least 1"
        )
    asked = Asked(
        words.seed,
        words.schedules,
        words.messages,
        words.duration,
        words.python,
        words.aarch64 and words.aarch64.resolve(),
        words.folders,
    )
    tree = clean_tree(ROOT)
    failed = False
    for name in words.proofs or PROOFS:
        print(f"{name}: seed {asked.seed}, tree {tree}", flush=True)
        began = time.monotonic()
        with stop_signals() as stopped:
            found = PROOFS[name](asked, stopped.is_set)
            if stopped.is_set():
                return 130
        if clean_tree(ROOT) != tree:
            raise ValueError(f"{name}: another tree was checked out meanwhile")
        result = Result(
            proof=name,
            tree=tree,
            seed=asked.seed,
            counts=found.counts,
            failures=found.failures,
            hashes=found.hashes,
            versions={"python": platform.python_version(), "machine": platform.machine()}
            | {package: version(package) for package in PACKAGES},
            cores=os.cpu_count() or 1,
            wall_s=round(time.monotonic() - began, 1),
        )
        print(f"{len(found.failures)} failures in {result.wall_s:g} s: {result.write(words.out)}")
        for failure in found.failures[:5]:
            print(f"  {failure}")
        failed = failed or bool(found.failures)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
