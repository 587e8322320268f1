"""The command ``formnet``; :mod:`formnet.lab.runs.exits` has its exit codes.

A command's module (``lab/commands/<folder>/<name>.py``) is imported when the command is called,
asked for its help or completed: ``--help`` shows the first line of its text, at once.
"""

import gc
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from formnet.lab.runs.build import remedy, stale
from formnet.lab.runs.exits import BAD_INPUT

_FOLDER = Path(__file__).with_name("commands")
_TITLES: dict[tuple[str, str], tuple[str, ...]] = {
    ("A run", "run"): ("run", "check", "new"),
    ("Watch", "watch"): (),
    ("Look back", "look"): ("list", "report", "plot"),
    ("Many runs", "many"): (),
    ("Networks and machines", "machines"): ("netem-bridge", "doctor"),
    ("Editors and shells", "editors"): ("schema",),
    ("Started by formnet run", "processes"): ("plant",),
}
"""By title and folder of each section: the commands that come first; others follow by name."""


def _lines(folder: str, first: tuple[str, ...]) -> dict[str, str]:
    """The commands of a folder and their first lines of help: those of their modules' texts."""
    found = {}
    for file in sorted((_FOLDER / folder).glob("[!_]*.py")):
        with file.open(encoding="utf-8") as text:
            found[file.stem.replace("_", "-")] = text.readline().strip().strip('"')
    names = sorted(found, key=lambda name: first.index(name) if name in first else len(first))
    return {name: found[name] for name in names}


SECTIONS = {place: _lines(place[1], first) for place, first in _TITLES.items()}
"""What --help shows: by title and folder of each section, its commands and their first lines."""


COLLECT_AFTER = (100_000, 20, 20)
"""Thresholds of the garbage collector in commands about runs: a run has tens of thousands of
records, none of them in a cycle, and with Python's own thresholds a sixth of the time went into
looking at them. Robots and plant keep those, for theirs must never take long."""


def load(name: str) -> click.Command:
    """The command called ``name``, its module imported.

    Raises:
        KeyError: there is none.
    """
    folders = {name: folder for (_, folder), commands in SECTIONS.items() for name in commands}
    module = f"formnet.lab.commands.{folders[name]}.{name.replace('-', '_')}"
    command: click.Command = import_module(module).command
    return command


class Lacking(click.ClickException):
    """A package that a command needs is not installed; the text says what installs it."""

    exit_code = BAD_INPUT


class _Commands(click.Group):
    """Its ``commands`` are names and first lines alone, until one of them is resolved."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except ModuleNotFoundError as error:
            needed = remedy(error)
            if needed is None:
                raise
            raise Lacking(f"formnet {ctx.invoked_subcommand}: {needed}") from None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name, listed, rest = super().resolve_command(ctx, args)
        if name is None or listed is None:  # only while the shell completes
            return name, None, rest
        if name not in SECTIONS["Started by formnet run", "processes"]:
            gc.set_threshold(*COLLECT_AFTER)
        problem = None if ctx.resilient_parsing else stale()
        if problem is not None:  # what is compiled is imported with the command
            raise click.UsageError(problem, ctx)
        return name, load(name), rest

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        column = max(map(len, self.commands))
        for (title, _), commands in SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(column), line) for name, line in commands.items()])


@click.group(
    cls=_Commands,
    commands=[
        click.Command(name, help=line)
        for commands in SECTIONS.values()
        for name, line in commands.items()
    ],
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(package_name="formnet", message="formnet %(version)s")
def main() -> None:
    """Formation control over imperfect networks: run it, break it, get a verdict."""
