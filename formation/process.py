"""What every child process of a run shares: how it learns that it should stop."""

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable


def on_stop(stop: Callable[[], None], *, at_end_of_input: bool) -> None:
    """Call ``stop`` on SIGINT or SIGTERM and, if asked, when standard input ends.

    A launcher holds the other end of the child's standard input: it closes it
    to stop the child, and the system closes it if the launcher dies, so no
    child outlives its launcher. A child that still runs three seconds after
    that exits without ceremony; on Linux even a stopped one dies with it.
    """

    def handle(_signal: int, _frame: object) -> None:
        stop()

    signal.signal(signal.SIGTERM, handle)
    signal.signal(signal.SIGINT, signal.SIG_IGN if at_end_of_input else handle)
    if at_end_of_input:
        die_with_parent()
        threading.Thread(target=_watch_input, args=(stop,), daemon=True).start()


def _watch_input(stop: Callable[[], None]) -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    stop()
    threading.Timer(3.0, os._exit, args=(3,)).start()


def die_with_parent() -> None:
    """On Linux, have the kernel kill this process when the one that started it ends."""
    if sys.platform == "linux":
        pr_set_pdeathsig = 1  # prctl(2)
        ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)
