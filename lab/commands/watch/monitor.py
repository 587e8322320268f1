"""Watch a run in progress."""

import sys
import threading
from pathlib import Path

import click

from formnet.lab.commands.options import KEYS, LEASH, PLAINTEXT, VIEW, WEB, Command, fail, viewer


@click.command("monitor", cls=Command)
@click.argument(
    "folder", required=False, metavar="[RUN]", type=click.Path(path_type=Path, file_okay=False)
)
@click.option(
    "--connect", metavar="ENDPOINT", help="Endpoint of the run, e.g. tls/192.168.1.10:7447."
)
@click.option("--run", "run_name", metavar="ID", help="Id of the run, if there are several.")
@VIEW
@WEB
@click.option(
    "--save",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.rrd",
    help="Record to a file.",
)
@KEYS
@PLAINTEXT
@LEASH
def command(
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
    """Watch a run in progress.

    RUN is a run folder, by default the newest in runs/. The monitor only listens and does not
    affect the run. Without --web or --save, a window opens.

    Exit code 0: the run was followed to its end; 2: there is nothing to watch; 3: the run broke
    off, or --save could not be written; 130: interrupted before the end.
    """
    from formnet.formation.machines.custody import KeysError
    from formnet.formation.wire.bus import BusError
    from formnet.formation.wire.process import on_stop
    from formnet.lab.launch.live import find
    from formnet.lab.scene.viewer import ViewerFailed
    from formnet.lab.watch.monitor import NoRun, Source, watch

    if connect is not None and folder is not None:
        raise click.UsageError("RUN is a run on this machine: it excludes --connect")
    shown = viewer(view=view or not (web or save), web=web)
    if save is not None and save.exists():
        fail(2, f"--save: {save} exists already")
    stopped = threading.Event()
    on_stop(stopped.set, at_end_of_input=leash)
    try:
        endpoint, name = find(folder) if connect is None else (connect, run_name)
        source = Source(endpoint, name, keys, plaintext)
        sys.exit(watch(source, view=shown, file=save, stopped=stopped))
    except (LookupError, BusError, KeysError, NoRun, ViewerFailed) as error:
        fail(2, str(error))
