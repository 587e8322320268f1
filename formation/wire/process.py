"""What every child process of a run shares: how it learns that it should stop."""

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable

END_OF_PLAN = b"\0"
"""After a plan that comes through standard input, which stays open as a leash."""


def read_plan() -> bytes:
    """What comes on standard input up to END_OF_PLAN, or to its end."""
    text = bytearray()
    while END_OF_PLAN not in text[-4096:]:
        piece = os.read(sys.stdin.fileno(), 4096)
        if not piece:
            break
        text += piece
    return bytes(text).partition(END_OF_PLAN)[0]


def to_end() -> list[signal.Signals]:
    """The signals that ask a process to end: SIGINT, SIGTERM, and SIGHUP unless it is ignored.

    nohup(1) ignores the last, so that what it starts outlives the terminal.
    """
    kinds = [signal.SIGINT, signal.SIGTERM]
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return kinds if ignored else [*kinds, signal.SIGHUP]


def on_stop(stop: Callable[[], None], *, at_end_of_input: bool) -> None:
    """Call ``stop`` on a signal to end (:func:`to_end`) and, if asked, when standard input ends.

    A launcher holds the other end of the child's standard input: it closes it
    to stop the child, and the system closes it if the launcher dies, so no
    child outlives its launcher. A child that still runs three seconds after
    that exits without ceremony; on Linux even a stopped one dies with it.
    """

    def handle(_signal: int, _frame: object) -> None:
        stop()

    for kind in to_end():
        signal.signal(kind, handle)
    if at_end_of_input:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
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
