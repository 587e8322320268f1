"""What several commands share: kinds of values, arguments, options, and how a command fails."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

import click

from formnet.lab.commands.complete import run_folders, toml_files

if TYPE_CHECKING:
    from formnet.lab.launch.engine import EngineName

Decorated = TypeVar("Decorated", bound=Callable[..., Any])


class Command(click.Command):
    """A command that, where a scenario's key is given as an option, points to ``--set``."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            if error.possibilities or all(p.name != "overrides" for p in self.params):
                raise
            hint = "To change a value of the scenario, use --set, e.g. --set clock.mode=realtime."
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
    help="Each run in one process; as many runs in parallel as cores.",
)
JOBS = click.option(
    "--jobs", type=Whole(1), help="Inline runs in parallel  [default: one per core]"
)
OVERRIDE = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY.PATH=VALUE",
    help="Override a value of the scenario, e.g. law.beta=5 or robots.3.damping=1. Repeatable.",
)
LAW = click.option(
    "--law",
    metavar="FILE:NAME",
    help="Use this law, code in a file of Python: laws.py:MyLaw.",
)
ALLOW_CODE = click.option(
    "--allow-code",
    is_flag=True,
    help="Execute the code in files that the scenario names (else only what `formnet allow` has "
    "allowed).",
)
ALLOW_OUTSIDE = click.option(
    "--allow-outside",
    is_flag=True,
    help="Read traces and samples from outside the scenario's folder, too.",
)
NO_LOOKAHEAD = click.option(
    "--no-lookahead",
    is_flag=True,
    help="Do not try the law before: no warning of a control period too long for its gains.",
)
RUN_ID = click.option(
    "--run", "run_name", required=True, metavar="ID", help="Id of the run to join."
)
KEYS = click.option(
    "--keys",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Use TLS with the certificates in DIR (made by `formnet keys init`).",
)
OWN_HOSTS = "scenario"
"""What ``--hosts`` says for the hosts in the scenario itself."""
HOSTS = click.option(
    "--hosts",
    type=click.Path(),
    metavar="HOSTS.toml",
    help="Run robots on other machines over SSH (docs/hosts.md); `scenario` for those in its own "
    "[hosts], which are not used without.",
)
PLAINTEXT = click.option(
    "--plaintext",
    is_flag=True,
    help="Allow addresses off loopback without TLS: only on a network that you trust.",
)
LONGEST_LEASE_S = 3600.0
LEASE = click.option(
    "--lease",
    "lease_s",
    type=Number(0.1, LONGEST_LEASE_S),
    default=LONGEST_LEASE_S,
    show_default=True,
    metavar="SECONDS",
    help="The other end closes the connection after this long without a message.",
)
LEASH = click.option(
    "--leash",
    is_flag=True,
    help="End when standard input closes (this is how the launcher stops it).",
)
VIEW = click.option("--view", is_flag=True, help="Show the run in a window (Rerun).")
WEB = click.option("--web", is_flag=True, help="Show the run in a browser on this machine.")


def out_option(text: str, metavar: str | None = None) -> Callable[[Decorated], Decorated]:
    """``--out``, for a new file or folder; ``text`` is its help."""
    return click.option("--out", type=click.Path(path_type=Path), metavar=metavar, help=text)


def hosts_file(hosts: str | None) -> tuple[Path | None, bool]:
    """What ``--hosts`` names: a file, or the scenario itself."""
    own = hosts == OWN_HOSTS
    return (None if own or hosts is None else Path(hosts)), own


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
        raise click.UsageError("--jobs requires --inline: a distributed run uses all cores")


def fail(code: int, text: str) -> NoReturn:
    """End the command with an exit code (:mod:`lab.runs.exits`), ``text`` on standard error."""
    click.echo(text, err=True)
    sys.exit(code)
