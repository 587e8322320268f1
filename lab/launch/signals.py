"""How a command learns that its user wants it to end."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from formnet.formation.wire.process import to_end
from formnet.lab.runs.exits import Stop

GRACE_S = 1.5
"""How long what is to end has to do so in order, before it is made to."""
_AGAIN_S = 0.1


@contextmanager
def stop_signals() -> Iterator[threading.Event]:
    """An event that the signals to end (:func:`to_end`) set, instead of raising anywhere."""
    stopped = threading.Event()
    before = {kind: signal.signal(kind, lambda *_: stopped.set()) for kind in to_end()}
    try:
        yield stopped
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)


@contextmanager
def kept_from_children() -> Iterator[None]:
    """Processes that are started here by multiprocessing hear no Ctrl-C and no hang-up.

    A terminal sends both to all processes; what they mean, the parent decides.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def insisted(may: Callable[[], bool]) -> Iterator[None]:
    """Here a signal to end that is not met within GRACE_S raises Stop, as soon as ``may`` says so.

    For what may be in code that never asks. Only the main thread hears signals; others go on.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handlers = {kind: signal.getsignal(kind) for kind in to_end()}
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
