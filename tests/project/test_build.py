"""A build that cannot compile says so; and the lowest versions that pyproject.toml admits."""

import os
import re
import runpy
import subprocess
import sys
import tomllib

import pytest

SMALL = "formnet/small.py"


@pytest.fixture
def source(root, tmp_path):
    """A checkout with one module alone to be compiled: all of them would take minutes."""
    (tmp_path / "formnet").mkdir()
    (tmp_path / "formnet" / "__init__.py").touch()
    (tmp_path / SMALL).write_text("def twice(x: int) -> int:\n    return 2 * x\n")
    setup = (root / "setup.py").read_text(encoding="utf-8")
    hot = f'HOT = ["{SMALL}"]\n'
    setup = re.sub(r"HOT = \[.*?\n\]\n", hot, setup, flags=re.DOTALL)
    assert hot in setup
    (tmp_path / "setup.py").write_text(setup, encoding="utf-8")
    return tmp_path


def build(source, *, ci=False, code="", **environment):
    """``setup.py build_ext``; whether it ended well, and what it said."""
    kept = {k: v for k, v in os.environ.items() if k not in ("FORMNET_CI", "FORMNET_PURE")}
    program = f"import runpy, sys; {code}\nsys.argv[1:] = ['build_ext', '--inplace']\n"
    done = subprocess.run(
        [sys.executable, "-c", f"{program}runpy.run_path('setup.py', run_name='__main__')"],
        cwd=source,
        env=kept | environment | ({"FORMNET_CI": "1"} if ci else {}),
        capture_output=True,
        text=True,
    )
    return done.returncode == 0, done.stderr


def compiler(source, name="cc"):
    """A C compiler that refuses everything."""
    program = source / name
    program.write_text('#!/bin/sh\necho "x.c:7:3: error: no such luck" >&2\nexit 1\n')
    program.chmod(0o755)
    return str(program)


@pytest.mark.processes
@pytest.mark.parametrize("ci", [False, True])
def test_what_mypyc_refuses_is_named_with_a_remedy(source, ci):
    with (source / SMALL).open("a", encoding="utf-8") as file:
        file.write('\nWRONG: int = "text"\n')
    well, said = build(source, ci=ci)
    assert well is not ci
    assert f"{'error' if ci else 'warning'}: formnet: {SMALL} cannot be compiled:" in said
    assert re.search(rf"    {SMALL}:\d+: error: Incompatible types in assignment", said)
    assert "install a C compiler" in said
    assert "FORMNET_PURE=1" in said
    assert "Traceback" not in said


@pytest.mark.processes
@pytest.mark.parametrize("ci", [False, True])
def test_what_the_c_compiler_refuses_is_named_with_a_remedy(source, ci):
    well, said = build(source, ci=ci, CC=compiler(source))
    assert well is not ci
    assert re.search(r"(error|warning): formnet: \S+\.c cannot be compiled:", said)
    assert "    x.c:7:3: error: no such luck" in said
    assert "install a C compiler" in said
    assert "Traceback" not in said
    assert not list(source.rglob("*.so"))


@pytest.mark.processes
@pytest.mark.parametrize("ci", [False, True])
def test_without_mypyc_the_same(source, ci):
    well, said = build(source, ci=ci, code="sys.modules['mypyc'] = None")
    assert well is not ci
    assert "what runs in every tick cannot be compiled:" in said
    assert "mypyc" in said


@pytest.mark.processes
def test_a_build_that_is_to_be_pure_needs_no_compiler_in_ci_either(source):
    well, said = build(source, ci=True, CC=compiler(source), FORMNET_PURE="1")
    assert well, said


@pytest.mark.processes
def test_what_can_be_compiled_is_and_nothing_is_said(source):
    well, said = build(source, ci=True)
    assert well, said
    assert list(source.glob("formnet/small.*.so"))
    assert "cannot be compiled" not in said


def test_every_requirement_has_a_lowest_version(root):
    lowest = runpy.run_path(str(root / ".ci" / "lowest.py"))["lowest"]
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found = dict(line.split("==") for line in lowest(project))
    assert found["numpy"] == "2.0"
    assert found["pydantic"] == "2.11"
    assert {"click", "tornado", "pytest"} <= set(found)
    assert "formnet" not in found
    for bad in ("x", "x==1", "x<2"):
        with pytest.raises(ValueError, match=f"{bad}: must be NAME>=LOWEST"):
            lowest(project | {"dependencies": [bad]})
