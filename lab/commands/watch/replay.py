"""Replay a recorded run."""

from pathlib import Path

import click

from formnet.lab.commands.options import VIEW, WEB, Command, Number, fail, viewer


@click.command("replay", cls=Command)
@click.argument("folder", metavar="RUN", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--speed",
    type=Number(0.01, 1000.0),
    default=1.0,
    show_default=True,
    help="Simulated seconds per second.",
)
@VIEW
@WEB
def command(folder: Path, speed: float, view: bool, web: bool) -> None:
    """Replay a recorded run.

    RUN is a run folder. Without --web, a window opens.
    """
    from formnet.formation.scenario.loading import ScenarioError
    from formnet.lab.scene.viewer import ViewerFailed
    from formnet.lab.watch.replay import NoScene, replay

    shown = viewer(view=view, web=web)
    try:
        replay(folder, speed, web=shown == "web", say=click.echo)
    except (NoScene, ScenarioError, ViewerFailed) as error:
        fail(2, str(error))
