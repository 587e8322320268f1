"""Lays the repository flat for the site, so that links work there as they do among the files.

README.md, CHANGELOG.md, configs/ and examples/ stand beside the pages of docs/: a link
``../configs/x`` of a page and a link ``docs/y`` of the README lose their first part. mkdocs
then checks them like all others: a target that is not there fails the strict build.
"""

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
BESIDE = ("README.md", "CHANGELOG.md", "LICENSE", "configs/**/*", "examples/**/*")
MADE = ("__pycache__", ".pytest_cache", "build", "runs")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what stands outside docs/."""
    for pattern in BESIDE:
        for path in sorted(ROOT.glob(pattern)):
            if path.is_file() and not _made(path):
                name = path.relative_to(ROOT).as_posix()
                files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Make links of the repository links of the site."""
    prefix = "docs/" if page.file.generated_by else "../"
    return re.sub(rf"(\]\(){re.escape(prefix)}", r"\1", markdown)


def _made(path: Path) -> bool:
    """Whether something made it that is not in the repository."""
    folders = path.relative_to(ROOT).parent.parts
    return any(folder in MADE or folder.endswith(".egg-info") for folder in folders)
