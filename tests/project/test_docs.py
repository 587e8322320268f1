"""The documentation: the site builds strictly and works offline, and what it says is so."""

import ast
import os
import re
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PACKAGES = ("agent", "exact", "formation", "lab", "netem", "plant")


@pytest.mark.processes
def test_the_site_builds_strictly_and_loads_nothing_from_elsewhere(tmp_path):
    subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", tmp_path],
        cwd=ROOT,
        check=True,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
    )
    pages = list(tmp_path.rglob("*.html"))
    assert len(pages) > 20
    for page in pages:
        loaded = re.findall(r"<(?:script|link|img|iframe)\b[^>]*", page.read_text(encoding="utf-8"))
        assert loaded
        assert not [
            tag for tag in loaded if re.search(r"""(?:src|href)=["']?(?:https?:)?//""", tag)
        ]
    for sheet in tmp_path.rglob("*.css"):
        text = sheet.read_text(encoding="utf-8")
        assert not re.search(r"""(?:@import|url\()\s*["']?https?:""", text)
    assert (tmp_path / "configs" / "paper" / "section5-delay.toml").exists()


def test_links_between_files_work_where_the_files_are():
    """On a code host, that is; in the site, the strict build checks them."""
    pages = [ROOT / "README.md", ROOT / "CHANGELOG.md", *DOCS.glob("*.md")]
    pages += (ROOT / "examples").rglob("*.md")
    targets = [
        (page, target)
        for page in pages
        for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    ]
    assert len(targets) > 50
    gone = [(page.name, to) for page, to in targets if not (page.parent / to).exists()]
    assert not gone


# --- troubleshooting ------------------------------------------------------------------------


def said(node: ast.AST) -> str:
    """The text of a literal, ``…`` where something is put in."""
    if isinstance(node, ast.JoinedStr):
        return "".join(map(said, node.values))
    if isinstance(node, ast.Constant):
        return str(node.value)
    return "…"


def texts() -> set[str]:
    """Every text in the source, as :func:`said`; templates for ``format`` likewise."""
    found = set()
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.JoinedStr | ast.Constant):
                    found.add(re.sub(r"\{[^}]*\}", "…", said(node)))
    return found


def messages() -> list[str]:
    """The first column of every table of the page."""
    text = (DOCS / "troubleshooting.md").read_text(encoding="utf-8")
    return re.findall(r"^\| `(.*?)` \|", text, flags=re.MULTILINE)


def test_every_message_of_the_troubleshooting_page_is_one_that_formnet_says():
    sources, listed = texts(), messages()
    assert len(listed) >= 25
    assert len(set(listed)) == len(listed)
    # `a, …` at an end stands for whatever follows, `…` within for one thing put in.
    unsaid = [m for m in listed if not any(m.strip("…").strip() in text for text in sources)]
    assert not unsaid


# --- the tutorial ---------------------------------------------------------------------------


class Block(NamedTuple):
    """A fenced block: its language, its title (or ""), its content."""

    language: str
    title: str
    content: str


def blocks(page: str) -> list[Block]:
    """The fenced blocks of a page, in order."""
    text = (DOCS / page).read_text(encoding="utf-8")
    found = re.findall(r'^```(\w+)(?: title="([^"\n]*)")?\n(.*?)^```$', text, flags=re.M | re.S)
    return [Block(*parts) for parts in found]


@pytest.fixture
def user(tmp_path):
    """The environment of somebody with formnet installed, and a venv of their own on PATH.

    What is installed there does not show here; what is installed here shows there.
    """
    home = tmp_path / "venv"
    venv.create(home)
    python = home / "bin" / "python"
    packages = subprocess.check_output(
        [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"], text=True
    ).strip()
    here = sysconfig.get_path("purelib")
    Path(packages, "here.pth").write_text(f"import site; site.addsitedir({here!r})\n", "utf-8")
    for name, module in [("formnet", "formnet"), ("pip", "pip")]:
        script = home / "bin" / name
        script.write_text(f'#!/bin/sh\nexec {python} -m {module} "$@"\n', encoding="utf-8")
        script.chmod(0o755)
    offline = {"PIP_NO_INDEX": "1", "PIP_NO_BUILD_ISOLATION": "0", "PIP_NO_DEPS": "1"}
    return {**os.environ, **offline, "PATH": f"{home / 'bin'}:{os.environ['PATH']}"}


@pytest.mark.processes
def test_every_command_of_the_tutorial_works(user, tmp_path):
    place = tmp_path / "work"
    place.mkdir()
    done = 0
    for block in blocks("tutorial.md"):
        if block.title:
            name, _, append = block.title.partition(" ")
            file = place / name
            file.parent.mkdir(exist_ok=True)
            assert file.exists() == bool(append)
            with file.open("a", encoding="utf-8") as stream:
                stream.write(block.content)
        elif block.language == "sh":
            ran = subprocess.run(
                ["bash", "-euxo", "pipefail", "-c", block.content],
                cwd=place,
                env=user,
                text=True,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
            )
            assert ran.returncode == 0, ran.stdout
            done += 1
    assert done >= 9


def test_the_tutorial_ends_with_the_example():
    files = {block.title: block.content for block in blocks("tutorial.md")}
    shown = [name for name in files if name.startswith("own_law/")]
    assert len(shown) == 3
    for name in shown:
        assert files[name] == (ROOT / "examples" / name).read_text(encoding="utf-8")
