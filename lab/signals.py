"""How a command learns that its user wants it to end."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def stop_signals() -> Iterator[threading.Event]:
    """An event that SIGINT and SIGTERM set, instead of raising wherever the program is."""
    stopped = threading.Event()
    kinds = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(kind, lambda *_: stopped.set()) for kind in kinds]
    try:
        yield stopped
    finally:
        for kind, handler in zip(kinds, before, strict=True):
            signal.signal(kind, handler)


@contextmanager
def again_raises(stopped: Callable[[], bool]) -> Iterator[None]:
    """Here a second SIGINT, one that comes when it is ``stopped``, raises KeyboardInterrupt.

    For what may be in code that never asks. Only the main thread hears signals; others go on.
    """
    before = signal.getsignal(signal.SIGINT)

    def heard(*arguments: Any) -> None:
        if stopped() or not callable(before):
            raise KeyboardInterrupt
        before(*arguments)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, heard)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
