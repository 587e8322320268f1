"""What the shell completes for an argument; :mod:`click.shell_completion` does the rest."""

from pathlib import Path

import click
from click.shell_completion import CompletionItem


def toml_files(
    context: click.Context, parameter: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    """TOML files, the folders on the way to them, and packaged scenarios."""
    from formnet.lab.scenarios.packaged import packaged

    folder, _, start = incomplete.rpartition("/")
    place = f"{folder}/" if "/" in incomplete else ""
    try:
        found = sorted(Path(place or ".").iterdir())
    except OSError:
        return []
    ours = [name for name in packaged() if name.startswith(incomplete)]
    shown = [
        path
        for path in found
        if path.name.startswith(start) and (start or not path.name.startswith("."))
    ]
    files = [path for path in shown if path.suffix == ".toml" and path.is_file()]
    if not files and not ours:  # the shell completes folders better itself: without a space behind
        return [CompletionItem(incomplete, type="dir")]
    folders = [path for path in shown if path.is_dir()]
    names = [path.name for path in files] + [f"{path.name}/" for path in folders]
    return [CompletionItem(name) for name in [*(place + name for name in names), *ours]]


def run_folders(
    context: click.Context, parameter: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    """Folders; the shell finds them itself."""
    return [CompletionItem(incomplete, type="dir")]
