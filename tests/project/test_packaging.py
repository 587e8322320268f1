"""What an install holds: scenarios by name, types, a licence; and what ``--help`` does not load."""

import shutil
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path
from zipfile import ZipFile

import pytest
import yaml
from base_install import PARTS, base, built, copied, environment
from click.testing import CliRunner

from formnet.formation.scenario.loading import load
from formnet.lab.cli import main
from formnet.lab.runs.build import EXTRAS
from formnet.lab.scenarios.packaged import CONFIGS, find, packaged


def formnet(*arguments):
    return CliRunner().invoke(main, list(map(str, arguments)))


def test_every_packaged_scenario_is_listed_and_loads():
    listed = formnet("scenarios").output
    assert len(packaged()) >= 12
    for name, path in packaged().items():
        assert f"{name} " in listed
        assert load(path).description in listed
    assert "wifi" not in listed  # a network file is no scenario


@pytest.mark.parametrize("argument", ["paper/section5-delay", "section5-delay"])
def test_a_scenario_goes_by_its_name(argument, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find(argument) == CONFIGS / "paper" / "section5-delay.toml"


def test_names_without_their_folder_are_unique():
    names = [name.rpartition("/")[2] for name in packaged()]
    assert len(set(names)) == len(names)


def test_a_file_comes_before_a_packaged_scenario_and_a_folder_does_not(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("yard").mkdir()
    assert find("yard") == CONFIGS / "yard.toml"
    Path("yard").rmdir()
    Path("yard").touch()
    assert find("yard") == Path("yard")
    Path("yard").unlink()
    Path("yard").mkdir()
    Path("yard", "scenario.toml").touch()  # a run's folder: ./yard
    assert find("yard") == CONFIGS / "yard.toml"
    assert find("./yard") == Path("yard/scenario.toml")


@pytest.mark.parametrize("command", ["run", "check", "nemesis"])
def test_an_unknown_scenario_is_told_what_is_near(command):
    told = formnet(command, "sectoin5-delay.toml")
    assert told.exit_code == 2
    assert "did you mean paper/section5-delay" in " ".join(told.output.split())


def test_the_doctor_needs_no_extra_for_this_machine(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "asyncssh", None)
    monkeypatch.delitem(sys.modules, "formnet.lab.machines.hosts", raising=False)
    assert formnet("doctor").exit_code == 0
    hosts = tmp_path / "hosts.toml"
    hosts.write_text(
        'listen = "tcp/127.0.0.1:7447"\n[[hosts]]\nname = "a"\nssh = "a"\nrobots = [1]\n'
    )
    told = formnet("doctor", "--hosts", hosts)
    assert told.exit_code == 3
    assert "pip install 'formnet[hosts]'" in told.output


def test_the_doctor_works_with_the_base_install(monkeypatch):
    for package in EXTRAS["lab"]:
        monkeypatch.setitem(sys.modules, package, None)
    found = formnet("doctor")
    assert found.exit_code == 0
    assert "extra lab: not installed" in found.output
    assert "pip install 'formnet[lab]'" in found.output


USES = {
    "jinja2": "report",
    "matplotlib": "plot",
    "networkx": "new",
    "numpy": "plot",
    "pyarrow": "plot",
    "rerun": "replay",
    "rich": "plot",
    "tomlkit": "migrate",
    "tornado": "netem-bridge --from tcp/127.0.0.1:1 --to tcp/127.0.0.1:1 --network",
}
"""A command that cannot do without the package."""


def test_every_package_of_the_lab_is_one_that_a_command_may_lack():
    assert set(USES) == set(EXTRAS["lab"])


@pytest.mark.processes
@pytest.mark.parametrize(("package", "command"), USES.items())
def test_a_command_that_lacks_a_package_says_what_installs_it(package, command, tmp_path):
    code = (
        f"import sys; sys.modules[{package!r}] = None\nfrom formnet.lab.program import main\nmain()"
    )
    told = subprocess.run(
        [sys.executable, "-c", code, *command.split(), "x"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert told.returncode == 2
    (line,) = told.stderr.splitlines()
    assert f"formnet {command.split()[0]}: the package {package} is missing: " in line
    assert "pip install 'formnet[lab]'" in line


@pytest.mark.processes
def test_help_loads_nothing_heavy():
    code = (
        "import sys\nfrom formnet.lab.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
        "print(*sys.modules, file=sys.stderr)"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stderr.split()
    assert "click" in loaded
    heavy = {
        "asyncssh",
        "cryptography",
        "jinja2",
        "matplotlib",
        "mcap",
        "networkx",
        "numpy",
        "pyarrow",
        "pydantic",
        "rerun",
        "rich",
        "zenoh",
    }
    assert heavy.isdisjoint(loaded)


@pytest.fixture(scope="module")
def wheel(root, tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    copied(root, folder / "source")
    return built(folder / "source", folder / "wheels")


@pytest.fixture(scope="module")
def base_install(wheel, tmp_path_factory):
    """Interpreter and folder of packages of an environment with the base install alone."""
    return base(wheel, tmp_path_factory.mktemp("base") / "venv")


@pytest.mark.processes
def test_the_base_install_is_small(base_install):
    _, packages = base_install
    told = subprocess.check_output(["du", "-sm", packages], text=True)
    assert int(told.split()[0]) <= 70


@pytest.mark.processes
def test_the_base_install_has_what_robots_and_plant_need(base_install, tmp_path):
    python, packages = base_install
    rooms = [f"formnet.{part}" for part in ("agent", "plant", "exact", "netem", "formation")]
    code = f"""
import importlib, pkgutil, sys
import formnet, formnet.lab.machines.probe, formnet.lab.cli as cli
for room in {rooms!r}:
    for found in pkgutil.walk_packages(importlib.import_module(room).__path__, room + "."):
        if not found.name.startswith(("formnet.formation.paper", "formnet.exact.arrays")):
            importlib.import_module(found.name)
for command in ("agent", "plant"):
    cli.load(command)
print(formnet.__file__)
try: import agent
except ModuleNotFoundError: print("no agent")
"""
    told = subprocess.check_output([python, "-c", code], text=True, cwd=tmp_path).splitlines()
    assert told == [str(packages / "formnet" / "__init__.py"), "no agent"]


@pytest.mark.processes
@pytest.mark.parametrize(
    "words", [("run", "section5-delay", "--inline"), ("check", "yard"), ("list",)]
)
def test_the_base_install_says_what_brings_the_rest(base_install, tmp_path, words):
    python, _ = base_install
    told = subprocess.run(
        [python, "-m", "formnet", *words], capture_output=True, text=True, cwd=tmp_path
    )
    assert told.returncode == 2
    (line,) = told.stderr.splitlines()
    assert "pip install 'formnet[lab]'" in line


@pytest.mark.processes
def test_a_law_of_the_user_s_is_checked_against_the_base_install(base_install, root, tmp_path):
    python, _ = base_install
    law = tmp_path / "law.py"
    shutil.copy(root / "examples" / "own_law" / "saturated.py", law)
    checker = [sys.executable, "-m", "mypy", "--strict", "--python-executable", python]
    right = subprocess.run([*checker, law], cwd=tmp_path, capture_output=True, text=True)
    assert right.returncode == 0, right.stdout
    law.write_text(law.read_text().replace("situation.offsets_m", "situation.no_such_thing"))
    wrong = subprocess.run([*checker, law], cwd=tmp_path, capture_output=True, text=True)
    assert '"Situation" has no attribute "no_such_thing"' in wrong.stdout


@pytest.mark.processes
def test_a_wheel_of_an_sdist_has_the_same_files(root, tmp_path):
    copied(root, tmp_path / "source")
    sdist = built(tmp_path / "source", tmp_path / "sdist", "sdist")
    shutil.unpack_archive(sdist, tmp_path / "unpacked", filter="data")
    (folder,) = (tmp_path / "unpacked").iterdir()
    assert not [path for path in folder.rglob("*") if path.is_symlink()]
    wheels = [
        built(where, tmp_path / name) for where, name in ((tmp_path / "source", "a"), (folder, "b"))
    ]
    names = [
        {name for name in ZipFile(wheel).namelist() if "dist-info" not in name} for wheel in wheels
    ]
    assert names[0] == names[1]
    assert {name.partition("/")[0] for name in names[0]} == {"formnet"}
    assert {
        f"formnet/{file.relative_to(root).as_posix()}"
        for part in PARTS
        for kind in ("py", "toml", "j2", "css", "js")
        for file in (root / part).rglob(f"*.{kind}")
    } < names[0]


@pytest.mark.processes
def test_a_checkout_without_links_is_told_what_to_do(root, tmp_path):
    copied(root, tmp_path)
    (tmp_path / "formnet" / "agent").unlink()
    (tmp_path / "formnet" / "agent").write_text("../agent")
    told = subprocess.run(
        [sys.executable, "setup.py", "--version"], cwd=tmp_path, text=True, capture_output=True
    )
    assert told.returncode == 1
    assert "formnet/agent is a text file where a symbolic link should be" in told.stderr


@pytest.mark.processes
def test_a_wheel_runs_outside_the_checkout(wheel, tmp_path):
    home = tmp_path / "venv"
    _, packages = environment(wheel, home)
    assert (packages / "formnet" / "py.typed").exists()
    assert all((packages / "formnet" / part).is_dir() for part in PARTS)
    assert not any((packages / part).exists() for part in PARTS)
    # What formnet needs is that of this environment; formnet itself is not.
    (packages / "needs.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")
    empty = tmp_path / "empty"
    empty.mkdir()
    command = [home / "bin" / "formnet", "run", "section5-delay", "--inline", "--out", "mine"]
    overrides = (
        "--set",
        "duration_s=0.2",
        "--set",
        "expect.centroid=false",
        "--set",
        "expect.formation=false",
        "--set",
        "expect.heading=false",
    )
    ran = subprocess.run([*command, *overrides], cwd=empty, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert (empty / "mine" / "states.parquet").exists()
    laws = subprocess.check_output([home / "bin" / "formnet", "laws"], cwd=empty, text=True)
    assert "cooperative" in laws


def test_versions_and_the_paper_agree(root):
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((root / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == project["version"]
    assert citation["license"] == project["license"]
    (paper,) = citation["references"]
    assert paper["title"] in (root / "README.md").read_text(encoding="utf-8")
    changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## [{project['version']}]" in changelog
