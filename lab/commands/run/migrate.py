"""Bring scenarios to the current format."""

import sys
from pathlib import Path

import click

from formnet.lab.commands.complete import toml_files
from formnet.lab.commands.options import Command


@click.command("migrate", cls=Command)
@click.argument(
    "paths",
    nargs=-1,
    required=True,
    metavar="FILE...",
    type=click.Path(path_type=Path),
    shell_complete=toml_files,
)
def command(paths: tuple[Path, ...]) -> None:
    """Bring scenarios to the current format.

    FILE is a scenario or the folder of a run; comments and layout stay. Older files run as they
    are (they are migrated in memory), so this is for tidiness and for editors. Exit code 0: all
    are of the current format; 2: one is no scenario, or not valid (it is left as it was); 3: one
    cannot be written.
    """
    sys.exit(max(_migrated(path) for path in paths))


def _migrated(path: Path) -> int:
    from formnet.formation.scenario.loading import ScenarioError
    from formnet.lab.runs import files
    from formnet.lab.runs.exits import ALL_HOLD, BAD_INPUT, in_words
    from formnet.lab.runs.exits import of as code_of
    from formnet.lab.scenarios.migrating import migrated

    received = path.is_dir()  # of a run's folder no link is followed
    file = path / "scenario.toml" if received else path
    try:
        text, changes = migrated(file, follow=not received)
        if changes:
            (files.replace if received else files.write_to)(file, text)
    except ScenarioError as error:
        for problem in error.problems:
            click.echo(f"{error.file}: {problem}", err=True)
        return BAD_INPUT
    except OSError as error:
        click.echo(in_words(error), err=True)
        return code_of(error)
    for change in changes or ["is of the current format"]:
        click.echo(f"{file}: {change}")
    return ALL_HOLD
