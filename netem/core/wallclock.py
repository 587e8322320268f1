"""Links on the wall clock: one thread that delivers when a copy is due, never earlier.

The thin shell around the pure :class:`netem.core.link.Link`; virtual time needs none.
"""

import ctypes
import heapq
import itertools
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from formnet.netem.core.link import Link
from formnet.netem.core.transit import Transit

_WATCH_NS = 100_000
"""From so long before an instant on the thread watches the clock: the kernel wakes it late."""
_LONGEST_WAIT_S = 3600.0


class ClockClosed(RuntimeError):
    """A message came after the end."""


class WallClock:
    """Carries messages over links in real time, which begins at 0 with this object.

    ``deliver(link, copy)`` is called on one thread of this object's, in order of
    due times; it must not block for long. An exception in it stops the
    delivery and is raised again by :meth:`close`. Use as a context
    manager, or call :meth:`close`.

    Attributes:
        lock: held whenever a link is sent on or delivers; hold it to change or cut one.
    """

    def __init__(self, deliver: Callable[[Link, Transit], None]) -> None:
        self._deliver = deliver
        self._origin_ns = time.monotonic_ns()
        self.lock = threading.RLock()
        self._changed = threading.Condition(self.lock)
        self._due: list[tuple[int, int, Link]] = []  # when, order, link with something due then
        self._order = itertools.count()
        self._closing = False
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="netem wall clock", daemon=True)
        self._thread.start()

    def __enter__(self) -> "WallClock":
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        self.close(drain=kind is None)

    @property
    def running(self) -> bool:
        """Whether it still delivers."""
        return self._thread.is_alive()

    def now_ns(self) -> int:
        """Nanoseconds since this object was made: the time of its links."""
        return time.monotonic_ns() - self._origin_ns

    def send(
        self, link: Link, sequence: int, payload: bytes, *, kind: str = "", note: Any = None
    ) -> list[Transit]:
        """Put a message on ``link`` now; arguments and result are those of :meth:`Link.send`.

        Callable from any thread; messages of one link in sequence order.

        Raises:
            ClockClosed: the clock is closed.
        """
        with self._changed:
            if self._closing:
                raise ClockClosed("the wall clock is closed")
            copies = link.send(self.now_ns(), sequence, payload, kind=kind, note=note)
            for copy in copies:
                if not copy.lost:
                    first = not self._due or copy.due_ns < self._due[0][0]
                    heapq.heappush(self._due, (copy.due_ns, next(self._order), link))
                    if first:
                        self._changed.notify()
        return copies

    def close(self, *, drain: bool = True) -> None:
        """Stop: after all that is in flight has been delivered, or at once.

        Raises:
            Exception: what ``deliver`` raised.
        """
        with self._changed:
            self._closing = True
            self._changed.notify()
        if not drain:
            self.drop()
        self._thread.join()
        if self._error is not None:
            raise self._error

    def drop(self) -> None:
        """Deliver nothing more of what is in flight."""
        with self._changed:
            self._due.clear()
            self._changed.notify()

    def _run(self) -> None:
        wake_punctually()
        try:
            while self._deliver_next():
                pass
        except Exception as error:  # whatever the receiver raises
            with self._changed:
                self._error, self._closing = error, True

    def _deliver_next(self) -> bool:
        """Wait for the next delivery and make it (its copies are not held any longer then)."""
        found = self._wait()
        if found is None:
            return False
        link, copies = found
        for copy in copies:
            self._deliver(link, copy)
        return True

    def _wait(self) -> tuple[Link, list[Transit]] | None:
        """The next link with something due, and that; None at the end."""
        with self._changed:
            while True:
                while self._due and not _has_due(*self._due[0]):
                    heapq.heappop(self._due)  # a cut has lost it
                if not self._due:
                    if self._closing:
                        return None
                    self._changed.wait()
                    continue
                left_ns = self._due[0][0] - self.now_ns()
                if left_ns > _WATCH_NS:
                    self._changed.wait(min((left_ns - _WATCH_NS) / 1e9, _LONGEST_WAIT_S))
                    continue
                if left_ns > 0:
                    self._changed.release()
                    time.sleep(0)
                    self._changed.acquire()
                    continue
                due_ns, _, link = heapq.heappop(self._due)
                return link, link.deliver(due_ns)


def _has_due(due_ns: int, _order: int, link: Link) -> bool:
    return link.next_due_ns is not None and link.next_due_ns <= due_ns


def wake_punctually() -> None:
    """Have the kernel wake this thread on time: by default it may lag 50 µs (prctl(2))."""
    if sys.platform == "linux":
        pr_set_timerslack = 29
        ctypes.CDLL(None).prctl(pr_set_timerslack, 1)
