"""Other Python processes of ours take no module from the folder in which they are started.

Python looks for modules in the working directory first, which may be somebody else's run folder.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

SAFE = "-P"
"""The option that leaves the working directory out of the path."""
_VARIABLE = "PYTHONSAFEPATH"


def module(name: str, *arguments: str) -> list[str]:
    """The command that runs the module ``name`` as a program."""
    return [sys.executable, SAFE, "-m", name, *arguments]


@contextmanager
def safe_path() -> Iterator[None]:
    """What multiprocessing starts here is started likewise: it passes no options on, but this."""
    before = os.environ.get(_VARIABLE)
    os.environ[_VARIABLE] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_VARIABLE]
        else:
            os.environ[_VARIABLE] = before
