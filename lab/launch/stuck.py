"""A law may never come back: saying where it is."""

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

PATIENCE_S = 5.0


@contextmanager
def told(say: Callable[[str], None], progress: Callable[[], int] = lambda: 0) -> Iterator[None]:
    """Another thread calls ``say`` with the place (``law.py:12``) where this one is stuck.

    Once for each value of ``progress`` that has not changed for ``PATIENCE_S`` or more.
    """
    done, runner = threading.Event(), threading.get_ident()

    def watch() -> None:
        said, before = None, progress()
        while not done.wait(PATIENCE_S):
            now = progress()
            if now == before != said:
                frame = sys._current_frames()[runner]
                say(f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}")
                said = now
            before = now

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()
