"""``formnet new``: a scenario to begin with."""

from pathlib import Path

import click

from formnet.lab.commands.options import Command, Number, Whole, fail
from formnet.lab.runs.exits import of as code_of
from formnet.lab.scenarios.new import CannotWrite, Wish, write


@click.command("new", cls=Command)
@click.argument("name")
@click.option(
    "--robots",
    type=Whole(2, 1000),
    metavar="N",
    help="How many.  [default: 5, or as many as FILE has places for]",
)
@click.option(
    "--pattern",
    default="circle",
    show_default=True,
    metavar="circle|line|wedge|grid|FILE",
    help="Where the robots shall stand; FILE: CSV with x_m,y_m, one row for each robot.",
)
@click.option(
    "--graph",
    type=click.Choice(("ring", "path", "complete", "star", "random")),
    default="ring",
    show_default=True,
    help="Who hears whom.",
)
@click.option(
    "--network",
    default="ideal",
    show_default=True,
    metavar="PRESET",
    help="What each link is like: ideal, lan, wifi, wifi-congested, lte, satellite, robot-link.",
)
@click.option(
    "--spacing",
    "spacing_m",
    type=Number(0.01, 1e4),
    metavar="M",
    help="Between neighbours in the pattern, in metres; not with FILE  [default: 1.0]",
)
@click.option(
    "--seed",
    type=Whole(0),
    default=1,
    show_default=True,
    help="Draws starts, random graphs, and what links do.",
)
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="[default: NAME.toml]")
@click.option(
    "--mode",
    type=click.Choice(("lockstep", "realtime")),
    default="lockstep",
    show_default=True,
    help="Virtual time, exactly repeatable, or the wall clock.",
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
    """Write a scenario to begin with.

    NAME.toml is written, with comments. Its gains and periods suit the pattern, the graph and
    the number of robots. A file is never overwritten. scenario.schema.json is put beside it, by
    which editors complete and check.
    """
    try:
        path = write(Wish(name, robots, pattern, graph, network, spacing_m, seed, mode), out)
    except CannotWrite as error:
        fail(2, str(error))
    except OSError as error:
        fail(code_of(error), f"{error.filename} cannot be written: {error.strerror}")
    click.echo(f"wrote {path}; next: formnet check {path}, formnet run {path}")
