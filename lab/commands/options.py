"""What several commands share: kinds of values, arguments, options, and how a command fails."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from formnet.lab.commands.complete import run_folders, toml_files

if TYPE_CHECKING:
    from formnet.lab.launch.engine import EngineName


class Command(click.Command):
    """A command that, where a scenario's key is given as an option, points to ``--set``."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            if error.possibilities or all(p.name != "overrides" for p in self.params):
                raise
            hint = "What stands in a scenario is set by --set, e.g. --set clock.mode=realtime."
            raise click.NoSuchOption(
                error.option_name, f"{error.message} {hint}", ctx=error.ctx
            ) from None


class Whole(click.IntRange):
    """A whole number within bounds; errors call it that."""

    name = "whole number"


class Number(click.FloatRange):
    """A number within bounds; errors call it that."""

    name = "number"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number: float = super().convert(value, param, ctx)
        if number != number:  # no bound keeps nan out
            self.fail(f"{value!r} is not a valid {self.name}.", param, ctx)
        return number


def scenario_file(_: click.Context, __: click.Parameter, argument: str) -> Path:
    """The file that a SCENARIO argument means, as a callback of click.

    Raises:
        click.BadParameter: it means none.
    """
    from formnet.lab.scenarios.packaged import find

    try:
        return find(argument)
    except LookupError as error:
        raise click.BadParameter(str(error)) from None


SCENARIO = click.argument(
    "scenario", callback=scenario_file, metavar="SCENARIO", shell_complete=toml_files
)
RUNS = click.argument(
    "folders",
    nargs=-1,
    required=True,
    metavar="RUN...",
    type=click.Path(path_type=Path),
    shell_complete=run_folders,
)
FOLDER = click.argument(
    "folder", metavar="RUN", type=click.Path(path_type=Path), shell_complete=run_folders
)
INLINE_RUNS = click.option(
    "--inline",
    "engine",
    flag_value="inline",
    default="distributed",
    help="Every run in one process, as many at once as cores.",
)
JOBS = click.option(
    "--jobs", type=Whole(1), help="Inline runs at once  [default: one for each core]"
)
OVERRIDE = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY.PATH=VALUE",
    help="Override a value of the scenario, e.g. law.beta=5 or robots.3.damping=1. Repeatable.",
)
RUN_ID = click.option(
    "--run", "run_name", required=True, metavar="ID", help="The run to take part in."
)
KEYS = click.option(
    "--keys",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Speak TLS, with the certificates in DIR (`formnet keys init` makes them).",
)
PLAINTEXT = click.option(
    "--plaintext", is_flag=True, help="Off loopback without TLS: only on a network that you trust."
)
LONGEST_LEASE_S = 3600.0
LEASE = click.option(
    "--lease",
    "lease_s",
    type=Number(0.1, LONGEST_LEASE_S),
    default=LONGEST_LEASE_S,
    show_default=True,
    metavar="SECONDS",
    help="The other end takes this one for gone once it has said nothing for so long.",
)
LEASH = click.option(
    "--leash", is_flag=True, help="End when standard input ends (the launcher's way to stop)."
)
VIEW = click.option("--view", is_flag=True, help="Watch it in a window (Rerun).")
WEB = click.option(
    "--web", is_flag=True, help="Watch it in a browser; the address is on this machine alone."
)


def viewer(*, view: bool, web: bool) -> str | None:
    """What ``--view`` and ``--web`` ask for: ``"window"``, ``"web"`` or None.

    Raises:
        click.UsageError: both.
    """
    if view and web:
        raise click.UsageError("--view and --web exclude each other")
    return "web" if web else "window" if view else None


def need_inline(jobs: int | None, engine: "EngineName") -> None:
    """Refuse ``--jobs`` without ``--inline``.

    Raises:
        click.UsageError: so it was.
    """
    if jobs is not None and engine != "inline":
        raise click.UsageError("--jobs goes with --inline: a distributed run has all cores")


def fail(code: int, text: str) -> NoReturn:
    """End the command with an exit code (:mod:`lab.runs.exits`), ``text`` on standard error."""
    click.echo(text, err=True)
    sys.exit(code)
