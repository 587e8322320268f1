"""Imports point one way between packages and between their rooms; nothing is circular or too big.

``python tests/project/test_layers.py`` prints what is measured here.
"""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from formnet.lab.runs.build import EXTRAS

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("exact", "netem", "formation", "agent", "plant", "lab")
MOST_LINES = 400
MOST_FILES = 12
LONGER = "It is longer than"
"""How the docstring of a module beyond MOST_LINES begins the sentence that says why."""

PACKAGES_BELOW: dict[str, set[str]] = {
    "exact": set(),
    "netem": {"exact"},
    "formation": {"exact", "netem"},
    "agent": {"exact", "netem", "formation"},
    "plant": {"exact", "netem", "formation"},
    "lab": {"exact", "netem", "formation", "agent", "plant"},
}
BELOW: dict[str, set[str]] = {
    "exact": set(),
    "netem.core": set(),
    "netem.delays": {"netem.core"},
    "netem.impairments": {"netem.core", "netem.files"},
    "netem.files": set(),
    "netem.settings": {"netem.core", "netem.delays", "netem.impairments", "netem.files"},
    "netem.bridge": {"netem.core", "netem.files", "netem.settings"},
    "netem": {"netem.core", "netem.delays", "netem.impairments", "netem.settings"},
    "formation.records": set(),
    "formation.machines": {"formation.plan"},
    "formation.wire": {"formation.records", "formation.machines"},
    "formation.plan": set(),
    "formation.scenario": {
        "formation.formats",
        "formation.machines",
        "formation.wire",
        "formation.plan",
    },
    "formation.paper": {"formation.scenario"},
    "formation.formats": set(),
    "formation.briefing": {"formation.wire", "formation.plan", "formation.scenario"},
    "formation": set(),
    "agent": set(),
    "plant": set(),
    "lab.runs": set(),
    "lab.judge": {"lab.runs"},
    "lab.launch": {"lab.runs"},
    "lab.machines": {"lab.runs", "lab.launch"},
    "lab.code": {"lab.runs"},
    "lab.forecast": {"lab.code", "lab.launch"},
    "lab.verdict": {"lab.runs", "lab.judge"},
    "lab.text": {"lab.runs", "lab.judge", "lab.verdict"},
    "lab.figures": {"lab.runs", "lab.judge"},
    "lab.scene": {"lab.runs", "lab.judge", "lab.verdict", "lab.launch", "lab.figures"},
    "lab.pages": {"lab.runs", "lab.judge", "lab.verdict", "lab.text", "lab.figures"},
    "lab.control": {"lab.runs", "lab.pages"},
    "lab.watch": {
        "lab.runs",
        "lab.judge",
        "lab.verdict",
        "lab.launch",
        "lab.machines",
        "lab.scene",
    },
    "lab.schemas": {"lab.runs", "lab.verdict"},
    "lab.scenarios": {"lab.runs", "lab.forecast", "lab.schemas"},
    "lab.claims": {
        "lab.runs",
        "lab.judge",
        "lab.verdict",
        "lab.figures",
        "lab.launch",
        "lab.scenarios",
    },
    "lab.nemesis": {"lab.runs", "lab.verdict", "lab.launch"},
}
"""Which rooms of its own package a room may import."""
COMMANDS = ("", ".run", ".watch", ".look", ".many", ".machines", ".editors", ".processes")
OPEN = {"lab", "lab.work", *(f"lab.commands{part}" for part in COMMANDS)}
"""Rooms that may import all of their package: the command line, its commands and their work."""


def modules() -> dict[str, Path]:
    """Every module by its name, without ``formnet.``."""
    found = {}
    for package in PACKAGES:
        for file in sorted((ROOT / package).rglob("*.py")):
            parts = file.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return found


def imports(
    file: Path, known: dict[str, Path], *, inside: bool = True
) -> Iterator[tuple[str, int]]:
    """The modules of ours that ``file`` imports, and on which line.

    Without ``inside``, only those that are imported with the module itself: not in a function,
    and not for the type checker alone.
    """
    waiting: list[ast.AST] = [ast.parse(file.read_text(encoding="utf-8"))]
    while waiting:
        node = waiting.pop()
        if not inside and (
            isinstance(node, ast.FunctionDef)
            or (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test))
        ):
            continue
        waiting.extend(ast.iter_child_nodes(node))
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}:{node.lineno}: relative import"
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [
                name if name.removeprefix("formnet.") in known else str(node.module)
                for name in inner
            ]
        for name in names:
            assert name.partition(".")[0] not in PACKAGES, f"{file}:{node.lineno}: {name}"
            if name.startswith("formnet."):
                yield name.removeprefix("formnet."), node.lineno


def room(module: str, known: dict[str, Path]) -> str:
    """The folder in which a module lies."""
    return module if known[module].name == "__init__.py" else module.rpartition(".")[0]


def arrows(known: dict[str, Path]) -> set[tuple[str, str]]:
    """Which room imports which other one."""
    return {
        (room(module, known), room(name, known))
        for module, file in known.items()
        for name, _ in imports(file, known)
    }


def may(source: str, target: str) -> bool:
    """Whether room ``source`` may import from room ``target``."""
    package, other = source.partition(".")[0], target.partition(".")[0]
    if package != other:
        return other in PACKAGES_BELOW[package]
    return source == target or source in OPEN or target in BELOW[source]


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Names of a circle in ``graph``; empty if there is none."""
    done: set[str] = set()

    def seek(name: str, way: list[str]) -> list[str]:
        if name in way:
            return [*way[way.index(name) :], name]
        if name in done:
            return []
        for following in sorted(graph.get(name, ())):
            if found := seek(following, [*way, name]):
                return found
        done.add(name)
        return []

    for name in sorted(graph):
        if found := seek(name, []):
            return found
    return []


KNOWN = modules()


@pytest.mark.parametrize("source", sorted({room(module, KNOWN) for module in KNOWN}))
def test_a_room_imports_only_what_lies_below_it(source):
    here = [module for module in KNOWN if room(module, KNOWN) == source]
    for module in here:
        for name, line in imports(KNOWN[module], KNOWN):
            assert name in KNOWN, f"{KNOWN[module]}:{line}: {name}"
            assert may(source, room(name, KNOWN)), f"{KNOWN[module]}:{line}: {name}"


def test_the_arrows_that_are_allowed_are_needed_and_no_circle():
    there = arrows(KNOWN)
    for source, targets in BELOW.items():
        for target in targets:
            assert (source, target) in there, f"nothing in {source} imports {target}"
    assert circle(BELOW) == []


def test_no_modules_import_each_other():
    graph = {
        module: {name for name, _ in imports(file, KNOWN, inside=False)} - {module}
        for module, file in KNOWN.items()
    }
    assert circle(graph) == []
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"a"}}) == ["a", "b", "c", "a"]


def test_nothing_imports_commands_but_the_command_line_and_only_they_import_their_work():
    for module, file in KNOWN.items():
        if not module.startswith("lab.commands") and module != "lab.cli":
            for name, line in imports(file, KNOWN):
                assert not name.startswith(("lab.commands", "lab.work")), f"{file}:{line}: {name}"


def test_modules_and_folders_have_sizes_to_read():
    for module, file in KNOWN.items():
        lines = len(file.read_text(encoding="utf-8").splitlines())
        docstring = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
        assert lines <= MOST_LINES or LONGER in docstring, f"{module}: {lines} lines"
    folders = {file.parent for file in (*KNOWN.values(), *(ROOT / "tests").rglob("*.py"))}
    for folder in folders:
        files = list(folder.glob("*.py"))
        assert len(files) <= MOST_FILES, f"{folder}: {len(files)} files"


@pytest.mark.processes
def test_robots_and_plant_need_no_package_of_an_extra():
    """One that their modules import even in passing would have to be on every robot."""
    names = [
        f"formnet.{module}"
        for module in KNOWN
        if module.partition(".")[0] in ("agent", "plant", "exact", "netem", "formation")
        and module != "exact.arrays"  # for plug-ins that use NumPy
        and not module.startswith("formation.paper")
    ]
    names += ["formnet.lab.cli", "formnet.lab.machines.probe"]
    names += [f"formnet.lab.commands.processes.{command}" for command in ("agent", "plant")]
    extra = [package for packages in EXTRAS.values() for package in packages]
    code = (
        f"import importlib, sys; sys.modules.update(dict.fromkeys({extra!r}))\n"
        f"for name in {names!r}: importlib.import_module(name)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("folder", ["benchmarks", "examples", "tests"])
def test_nobody_uses_a_bare_name(root, folder):
    for file in sorted((root / folder).rglob("*.py")):
        list(imports(file, KNOWN))  # asserts it


def test_every_folder_at_the_top_has_its_link(root):
    for package in (*PACKAGES, "configs"):
        link = root / "formnet" / package
        assert link.is_symlink()
        assert link.resolve() == root / package


def test_an_exception_s_name_has_one_type_in_a_compiled_function(root):
    """mypyc gives it the type of its first handler, and a later one of another type breaks."""
    setup = (root / "setup.py").read_text(encoding="utf-8")
    hot = re.findall(r'^    "(.*\.py)",$', setup, re.MULTILINE)
    assert len(hot) > 10
    for file in map(root.joinpath, hot):
        for function in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(function, ast.FunctionDef):
                kinds: dict[str, set[str]] = {}
                for node in ast.walk(function):
                    if isinstance(node, ast.ExceptHandler) and node.name:
                        kinds.setdefault(node.name, set()).add(ast.unparse(node.type))
                assert all(len(some) == 1 for some in kinds.values()), (file, function.name, kinds)


if __name__ == "__main__":
    print(f"{len(arrows(KNOWN))} arrows between {len({room(m, KNOWN) for m in KNOWN})} rooms")
    sizes = sorted((len(f.read_text(encoding="utf-8").splitlines()), m) for m, f in KNOWN.items())
    print("largest modules:", ", ".join(f"{name} {lines}" for lines, name in sizes[-5:]))
    files = sorted(
        (len(list(d.glob("*.py"))), d.relative_to(ROOT).as_posix())
        for d in {f.parent for f in KNOWN.values()}
    )
    print("largest folders:", ", ".join(f"{name} {count}" for count, name in files[-5:]))
