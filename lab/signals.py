"""How a command learns that its user wants it to end."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

GRACE_S = 1.5
"""How long what is to end has to do so in order, before it is made to."""
_AGAIN_S = 0.1
_KINDS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def stop_signals() -> Iterator[threading.Event]:
    """An event that SIGINT and SIGTERM set, instead of raising wherever the program is."""
    stopped = threading.Event()
    before = [signal.signal(kind, lambda *_: stopped.set()) for kind in _KINDS]
    try:
        yield stopped
    finally:
        for kind, handler in zip(_KINDS, before, strict=True):
            signal.signal(kind, handler)


class Stop(BaseException):
    """The user's wish to end, where nobody asks for it."""


@contextmanager
def insisted(may: Callable[[], bool]) -> Iterator[None]:
    """Here a signal to end that is not met within GRACE_S raises Stop, as soon as ``may`` says so.

    For what may be in code that never asks. Only the main thread hears signals; others go on.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handlers = {kind: signal.getsignal(kind) for kind in _KINDS}
    before = {kind: handler for kind, handler in handlers.items() if callable(handler)}
    main = threading.get_ident()
    reminders: list[threading.Timer] = []

    def heard(number: int, frame: Any) -> None:
        if reminders and may():
            raise Stop
        before[signal.Signals(number)](number, frame)
        wait_s = _AGAIN_S if reminders else GRACE_S
        reminders.append(threading.Timer(wait_s, signal.pthread_kill, (main, number)))
        reminders[-1].daemon = True
        reminders[-1].start()

    for kind in before:
        signal.signal(kind, heard)
    try:
        yield
    finally:
        for reminder in reminders:
            reminder.cancel()
            reminder.join()
        for kind, handler in before.items():
            signal.signal(kind, handler)
