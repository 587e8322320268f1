"""The command ``formnet``; :mod:`lab.runs.exits` has its exit codes.

Heavy modules are imported inside the commands, so that ``--help`` answers at once.
"""

import sys
from pathlib import Path
from typing import NoReturn

import click

from formnet.lab.commands.completion import run_folders, toml_files
from formnet.lab.commands.options import Number, Whole
from formnet.lab.runs.build import install, stale
from formnet.lab.runs.exits import in_words
from formnet.lab.runs.exits import of as code_of


def _scenario(_: click.Context, __: click.Parameter, argument: str) -> Path:
    from formnet.lab.scenarios.packaged import find

    try:
        return find(argument)
    except LookupError as error:
        raise click.BadParameter(str(error)) from None


SCENARIO = click.argument(
    "scenario", callback=_scenario, metavar="SCENARIO", shell_complete=toml_files
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
    "--inline", is_flag=True, help="Every run in one process, as many at once as cores."
)
JOBS = click.option(
    "--jobs", type=Whole(1), help="Inline runs at once  [default: one for each core]"
)
OVERRIDE = click.option(
    "--set", "overrides", multiple=True, metavar="KEY.PATH=VALUE",
    help="Override a value of the scenario, e.g. law.beta=5 or robots.3.damping=1. Repeatable.",
)  # fmt: skip
RUN = click.option(
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


SECTIONS = {
    "A run": ("run", "check", "new", "scenarios", "laws"),
    "Watch": ("monitor", "replay"),
    "Look back": ("list", "report", "plot", "compare", "export", "verify"),
    "Many runs": ("claims", "nemesis"),
    "Networks and machines": ("netem-bridge", "doctor", "keys"),
    "Editors and shells": ("schema", "completion"),
    "Started by formnet run": ("plant", "agent"),
}
"""The commands as --help shows them."""


class _Command(click.Command):
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


class _Commands(click.Group):
    command_class = _Command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        column = max(map(len, self.commands))
        for title, names in SECTIONS.items():
            shown = [(name, self.commands[name].get_short_help_str(62)) for name in names]
            with formatter.section(title):
                formatter.write_dl([(name.ljust(column), text) for name, text in shown])


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="formnet", message="formnet %(version)s")
def main() -> None:
    """Formation control over imperfect networks: run it, break it, get a verdict."""
    problem = stale()
    if problem is not None:
        raise click.UsageError(problem)


@main.command()
@SCENARIO
@click.option(
    "--out", type=click.Path(path_type=Path), help="Run folder  [default: runs/<name>-<time>]"
)
@OVERRIDE
@click.option(
    "--inline", is_flag=True, help="Everything in one process, without Zenoh; same trajectories."
)
@click.option(
    "--hosts",
    type=click.Path(path_type=Path),
    metavar="HOSTS.toml",
    help="Run robots on other machines, over SSH (docs/hosts.md).",
)
@click.option(
    "--connect",
    "router",
    metavar="ENDPOINT",
    help="Meet at this Zenoh router, e.g. tcp/127.0.0.1:7447  [default: at the plant]",
)
@KEYS
@PLAINTEXT
@VIEW
@WEB
@click.option(
    "--no-figures", is_flag=True, help="Do not draw: formnet report or plot do it when asked to."
)
def run(
    scenario: Path,
    out: Path | None,
    overrides: tuple[str, ...],
    inline: bool,
    hosts: Path | None,
    router: str | None,
    keys: Path | None,
    plaintext: bool,
    view: bool,
    web: bool,
    no_figures: bool,
) -> None:
    """Run SCENARIO and judge it.

    SCENARIO is a file, the name of one of `formnet scenarios`, or the folder of a run.

    Exit code 0: every claim in [expect] holds; 1: one does not, or cannot be judged, or there is
    none and the run diverged or lost a robot; 2: bad scenario or usage; 3: the run itself broke,
    or not all of it could be written; 130: interrupted.
    """
    if inline and (hosts or router or keys or plaintext):
        raise click.UsageError(
            "--inline is one process: no --hosts, --connect, --keys or --plaintext"
        )
    if inline and (view or web):
        raise click.UsageError(
            "--inline is over before one can look: afterwards, formnet replay RUN shows it"
        )
    from formnet.lab.commands.run import run_scenario
    from formnet.lab.machines.place import Where

    where = Where(hosts, keys, plaintext, router)
    shown = _view(view=view, web=web)
    sys.exit(run_scenario(
        scenario, overrides, out, inline=inline, where=where, view=shown, drawn=not no_figures
    ))  # fmt: skip


@main.command()
@click.argument(
    "folder", required=False, metavar="[RUN]", type=click.Path(path_type=Path, file_okay=False)
)
@click.option("--connect", metavar="ENDPOINT", help="Where it goes on, e.g. tls/192.168.1.10:7447.")
@click.option("--run", "run_name", metavar="ID", help="Which one, if several go on there.")
@VIEW
@WEB
@click.option(
    "--save", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE.rrd",
    help="Keep what is seen.",
)  # fmt: skip
@KEYS
@PLAINTEXT
@LEASH
def monitor(
    folder: Path | None,
    connect: str | None,
    run_name: str | None,
    view: bool,
    web: bool,
    save: Path | None,
    keys: Path | None,
    plaintext: bool,
    leash: bool,
) -> None:
    """Watch a run that goes on.

    RUN is its folder, by default the newest below runs. The monitor only listens: the run does
    not notice it, whatever becomes of it. Without --web or --save it opens a window.

    Exit code 0: the run was seen to its end; 2: there is nothing to watch; 3: the run broke off,
    or --save could not be written; 130: interrupted before its end.
    """
    if connect is not None and folder is not None:
        raise click.UsageError("RUN is a run on this machine: it and --connect exclude each other")
    shown = _view(view=view or not (web or save), web=web)
    if save is not None and save.exists():
        _fail(2, f"--save: {save} exists already")
    import threading

    from formnet.formation.wire.bus import BusError
    from formnet.formation.wire.process import on_stop
    from formnet.formation.wire.security import KeysError
    from formnet.lab.launch.live import find
    from formnet.lab.scene.viewer import ViewerFailed
    from formnet.lab.watch.monitor import NoRun, Source, watch

    stopped = threading.Event()
    on_stop(stopped.set, at_end_of_input=leash)
    try:
        endpoint, name = find(folder) if connect is None else (connect, run_name)
        source = Source(endpoint, name, keys, plaintext)
        sys.exit(watch(source, view=shown, file=save, stopped=stopped))
    except (LookupError, BusError, KeysError, NoRun, ViewerFailed) as error:
        _fail(2, str(error))


@main.command()
@click.argument("folder", metavar="RUN", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--speed",
    type=Number(0.01, 1000.0),
    default=1.0,
    show_default=True,
    help="How many simulated seconds a second.",
)
@VIEW
@WEB
def replay(folder: Path, speed: float, view: bool, web: bool) -> None:
    """Watch a recorded run again.

    RUN is its folder. Without --web it opens a window.
    """
    from formnet.formation.scenario.loading import ScenarioError
    from formnet.lab.scene.viewer import ViewerFailed
    from formnet.lab.watch.replay import NoScene
    from formnet.lab.watch.replay import replay as show

    shown = _view(view=view, web=web)
    try:
        show(folder, speed, web=shown == "web", say=click.echo)
    except (NoScene, ScenarioError, ViewerFailed) as error:
        _fail(2, str(error))


@main.command()
@SCENARIO
@OVERRIDE
def check(scenario: Path, overrides: tuple[str, ...]) -> None:
    """Validate SCENARIO; say what the theory makes of it."""
    from formnet.lab.commands.check import check_scenario

    sys.exit(check_scenario(scenario, overrides))


@main.command()
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
def new(
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
    from formnet.lab.scenarios.new import CannotWrite, Wish, write

    try:
        path = write(Wish(name, robots, pattern, graph, network, spacing_m, seed, mode), out)
    except CannotWrite as error:
        _fail(2, str(error))
    except OSError as error:
        _fail(code_of(error), f"{error.filename} cannot be written: {error.strerror}")
    click.echo(f"wrote {path}; next: formnet check {path}, formnet run {path}")


@main.command()
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="FILE", help="[default: standard output]"
)
def schema(out: Path | None) -> None:
    """Print the JSON Schema of scenarios, for editors."""
    from formnet.lab.runs import files
    from formnet.lab.scenarios.schema import text

    if out is None:
        click.echo(text(), nl=False)
        return
    try:
        files.replace(out, text())
    except OSError as error:
        _fail(code_of(error), f"--out {out}: {error.strerror}")


@main.command()
@click.argument("shell", type=click.Choice(("bash", "zsh", "fish")))
def completion(shell: str) -> None:
    """Print what SHELL must evaluate to complete formnet.

    \b
    bash: echo 'eval "$(formnet completion bash)"' >> ~/.bashrc
    zsh:  echo 'eval "$(formnet completion zsh)"' >> ~/.zshrc
    fish: formnet completion fish > ~/.config/fish/completions/formnet.fish
    """
    from formnet.lab.commands.completion import script

    click.echo(script(main, shell))


@main.command()
@RUNS
@click.option("--distributed", is_flag=True, help="Run again in many processes  [default: in one]")
def verify(folders: tuple[Path, ...], distributed: bool) -> None:
    """Run recorded runs again; compare every bit.

    Each from its own scenario.toml. Exit code 0: identical; 1: the first difference is named;
    2: no run that could be repeated; 3: it could not be run again; 130: interrupted.
    """
    from formnet.lab.commands.verify import verify_runs

    sys.exit(verify_runs(folders, inline=not distributed))


@main.command()
@RUNS
def report(folders: tuple[Path, ...]) -> None:
    """Make report.html again, from a run's folder."""
    from formnet.lab.pages.report import report_runs

    sys.exit(report_runs(folders))


@main.command()
@FOLDER
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="New folder  [default: figures/ of the run]",
)
def plot(folder: Path, out: Path | None) -> None:
    """Draw a run's figures again, from its folder."""
    from formnet.lab.commands.plot import plot_run

    sys.exit(plot_run(folder, out))


@main.command()
@RUNS
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Write comparison.md, .csv and a figure into a new folder.",
)
def compare(folders: tuple[Path, ...], out: Path | None) -> None:
    """Put runs side by side.

    Verdicts, errors, whether the bits are the same, and what differs in the scenarios.

    Exit code 0; 1 if two runs of one scenario in virtual time differ in a bit; 2: bad usage.
    """
    if len(folders) < 2:
        raise click.UsageError("compare needs two runs or more")
    from formnet.lab.commands.compare import compare_runs

    sys.exit(compare_runs(folders, out))


@main.command()
@FOLDER
@click.option("--format", "kind", type=click.Choice(["mcap", "csv"]), required=True)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE|DIR",
    help="New file (mcap) or folder (csv)  [default: run.mcap or csv/ in the run's folder]",
)
def export(folder: Path, kind: str, out: Path | None) -> None:
    """Write a run as MCAP or CSV.

    MCAP is for Foxglove (needs the extra "export"), CSV for spreadsheets.

    What is there is never overwritten.
    """
    from formnet.lab.commands.export import export_run

    sys.exit(export_run(folder, kind, out))


@main.command("list")
@click.argument("folder", metavar="[DIR]", default=Path("runs"), type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="For other programs.")
def list_(folder: Path, as_json: bool) -> None:
    """List the runs in DIR (runs/), newest first."""
    from formnet.lab.pages.listing import list_runs

    sys.exit(list_runs(folder, as_json=as_json))


@main.command()
@INLINE_RUNS
@click.option(
    "--only",
    multiple=True,
    metavar="PATTERN",
    help="Only claims whose key matches, e.g. theorem-* (--list shows the keys). Repeatable.",
)
@click.option("--list", "listed", is_flag=True, help="List the claims and end.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder of results  [default: runs/claims-<time>]",
)
@click.option(
    "--into",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    metavar="FILE",
    help="Put the table into FILE, between the comments that mark its place there.",
)
@JOBS
def claims(
    inline: bool,
    only: tuple[str, ...],
    listed: bool,
    out: Path | None,
    into: Path | None,
    jobs: int | None,
) -> None:
    """Run every claim of the paper, judge each.

    Exit code 0: every one ends as predicted; 1: one does not; 2: bad usage; 3: a run broke;
    130: interrupted (what is complete is written).
    """
    _need_inline(jobs, inline=inline)
    from formnet.lab.commands.claims import list_claims, run_claims

    sys.exit(list_claims() if listed else run_claims(only, out, into, jobs, inline=inline))


@main.command()
@SCENARIO
@OVERRIDE
@click.option("--runs", type=Whole(1), default=20, show_default=True, help="How many.")
@click.option(
    "--seed",
    type=Whole(0),
    default=1,
    show_default=True,
    help="Seed of the first run; each next one has the next.",
)
@INLINE_RUNS
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder of results  [default: runs/nemesis-<time>]",
)
@click.option(
    "--limit",
    "limit_s",
    type=Number(1.0, 1e9),
    default=600.0,
    show_default=True,
    metavar="SECONDS",
    help="A run that takes longer than this has hung.",
)
@JOBS
def nemesis(
    scenario: Path,
    overrides: tuple[str, ...],
    runs: int,
    seed: int,
    inline: bool,
    out: Path | None,
    limit_s: float,
    jobs: int | None,
) -> None:
    """Break SCENARIO with random failures.

    Robots are killed, restarted and paused, links are cut, partitioned, delayed and lossy in the
    first quarter of each run. Every run must end, keep its record consistent, give the same bits
    when it is repeated, and recover to what [expect] claims. What fails is shrunk.

    Exit code 0: every run is well; 1: one is not, and its seed is named; 2: bad usage;
    3: the nemesis itself broke; 130: interrupted.
    """
    _need_inline(jobs, inline=inline)
    from formnet.lab.commands.nemesis import run_nemesis

    sys.exit(run_nemesis(scenario, overrides, runs, seed, out, limit_s, jobs, inline=inline))


@main.command()
@click.option(
    "--hosts", type=click.Path(path_type=Path), metavar="HOSTS.toml", help="Look at these, too."
)
@KEYS
def doctor(hosts: Path | None, keys: Path | None) -> None:
    """Check this machine and others; say how to mend what is wrong.

    Exit code 0: all is well; 2: bad usage; 3: something is not well.
    """
    from formnet.lab.commands.doctor import examine

    sys.exit(examine(hosts, keys))


@main.group()
def keys() -> None:
    """Make certificates: who is who in a run."""


@keys.command("init")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path, file_okay=False))
@click.option("--robots", required=True, metavar="IDS", help="For whom, e.g. 1-5 or 1,3,7-9.")
@click.option(
    "--hosts",
    default="",
    metavar="NAMES",
    help="Names and addresses at which the plant is reached, e.g. lab-pc,192.168.1.10.",
)
@click.option("--days", type=Whole(1, 3650), default=365, show_default=True)
def keys_init(folder: Path, robots: str, hosts: str, days: int) -> None:
    """Make an authority and a certificate for the plant, a monitor and every robot.

    Private keys have mode 0600, and nothing is ever overwritten: run it again for more robots.
    """
    try:
        from formnet.lab.machines.keys import KeysExist, make, robots_of
    except ImportError:
        _fail(2, f"keys need the package cryptography: {install('hosts')}")
    try:
        ids = robots_of(robots)
    except ValueError as error:
        raise click.UsageError(f"--robots: {error}") from None
    try:
        written = make(folder, ids, [name for name in hosts.split(",") if name], days)
    except KeysExist as error:
        _fail(2, str(error))
    except OSError as error:
        _fail(code_of(error), in_words(error))
    for path in written:
        click.echo(str(path))


@main.command()
def laws() -> None:
    """List the control laws that law.kind can name."""
    from formnet.agent.law import installed
    from formnet.lab.forecast.foresight import unusable

    for name, entry in installed().items():
        source = f"  ({entry.dist.name} {entry.dist.version})" if entry.dist else ""
        click.echo(f"{name:20} {entry.value}{source}")
        problem = unusable(name)
        if problem is not None:
            click.echo(f"{'':20} {problem}")


@main.command()
def scenarios() -> None:
    """List the scenarios that come along."""
    from formnet.lab.scenarios.packaged import described

    for name, description in described():
        click.echo(f"{name:24} {description}")


@main.command("netem-bridge")
@click.option(
    "--from",
    "first",
    required=True,
    metavar="ENDPOINT",
    help="One network, e.g. tcp/127.0.0.1:7447: connect there; with listen: before it, wait "
    "there for applications to connect.",
)
@click.option("--to", "second", required=True, metavar="ENDPOINT", help="The other network.")
@click.option(
    "--key", "keys", default="**", show_default=True, metavar="KEYEXPR", help="What is carried."
)
@click.option(
    "--network",
    type=click.Path(path_type=Path),
    required=True,
    metavar="FILE.toml",
    help="The links: [network.default] and [[network.links]] with key and direction.",
)
@click.option(
    "--control",
    metavar="HOST:PORT",
    help="Show statistics and take changes there (HTTP, JSON), e.g. 127.0.0.1:8765.",
)
def netem_bridge(first: str, second: str, keys: str, network: Path, control: str | None) -> None:
    """Join two Zenoh networks by emulated links.

    Until Ctrl-C. Carries publications (put, delete), queries and replies that match --key, both
    ways.
    """
    from formnet.lab.commands.bridge import run_bridge

    sys.exit(run_bridge(first, second, keys, network, control))


@main.command()
@click.option("--robot", required=True, type=int, metavar="N", help="Which robot this is.")
@click.option(
    "--connect", required=True, metavar="ENDPOINT", help="The plant, e.g. tcp/127.0.0.1:7447."
)
@RUN
@LEASH
@KEYS
@PLAINTEXT
@LEASE
def agent(
    robot: int,
    connect: str,
    run_name: str,
    leash: bool,
    keys: Path | None,
    plaintext: bool,
    lease_s: float,
) -> None:
    """Be one robot of a run."""
    from formnet.formation.wire import threads

    if lease_s < LONGEST_LEASE_S:  # one that is gone must not hold up the others
        threads.many()
    from formnet.agent.process import main as agent_main
    from formnet.formation.wire.bus import BusError
    from formnet.formation.wire.security import KeysError

    try:
        sys.exit(
            agent_main(
                robot=robot,
                run=run_name,
                connect=connect,
                stop_at_end_of_input=leash,
                keys=keys,
                plaintext=plaintext,
                lease_s=lease_s,
            )
        )
    except (BusError, KeysError) as error:
        _fail(3, str(error))


def _scenario_or_input(
    context: click.Context, parameter: click.Parameter, argument: str
) -> Path | None:
    return None if argument == "-" else _scenario(context, parameter, argument)


@main.command()
@click.argument(
    "scenario", callback=_scenario_or_input, metavar="SCENARIO|-", shell_complete=toml_files
)
@click.option("--listen", metavar="ENDPOINT", help="Where robots join, e.g. tcp/127.0.0.1:7447.")
@click.option(
    "--connect", metavar="ENDPOINT", help="A Zenoh router at which plant and robots meet instead."
)
@click.option(
    "--record", metavar="FILE", help="Write the record stream here; - for standard output."
)
@click.option(
    "--start-patience",
    "start_patience_s",
    type=Number(1.0, 1e9),
    metavar="SECONDS",
    help="End the run if no robot gets further for so long before the first tick  [default: wait]",
)
@RUN
@LEASH
@OVERRIDE
@KEYS
@PLAINTEXT
@LEASE
def plant(
    scenario: Path | None,
    listen: str | None,
    connect: str | None,
    record: str | None,
    start_patience_s: float | None,
    run_name: str,
    leash: bool,
    overrides: tuple[str, ...],
    keys: Path | None,
    plaintext: bool,
    lease_s: float,
) -> None:
    """Be the plant of a run of SCENARIO.

    With -, the scenario comes from standard input, which ends it or goes on after a NUL byte.
    """
    if (listen is None) == (connect is None):
        raise click.UsageError("needs --listen or --connect, and not both")
    from formnet.formation.wire import threads

    if lease_s < LONGEST_LEASE_S:
        threads.many()
    from formnet.formation.scenario.loading import ScenarioError, load, loads
    from formnet.formation.wire.bus import BusError
    from formnet.formation.wire.process import read_scenario
    from formnet.formation.wire.security import KeysError
    from formnet.plant.process import main as plant_main

    try:
        if scenario is None:
            loaded = loads(read_scenario(), "standard input", overrides)
        else:
            loaded = load(scenario, overrides)
    except (ScenarioError, UnicodeDecodeError) as error:
        _fail(2, str(error))
    try:
        sys.exit(
            plant_main(
                loaded,
                run=run_name,
                listen=listen,
                connect=connect,
                record=record,
                stop_at_end_of_input=leash,
                start_patience_s=start_patience_s,
                keys=keys,
                plaintext=plaintext,
                lease_s=lease_s,
            )
        )
    except (BusError, KeysError) as error:
        _fail(3, str(error))
    except OSError as error:
        _fail(3, in_words(error))


def _view(*, view: bool, web: bool) -> str | None:
    if view and web:
        raise click.UsageError("--view and --web exclude each other")
    return "web" if web else "window" if view else None


def _need_inline(jobs: int | None, *, inline: bool) -> None:
    if jobs is not None and not inline:
        raise click.UsageError("--jobs goes with --inline: a distributed run has all cores")


def _fail(code: int, text: str) -> NoReturn:
    click.echo(text, err=True)
    sys.exit(code)


if __name__ == "__main__":
    from formnet.lab.program import main as program

    program()
