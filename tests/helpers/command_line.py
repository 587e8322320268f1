"""``formnet`` in this process."""

from click.testing import CliRunner

from formnet.lab.cli import main


def formnet(*arguments: object) -> tuple[int, str]:
    """The exit code of ``formnet ARGUMENTS``, and what it says, in one line; never a traceback."""
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.output
    assert "Traceback" not in result.output
    return result.exit_code, " ".join(result.output.split())
