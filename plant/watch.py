"""For whoever watches a run: its record stream once more, on the bus.

Watching must not change a run. What is recorded goes out as it is, some forty messages a second,
numbered, and is dropped where a watcher does not keep up; who comes late asks for what it has
missed: the scenario and the events so far.
"""

import threading
import time
from typing import Any

import zenoh

from formnet.formation.briefing.plan import Plan
from formnet.formation.records.events import Event
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.stream import Stir, Streamed, pack
from formnet.formation.records.watching import History, pack_history, pack_numbered
from formnet.formation.wire import bus

LEAVE_S = 1.0
"""How long, after the run, watchers may take to hear of its end."""


class Watched:
    """Offers run ``run`` on ``session``; a sink (:meth:`take`) beside the record's own."""

    def __init__(self, session: zenoh.Session, plan: Plan, run: str) -> None:
        keys = bus.Keys(run)
        self._key = keys.history
        self._scenario = plan.scenario
        self._told: list[bytes] = []  # events so far, and the outcome
        self._number = 0  # of the next message
        self._lock = threading.Lock()
        self._publisher = bus.publisher(session, keys.watch, blocking=False, hurried=False)
        self._answers = session.declare_queryable(keys.history, self._answer)

    def take(self, record: Streamed) -> None:
        """Send one record to whoever watches."""
        if isinstance(record, Stir):
            return
        packed = pack(record)
        with self._lock:
            if isinstance(record, Event | Outcome):
                self._told.append(packed)
            number, self._number = self._number, self._number + 1
        self._publisher.put(pack_numbered(number, packed))

    def take_leave(self) -> None:
        """Wait until nobody watches any more, who has heard of the end: not for long."""
        deadline = time.monotonic() + LEAVE_S
        while self._is_watched() and time.monotonic() < deadline:
            time.sleep(0.01)

    def _is_watched(self) -> bool:
        status: Any = self._publisher.matching_status
        return bool(status.matching)

    def _answer(self, query: zenoh.Query) -> None:
        with self._lock:
            history = pack_history(History(self._scenario, self._told, self._number))
        with query:  # outside: who asks may be slow to take the answer
            query.reply(self._key, history)
