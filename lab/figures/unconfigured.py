"""Loads matplotlib without the settings of the working directory.

When it is loaded, matplotlib reads a file ``matplotlibrc``, first of all one in the working
directory, which may be anybody's, and versions before 3.11 evaluate a part of it.
"""

import os
import sys


def _load() -> None:
    """Load it while it finds no file of that name alone; it looks with ``os.path.exists``."""
    if "matplotlib" in sys.modules:
        return
    exists = os.path.exists
    os.path.exists = lambda path: path != "matplotlibrc" and exists(path)
    try:
        import matplotlib  # noqa: F401
    finally:
        os.path.exists = exists


_load()
