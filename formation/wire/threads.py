"""How many threads Zenoh works with; it reads that when it is loaded, so this comes before."""

import os
from typing import Final

_VARIABLE: Final = "ZENOH_RUNTIME"
_ONE: Final = (
    "(app: (worker_threads: 1), rx: (handover: app), tx: (handover: app), acc: (handover: app), "
    "net: (handover: app))"
)
"""One for everything: a pool for each kind of work costs a lockstep tick a quarter more."""
_MANY: Final = "(rx: {0}, tx: {0}, net: {0}, app: {0})".format("(worker_threads: 64)")


def many() -> None:
    """Many threads, where a connection that is gone may keep one busy for seconds.

    What the user has set stays; the one thread that a launcher hands on becomes many.
    """
    if os.environ[_VARIABLE] == _ONE:
        os.environ[_VARIABLE] = _MANY


os.environ.setdefault(_VARIABLE, _ONE)
