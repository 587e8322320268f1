"""The program ``formnet``, also ``python -m formnet``: what holds for every command.

Nothing heavy is imported before Ctrl-C has been seen to.
"""

import os
import signal
import sys
from types import FrameType
from typing import NoReturn

_IMPORTING = "<frozen importlib"


def _interrupted(_: int, frame: FrameType | None) -> None:
    """Ctrl-C: KeyboardInterrupt, but in an import, which might swallow that, the end at once."""
    while frame is not None:
        if frame.f_code.co_filename.startswith(_IMPORTING):
            os._exit(130)
        frame = frame.f_back
    raise KeyboardInterrupt


def main() -> NoReturn:
    """Run the command line; the exit codes are those of :mod:`lab.runs.exits`."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupted)
    code = 130
    try:
        from formnet.lab.runs.exits import BROKEN, in_words
        from formnet.lab.streams import lenient

        with lenient() as trouble:
            code = _command()
            signal.signal(signal.SIGINT, lambda *_: os._exit(code))  # it is over already
        for error in trouble:
            code = code or BROKEN
            os.write(2, f"what was printed is not complete: {in_words(error)}\n".encode())
    except (KeyboardInterrupt, OSError):  # not even standard error can be written
        pass
    sys.exit(code)


def _command() -> int:
    """The exit code of the command that the arguments name."""
    import traceback

    import click

    from formnet.lab.runs.exits import BAD_INPUT, BROKEN, INTERRUPTED, in_words

    try:
        from formnet.lab.cli import main as group

        code = group.main(prog_name="formnet", standalone_mode=False)
    except click.Abort:
        return INTERRUPTED
    except click.ClickException as error:
        error.show()
        return BAD_INPUT
    except KeyboardInterrupt:
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
