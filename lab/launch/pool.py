"""Many independent runs: on several cores or one after another, with a bar that shows how far."""

import os
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from ctypes import c_bool
from multiprocessing import get_context, resource_tracker
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from formnet.formation.wire.process import die_with_parent
from formnet.lab.launch.interpreter import safe_path
from formnet.lab.launch.signals import GRACE_S, kept_from_children
from formnet.lab.runs.exits import BROKEN, in_words

Item = TypeVar("Item")
Result = TypeVar("Result")
_LOOK_S = 0.1
Stopped = Callable[[], bool]
Work = Callable[[Item, Stopped], Result]
"""Does one item and looks now and then whether the user wants an end."""

_stop = c_bool(False)
"""In a worker: whether the user wants an end. It has no lock, which one who dies might hold."""


class WorkFailed(RuntimeError):
    """A piece of work raised, or its process died.

    The text is the traceback, as not every exception can travel; of an OSError, what it says.
    """


def in_turn(
    work: Work[Item, Result], items: Iterable[Item], stopped: Stopped
) -> Iterator[tuple[Item, Result]]:
    """``work`` on one item after another, in this process, until ``stopped`` says so.

    Raises:
        WorkFailed: ``work`` raised.
    """
    for item in items:
        if stopped():
            return
        results, trouble = _guarded(work, item, stopped)
        if trouble:
            raise WorkFailed(trouble)
        yield item, results[0]


def at_once(
    work: Work[Item, Result], items: Sequence[Item], stopped: Stopped, jobs: int | None = None
) -> Iterator[tuple[Item, Result]]:
    """``work`` on ``jobs`` items at a time (None: one for each core), each in another process.

    Pairs come as they are done. Once ``stopped`` says so nothing more is begun, and what does not
    end within GRACE_S is cut short.

    Raises:
        WorkFailed: ``work`` raised, or its process died.
    """
    context = get_context("spawn")
    with kept_from_children(), safe_path():  # which a hang-up would end, and others would miss
        resource_tracker.ensure_running()
    stop = context.RawValue(c_bool, False)
    cores = os.cpu_count() or 1
    with ProcessPoolExecutor(jobs or cores, context, initializer=_begin, initargs=(stop,)) as pool:
        try:
            with kept_from_children(), safe_path():  # the first call starts all of them
                running = {pool.submit(_guarded, work, item, _stop_wanted): item for item in items}
            while running:
                done, _ = wait(running, timeout=0.2, return_when=FIRST_COMPLETED)
                for future in done:
                    item = running.pop(future)
                    try:
                        results, trouble = future.result()
                    except BrokenProcessPool:
                        raise WorkFailed("a worker's process died (out of memory?)") from None
                    if trouble:
                        raise WorkFailed(trouble)
                    yield item, results[0]
                if stopped():
                    return
        finally:
            stop.value = True
            pool.shutdown(cancel_futures=True)


def shown(
    console: Console, pairs: Iterable[tuple[Item, Result]], total: int, label: Callable[[Item], str]
) -> Iterator[tuple[Item, Result]]:
    """``pairs`` as they come, with a bar on ``console`` and the label of the one done last."""
    done = TextColumn("{task.description}", markup=False)
    columns = BarColumn(bar_width=24), MofNCompleteColumn(), done
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("", total=total)
        for item, result in pairs:
            bar.update(task, advance=1, description=label(item))
            yield item, result


def _guarded(work: Work[Item, Result], item: Item, stopped: Stopped) -> tuple[list[Result], str]:
    try:
        return [work(item, stopped)], ""
    except OSError as error:  # the machine's fault, not the code's
        return [], in_words(error)
    except Exception:
        return [], traceback.format_exc()


def _stop_wanted() -> bool:
    return _stop.value


def _begin(stop: c_bool) -> None:
    global _stop
    _stop = stop
    die_with_parent()
    threading.Thread(target=_cut_short, daemon=True).start()


def _cut_short() -> None:
    while not _stop_wanted():
        time.sleep(_LOOK_S)
    time.sleep(GRACE_S)
    os._exit(BROKEN)
