"""The plant's process: a session, a record stream, and a host in lockstep or in real time."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO

import zenoh

from formnet.formation.briefing.plan import Plan
from formnet.formation.records.events import Event
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.stream import Streamed, writer
from formnet.formation.wire import bus
from formnet.formation.wire.plant_bus import ZenohPlantBus
from formnet.formation.wire.process import on_stop
from formnet.formation.wire.security import PLANT, Credentials
from formnet.plant.lockstep import LockstepPlant
from formnet.plant.realtime import RealtimePlant
from formnet.plant.watch import Watched


def main(
    plan: Plan,
    *,
    run: str,
    record: str | None,
    stop_at_end_of_input: bool,
    listen: str | None = None,
    connect: str | None = None,
    start_patience_s: float | None = None,
    keys: Path | None = None,
    plaintext: bool = False,
    lease_s: float = bus.LONG_LEASE_S,
) -> int:
    """Host a run; returns 0, or 3 if the run did not end by itself.

    Robots meet the plant where it listens, or at the Zenoh router at ``connect``, of which it
    is a client like them. ``record`` is the file for the record stream, ``-`` for standard output;
    without it, only what happens is told, on standard error. ``start_patience_s`` is as in
    :class:`plant.host.Host`, ``keys``, ``plaintext`` and
    ``lease_s`` as in :func:`formation.wire.bus.session`.

    Raises:
        BusError: ``listen`` or ``connect`` cannot be used, or must not be in this way.
        KeysError: the plant's keys are not in ``keys``.
        OSError: ``record`` exists already or cannot be written.
    """
    credentials = None if keys is None else Credentials(keys, PLANT)
    kind = RealtimePlant if plan.clock.mode == "realtime" else LockstepPlant
    opened = bus.session(
        listen=listen,
        connect=connect,
        credentials=credentials,
        robots=list(plan.ids),
        plaintext=plaintext,
        lease_s=lease_s,
        blocking=kind.blocking,
        stall_s=_stall_s(plan),
    )
    if credentials is not None:
        zenoh.init_log_from_env_or("warn")  # who is not let in, and why, to standard error
    with ExitStack() as recording:
        sink = recording.enter_context(_sink(record))  # first: it takes stray prints away
        with opened as session:
            watched = Watched(session, plan, run)

            def take(record: Streamed) -> None:
                sink(record)
                watched.take(record)

            own = ZenohPlantBus(session, run, blocking=kind.blocking)
            host = kind(own, plan, take, start_patience_s)
            on_stop(host.stop, at_end_of_input=stop_at_end_of_input)
            outcome = host.run()
            recording.close()  # first: who reads it need not wait for who watches
            watched.take_leave()
    return 0 if outcome.kind in ("completed", "diverged") else 3


def _stall_s(plan: Plan) -> float | None:
    """How long a client may take nothing: well below the patience with robots that wait for it.

    In real time, messages to a robot that is paused as planned are dropped for as long as it is.
    """
    paused = any(some.verb == "pause" for some in plan.roster().happenings())
    if paused and plan.clock.mode == "realtime":
        return None
    return min(bus.STALL_S, plan.run.patience_s / 4.0)


@contextmanager
def _sink(record: str | None) -> Iterator[Callable[[Streamed], None]]:
    if record is None:
        yield _tell
        return
    if record == "-":  # the real standard output; stray prints go to standard error
        stream: IO[bytes] = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    else:
        stream = open(record, "xb")  # noqa: SIM115
    with stream:
        yield writer(stream)


def _tell(record: Streamed) -> None:
    if isinstance(record, Event | Outcome):
        t_s, what = record.t_ns / 1e9, " ".join(filter(None, (record.name, record.words)))
        print(f"t = {t_s:.3f} s: {what}", file=sys.stderr)
