"""Write a commented scenario to start from."""

from pathlib import Path

import click

from formnet.lab.commands.options import Command, Number, Whole, fail, out_option
from formnet.lab.runs.exits import of as code_of


@click.command("new", cls=Command)
@click.argument("name")
@click.option(
    "--robots",
    type=Whole(2, 1000),
    metavar="N",
    help="Number of robots.  [default: 5, or the number of rows in FILE]",
)
@click.option(
    "--pattern",
    default="circle",
    show_default=True,
    metavar="circle|line|wedge|grid|FILE",
    help="Desired positions of the robots; FILE: CSV with x_m,y_m, one row per robot.",
)
@click.option(
    "--graph",
    type=click.Choice(("ring", "path", "complete", "star", "random")),
    default="ring",
    show_default=True,
    help="Communication graph.",
)
@click.option(
    "--network",
    default="ideal",
    show_default=True,
    metavar="PRESET",
    help="Preset: ideal, lan, wifi, wifi-congested, lte, satellite, robot-link.",
)
@click.option(
    "--spacing",
    "spacing_m",
    type=Number(0.01, 1e4),
    metavar="M",
    help="Distance of neighbours in the pattern, in metres; not with FILE  [default: 1.0]",
)
@click.option(
    "--seed",
    type=Whole(0),
    default=1,
    show_default=True,
    help="Seed for starts, random graphs and links.",
)
@out_option("[default: NAME.toml]", metavar="FILE")
@click.option(
    "--mode",
    type=click.Choice(("lockstep", "realtime")),
    default="lockstep",
    show_default=True,
    help="Exactly repeatable virtual time, or real time.",
)
def command(
    name: str,
    robots: int | None,
    pattern: str,
    graph: str,
    network: str,
    spacing_m: float | None,
    seed: int,
    out: Path | None,
    mode: str,
) -> None:
    """Write a commented scenario to start from.

    Writes NAME.toml with gains and periods that suit the pattern, the graph and the number of
    robots, and scenario.schema.json beside it, with which editors complete and check. Files are
    never overwritten.
    """
    from formnet.lab.scenarios.new import CannotWrite, Wish, write

    try:
        path = write(Wish(name, robots, pattern, graph, network, spacing_m, seed, mode), out)
    except CannotWrite as error:
        fail(2, str(error))
    except OSError as error:
        fail(code_of(error), f"{error.filename} cannot be written: {error.strerror}")
    click.echo(f"wrote {path}; next: formnet check {path}, formnet run {path}")
