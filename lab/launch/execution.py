"""Running a scenario into a recording, in one process or in many."""

import secrets
from collections.abc import Callable

from formnet.formation.wire.record import Outcome, Sink
from formnet.lab.launch import inline as one_process
from formnet.lab.launch.launch import HERE, Begun, Launch, Place
from formnet.lab.runs.recording import Recording
from formnet.netem.settings.timeline import NEVER


def execute(
    recording: Recording,
    sink: Sink,
    stopped: Callable[[], bool],
    refresh: Callable[[], None] = lambda: None,
    *,
    inline: bool,
    place: Place = HERE,
    begun: Begun = lambda *_: None,
    until_ns: int = NEVER,
) -> Outcome:
    """Run ``recording.scenario``, records going to ``sink``; ``stopped`` ends it early.

    ``sink`` passes them on to ``recording``. ``refresh`` is called now and then. The logs of a
    distributed run's processes are put into the recording's folder, and that of a law that raised
    in an inline one; ``place`` says where processes are, and ``begun`` is told where they meet
    before the robots are started. The run may end at ``until_ns``.

    Raises:
        HostUnreachable: a robot's host cannot be reached.
        OSError: processes cannot be started, or not log into the recording's folder.
    """
    scenario, folder = recording.scenario, recording.folder
    name = f"{scenario.name}-{secrets.token_hex(6)}"  # unique on the bus
    if not inline:
        launch = Launch(scenario, name, sink, folder / "logs", place, begun)
        return launch.wait(lambda: stopped() or recording.now_ns() >= until_ns, refresh)

    def asked() -> bool:
        refresh()
        return stopped()

    def log(robot: int, text: str) -> None:
        (folder / "logs").mkdir(exist_ok=True)
        (folder / "logs" / f"robot-{robot}.log").write_text(text, encoding="utf-8")

    return one_process.run(scenario, name, sink, asked, log, until_ns)
