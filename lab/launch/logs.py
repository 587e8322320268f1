"""Logs of processes, line by line, where something is to be done with each line."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import IO


def keep(stream: IO[bytes], file: Path, line: Callable[[str], str | None]) -> threading.Thread:
    """Append to ``file`` what ``line`` makes of every line of ``stream`` (None: nothing).

    That is done by the thread that is returned, which ends with ``stream``.
    """

    def follow() -> None:
        with stream, file.open("a", encoding="utf-8", buffering=1) as log:
            for raw in stream:
                text = line(raw.decode(errors="replace"))
                if text is not None:
                    log.write(text)

    thread = threading.Thread(target=follow, daemon=True)
    thread.start()
    return thread
