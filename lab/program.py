"""The program ``formnet``, also ``python -m formnet``: what holds for every command.

Nothing heavy is imported before signals have been seen to.
"""

import os
import signal
import sys
from types import FrameType
from typing import NoReturn

from formnet.lab.runs.exits import BROKEN, INTERRUPTED, Stop, in_words

_IMPORTING = "<frozen importlib"


def _end(_: int, frame: FrameType | None) -> None:
    """A signal to end before a command has its own way: Stop, but in an import the end at once.

    What is imported may catch anything, and nothing has been begun there.
    """
    while frame is not None:
        if frame.f_code.co_filename.startswith(_IMPORTING):
            os._exit(INTERRUPTED)
        frame = frame.f_back
    raise Stop


def main() -> NoReturn:
    """Run the command line; the exit codes are those of :mod:`formnet.lab.runs.exits`."""
    for kind in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(kind) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(kind, _end)
    code = INTERRUPTED
    try:
        from formnet.lab.text.streams import lenient

        with lenient() as trouble:
            code = _command()
            signal.signal(signal.SIGINT, lambda *_: os._exit(code))  # it is over already
        for error in trouble:
            code = code or BROKEN
            os.write(2, f"what was printed is not complete: {in_words(error)}\n".encode())
    except (KeyboardInterrupt, Stop, OSError):  # OSError: not even standard error takes it
        pass
    sys.exit(code)


def _command() -> int:
    """The exit code of the command that the arguments name."""
    import traceback

    import click

    from formnet.lab.runs.exits import BAD_INPUT

    try:
        from formnet.lab.cli import main as group

        code = group.main(prog_name="formnet", standalone_mode=False)
    except click.ClickException as error:
        error.show()
        return BAD_INPUT
    except (click.Abort, KeyboardInterrupt, Stop):
        return INTERRUPTED
    except SystemExit as end:
        code = end.code
    except OSError as error:
        print(in_words(error), file=sys.stderr)
        return BROKEN
    except Exception:
        traceback.print_exc()
        print("this is an error of formnet's own; please report it", file=sys.stderr)
        return BROKEN
    return code if isinstance(code, int) else 0


if __name__ == "__main__":
    main()
