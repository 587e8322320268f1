"""For whoever watches a run: its record stream once more, on the bus.

Watching must not change a run. What is recorded goes out as it is, some forty messages a second,
and is dropped where a watcher does not keep up; who comes late asks for what it has missed:
the scenario and the events so far.
"""

import threading

import msgpack
import zenoh

from formation import bus
from formation.loading import dumps
from formation.record import Event, Outcome, Stir, Streamed, pack
from formation.scenario import Scenario


class Watched:
    """Offers run ``run`` on ``session``; a sink (:meth:`take`) beside the record's own."""

    def __init__(self, session: zenoh.Session, scenario: Scenario, run: str) -> None:
        keys = bus.Keys(run)
        self._scenario = dumps(scenario.model_copy(update={"hosts": None}))
        self._told: list[bytes] = []  # events so far, and the outcome
        self._lock = threading.Lock()
        self._publisher = bus.publisher(session, keys.watch, blocking=False)
        self._answers = session.declare_queryable(keys.history, self._answer)

    def take(self, record: Streamed) -> None:
        """Send one record to whoever watches."""
        if isinstance(record, Stir):
            return
        packed = pack(record)
        if isinstance(record, Event | Outcome):
            with self._lock:
                self._told.append(packed)
        self._publisher.put(packed)

    def _answer(self, query: zenoh.Query) -> None:
        with self._lock, query:
            query.reply(query.key_expr, msgpack.packb((self._scenario, self._told)))
