"""Joins two Zenoh networks through emulated links; applications notice nothing but the links.

A thin shell: two sessions and the wall clock around :class:`netem.bridge.lanes.Lanes`.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

import zenoh
from zenoh.handlers import Callback

from formnet.netem.bridge.lanes import Direction, Lane, LaneFile, Lanes, Request
from formnet.netem.core.link import Link
from formnet.netem.core.transit import Transit
from formnet.netem.core.wallclock import ClockClosed, WallClock

LISTEN = "listen:"
"""Before an endpoint: wait there for applications instead of connecting to one."""
QUERY_TIMEOUT_S = 60.0
"""How long replies to a query are waited for (who asked has a limit of its own)."""
_BACK: dict[Direction, Direction] = {"forward": "backward", "backward": "forward"}


class BridgeError(RuntimeError):
    """A network cannot be joined; the text says which endpoint and why."""


class _Answer(NamedTuple):
    """A reply on its way back to who asked; the query ends when the last of them is gone."""

    query: zenoh.Query
    reply: zenoh.Reply


class Bridge:
    """Carries what matches ``keys`` from ``first`` to ``second`` and back.

    Publications (put and delete) keep key, encoding, attachment, time stamp,
    priority, congestion control and express flag. A query is a message too,
    and so is each reply to it; one that is lost, or whose replies are, ends without them.

    Raises:
        BridgeError: ``first`` and ``second`` have a neighbour in common: every message
            would go round for ever.
    """

    def __init__(
        self, first: zenoh.Session, second: zenoh.Session, keys: str, file: LaneFile
    ) -> None:
        both = _neighbours(first) & _neighbours(second)
        if both:
            raise BridgeError(
                f"both ends lead to the same network (node {min(both)} is at both): "
                "--from and --to must be networks that do not reach each other"
            )
        self.clock = WallClock(self._deliver)
        self.lanes = Lanes(file)
        self.failures = 0  # what could not be handed on, because a session was closing, say
        self._towards: dict[Direction, zenoh.Session] = {"forward": second, "backward": first}
        remote = zenoh.Locality.REMOTE  # not what this bridge itself puts there
        self._declared: list[Any] = []
        sources: list[tuple[zenoh.Session, Direction]] = [(first, "forward"), (second, "backward")]
        for session, direction in sources:
            self._declared += [
                session.declare_subscriber(
                    keys, partial(self._on_sample, direction), allowed_origin=remote
                ),
                session.declare_queryable(
                    keys, partial(self._on_query, direction), allowed_origin=remote
                ),
            ]

    def close(self, *, drain: bool = True) -> None:
        """Take nothing more; deliver what is in flight, or drop it."""
        for declared in self._declared:
            declared.undeclare()
        self._declared = []
        self.clock.close(drain=drain)

    def do(self, request: Request) -> list[Lane]:
        """Change, cut or heal links in use; raises as :meth:`Lanes.do` does."""
        with self.clock.lock:
            return self.lanes.do(request, self.clock.now_ns())

    def settings(self) -> list[dict[str, Any]]:
        """Every link's settings as they are."""
        with self.clock.lock:
            return self.lanes.described()

    def statistics(self) -> list[dict[str, Any]]:
        """Every link's statistics up to now (see :class:`netem.core.statistics.LinkStatistics`)."""
        with self.clock.lock:
            now_ns = self.clock.now_ns()
            return [
                {
                    "link": lane.name,
                    "direction": lane.direction,
                    **lane.statistics(now_ns)._asdict(),
                }
                for lane in self.lanes
            ]

    # --- in: Zenoh's threads ------------------------------------------------------------

    def _on_sample(self, direction: Direction, sample: zenoh.Sample) -> None:
        self._send(direction, str(sample.key_expr), sample.payload, sample)

    def _on_query(self, direction: Direction, query: zenoh.Query) -> None:
        self._send(direction, str(query.key_expr), query.payload, query)

    def _on_reply(self, direction: Direction, open_: list[zenoh.Query], reply: zenoh.Reply) -> None:
        (query,), ok = open_, reply.ok
        key, payload = (query.key_expr, None) if ok is None else (ok.key_expr, ok.payload)
        if ok is None and reply.err is not None:
            payload = reply.err.payload
        self._send(_BACK[direction], str(key), payload, _Answer(query, reply))

    def _send(
        self, direction: Direction, key: str, payload: zenoh.ZBytes | None, item: object
    ) -> None:
        data = b"" if payload is None else payload.to_bytes()
        with self.clock.lock:
            lane = self.lanes.of(direction, key)
            kind, note = lane.kind_of(key), (lane, item)
            try:
                copies = self.clock.send(lane.link, lane.sequence + 1, data, kind=kind, note=note)
            except ClockClosed:  # a reply to a query that was delivered while closing
                self.failures += 1
                return
            lane.sequence += 1
            lane.note_sent(copies)

    # --- out: the clock's thread ----------------------------------------------------------

    def _deliver(self, _link: Link, copy: Transit) -> None:
        lane, item = copy.note
        with self.clock.lock:
            lane.note_arrived(copy, self.clock.now_ns())
        try:
            if isinstance(item, zenoh.Sample):
                _publish(self._towards[lane.direction], item, copy.payload)
            elif isinstance(item, zenoh.Query):
                self._ask(lane.direction, item, copy.payload)
            else:
                _answer(item, copy.payload)
        except zenoh.ZError:
            with self.clock.lock:
                self.failures += 1

    def _ask(self, direction: Direction, query: zenoh.Query, payload: bytes) -> None:
        open_ = [query]  # emptied after the last reply: Zenoh lets go of callbacks some time later
        self._towards[direction].get(
            query.selector,
            Callback(partial(self._on_reply, direction, open_), open_.clear, indirect=False),
            payload=None if query.payload is None else payload,
            encoding=query.encoding,
            attachment=query.attachment,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=QUERY_TIMEOUT_S,
            allowed_destination=zenoh.Locality.REMOTE,
        )


def _neighbours(session: zenoh.Session) -> set[str]:
    info = session.info
    return {str(zid) for zid in (info.zid(), *info.routers_zid(), *info.peers_zid())}


def _publish(session: zenoh.Session, sample: zenoh.Sample, payload: bytes) -> None:
    if sample.kind == zenoh.SampleKind.DELETE:
        session.delete(
            sample.key_expr,
            attachment=sample.attachment,
            timestamp=sample.timestamp,
            congestion_control=sample.congestion_control,
            priority=sample.priority,
            express=sample.express,
        )
    else:
        session.put(
            sample.key_expr,
            payload,
            encoding=sample.encoding,
            attachment=sample.attachment,
            timestamp=sample.timestamp,
            congestion_control=sample.congestion_control,
            priority=sample.priority,
            express=sample.express,
        )


def _answer(answer: _Answer, payload: bytes) -> None:
    query, sample, error = answer.query, answer.reply.ok, answer.reply.err
    if error is not None:
        query.reply_err(payload, encoding=error.encoding)
    elif sample is not None and sample.kind == zenoh.SampleKind.DELETE:
        query.reply_del(sample.key_expr, attachment=sample.attachment, timestamp=sample.timestamp)
    elif sample is not None:
        query.reply(
            sample.key_expr,
            payload,
            encoding=sample.encoding,
            attachment=sample.attachment,
            timestamp=sample.timestamp,
        )


@contextmanager
def session(endpoint: str) -> Iterator[zenoh.Session]:
    """A session of the network at ``endpoint``, closed at the end.

    With ``listen:`` before it, it is a router that applications connect to;
    otherwise a peer that connects to an application or router there.

    Raises:
        BridgeError: the endpoint is none, is taken, or nobody answers there within 10 s.
    """
    listen = endpoint.startswith(LISTEN)
    address = endpoint.removeprefix(LISTEN)
    config = {
        "mode": "router" if listen else "peer",
        "listen": {"endpoints": [address] if listen else []},
        "connect": {
            "endpoints": [] if listen else [address],
            "timeout_ms": 10_000,
            "exit_on_failure": True,
        },
        "scouting": {"delay": 0, "multicast": {"enabled": False}},
    }
    try:
        opened = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    except zenoh.ZError as error:
        what = f"listen on {address}" if listen else f"reach {address}"
        raise BridgeError(f"cannot {what}: {error}") from None
    try:
        yield opened
    finally:
        opened.close()  # type: ignore[no-untyped-call]
