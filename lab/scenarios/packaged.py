"""The packaged scenarios, and what a SCENARIO argument means."""

import tomllib
from collections.abc import Iterator
from difflib import get_close_matches
from pathlib import Path

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


def packaged() -> dict[str, Path]:
    """Every scenario that comes along, by name, ascending: ``paper/section5-delay``."""
    return {
        path.relative_to(CONFIGS).with_suffix("").as_posix(): path
        for path in sorted(CONFIGS.rglob("*.toml"))
        if "robots" in tomllib.loads(path.read_text(encoding="utf-8-sig"))  # others are networks
    }


def described() -> Iterator[tuple[str, str]]:
    """Name and description of each of them."""
    for name, path in packaged().items():
        yield name, tomllib.loads(path.read_text(encoding="utf-8-sig")).get("description", "")


def find(argument: str) -> Path:
    """The file that ``argument`` means: one that is there, a packaged scenario, or a run folder's.

    Packaged ones go by their name, with or without its folder: ``section5-delay``.

    Raises:
        LookupError: it is neither; the text names what is near.
    """
    path = Path(argument)
    if path.exists() and not path.is_dir():
        return path
    names = packaged()
    short = {name.rpartition("/")[2]: name for name in names}
    name = short.get(argument, argument)
    if name in names:  # also where a run's folder has that name: ./yard is another word
        return names[name]
    inside = path / "scenario.toml"
    if inside.is_symlink():
        raise LookupError(f"{inside}: it is a symbolic link, which is not followed")
    if inside.is_file():
        return inside
    here = {file.stem: str(file) for file in path.parent.glob("*.toml")}
    near = get_close_matches(path.stem, known := short | here, n=3, cutoff=0.5)
    hint = f"did you mean {', '.join(known[word] for word in near)}? " if near else ""
    what = "a folder without scenario.toml" if path.is_dir() else "no such file"
    raise LookupError(
        f"{argument!r}: {what}, and no packaged scenario has that name; "
        f"{hint}`formnet scenarios` lists them"
    )
