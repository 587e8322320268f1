"""formnet in this process: its commands, and inline runs."""

from click.testing import CliRunner

from formnet.formation.briefing.resolving import resolve
from formnet.lab.cli import main
from formnet.lab.launch.inline import Inline
from formnet.lab.runs.recording import Collected


def formnet(*arguments: object) -> tuple[int, str]:
    """The exit code of ``formnet ARGUMENTS``, and what it says, in one line; never a traceback."""
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.output
    assert "Traceback" not in result.output
    return result.exit_code, " ".join(result.output.split())


def collected(scenario, **how):
    """What an inline run of ``scenario`` records; ``how`` are the engine's arguments."""
    found = Collected(scenario)
    Inline().run(resolve(scenario), found, **how)
    return found
