"""Independent pieces of work on several cores, each in a process of its own."""

import signal
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from multiprocessing import get_context
from multiprocessing.synchronize import Event
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_stop: Event | None = None  # in a worker: set when the user wants an end


class WorkFailed(RuntimeError):
    """A piece of work raised; the text is its traceback. (Not every exception can travel.)"""


def each(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    jobs: int,
    stopped: Callable[[], bool],
    tick: Callable[[], None] = lambda: None,
) -> Iterator[tuple[Item, Result]]:
    """``work`` on every item, at most ``jobs`` at a time; pairs come as they are done.

    Once ``stopped`` says so nothing more is begun, and what runs can see it by
    :func:`stop_wanted`. ``tick`` is called about five times a second.

    Raises:
        WorkFailed: ``work`` raised.
    """
    context = get_context("spawn")
    stop = context.Event()
    with ProcessPoolExecutor(jobs, context, initializer=_begin, initargs=(stop,)) as pool:
        try:
            running = {pool.submit(_guarded, work, item): item for item in items}
            while running:
                done, _ = wait(running, timeout=0.2, return_when=FIRST_COMPLETED)
                tick()
                for future in done:
                    item, (result, trouble) = running.pop(future), future.result()
                    if trouble:
                        raise WorkFailed(trouble)
                    yield item, result  # type: ignore[misc]
                if stopped():
                    return
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)


def stop_wanted() -> bool:
    """In a worker: whether the user wants an end."""
    return _stop is not None and _stop.is_set()


def _guarded(work: Callable[[Item], Result], item: Item) -> tuple[Result | None, str]:
    try:
        return work(item), ""
    except Exception:
        return None, traceback.format_exc()


def _begin(stop: Event) -> None:
    global _stop
    _stop = stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
