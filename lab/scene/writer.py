"""``run.rrd`` as the launcher writes it: by a process that draws while the run goes on.

Loading Rerun and drawing take half a second of a processor; the launcher only passes on what it
records, as a stream of msgpack objects (:func:`packed`, :class:`Reader`).
Rerun is not loaded here.
"""

import errno
import json
import os
import queue
import subprocess
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import msgpack
import numpy as np
from numpy.typing import NDArray

from formnet.formation.records.checked import Malformed
from formnet.formation.records.stream import Record, Stir, pack, unpack
from formnet.lab.judge.lyapunov import Curve
from formnet.lab.launch.interpreter import module

FILE = "run.rrd"
PATIENCE_S = 30.0
"""A process that takes and ends nothing for so long hangs."""
_EVERY_S = 0.2
"""How often records are passed on: to wake two threads for each would slow the run down."""


class Came(NamedTuple):
    """A record, and when it came (nanoseconds since 1970)."""

    record: Record
    wall_ns: int


class Lyapunov(NamedTuple):
    """V along a run: ``v`` (n,) at the instants ``t_s`` (n,), seconds."""

    t_s: NDArray[np.float64]
    v: NDArray[np.float64]


def packed(item: Came | Lyapunov) -> bytes:
    """A record or V, as it is in the stream."""
    match item:
        case Came():
            fields: tuple[Any, ...] = ("record", item.wall_ns, pack(item.record))
        case Lyapunov():
            fields = ("lyapunov", *(np.asarray(x, dtype="<f8").tobytes() for x in item))
    return msgpack.packb(fields)  # type: ignore[no-any-return]


class Reader:
    """Reads the stream of a run of ``robots`` (the scenario's, in its order), piece by piece."""

    def __init__(self, robots: Sequence[int]) -> None:
        self._robots = robots
        self._unpacker = msgpack.Unpacker(max_buffer_size=2**30)

    def take(self, piece: bytes) -> Iterator[Came | Lyapunov]:
        """What ``piece`` completes: records with the times when they came, and V.

        Raises:
            Malformed: it is something else.
        """
        self._unpacker.feed(piece)
        while True:
            try:
                fields = self._unpacker.unpack()
            except msgpack.OutOfData:
                return
            except Exception as error:  # msgpack raises many kinds; all mean the same here
                raise Malformed.at("stream", piece[:20], f"is not msgpack: {error!r}") from None
            yield self._read(fields)

    def _read(self, fields: Any) -> Came | Lyapunov:
        match fields:
            case ["record", int(wall_ns), bytes(data)] if 0 <= wall_ns < 2**63:
                record = unpack(data, self._robots)
                if not isinstance(record, Stir):
                    return Came(record, wall_ns)
            case ["lyapunov", bytes(t_s), bytes(v)] if len(t_s) == len(v) and len(v) % 8 == 0:
                return Lyapunov(*(np.frombuffer(x, dtype="<f8") for x in (t_s, v)))
        raise Malformed.at("stream", fields, "is neither a record with its time nor V")


class SceneWriter:
    """Has ``run.rrd`` written in the run folder ``folder``; a sink for any thread (:meth:`take`).

    ``scenario.toml`` must be there. The file is written by a process of its own, which draws what
    it has got and ends when its input does: also if this process is killed. What becomes of it
    never harms the run: if it dies or hangs, the file counts as not written (:meth:`close`).

    Raises:
        OSError: there is such a file already, or it cannot be made.
        ModuleNotFoundError: Rerun is not installed.
    """

    def __init__(self, folder: Path) -> None:
        if find_spec("rerun") is None:
            raise ModuleNotFoundError("No module named 'rerun'", name="rerun")
        self._file = folder / FILE
        self._file.open("xb").close()
        self._problem: OSError | None = None
        self._queue: queue.SimpleQueue[Came | Lyapunov] = queue.SimpleQueue()
        self._over = threading.Event()
        self._sent = 0
        self._child = subprocess.Popen(
            module("formnet.lab.scene.rrd", str(folder)),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C reaches the launcher alone
        )
        self._sender = threading.Thread(target=self._send, daemon=True)
        self._sender.start()

    def take(self, record: Record) -> None:
        """Take one record."""
        self._queue.put(Came(record, time.time_ns()))

    def make_room(self) -> None:
        """Take the file away: what is recorded is worth more than how it is shown."""
        self._problem = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._file))
        self._child.kill()
        self._child.wait()
        self._remove()

    def end(self, found: Curve | None) -> None:
        """Nothing more comes but V; the rest is written meanwhile."""
        if found is not None:
            self._queue.put(Lyapunov(found.t_s, found.v))
        self._over.set()

    def close(self) -> None:
        """Wait until all that came is written.

        Raises:
            OSError: the file could not be written, and is away.
        """
        self.leave()
        if self._problem is not None:
            self._remove()
            raise self._problem

    def leave(self) -> None:
        """Wait until what came is written, or cannot be."""
        self.end(None)
        while self._sender.is_alive():
            before = self._sent
            self._sender.join(PATIENCE_S)
            if self._sender.is_alive() and self._sent == before:
                self._give_up()
        try:
            self._child.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._give_up()
        assert self._child.stdout is not None
        if not self._child.stdout.closed:
            with self._child.stdout as report:
                said = report.read()
            if self._problem is None and self._child.returncode != 0:
                self._problem = self._reported(said)

    def _give_up(self) -> None:
        """It hangs."""
        self._problem = self._problem or OSError(
            errno.ETIMEDOUT,
            f"the process that writes it did nothing for {PATIENCE_S:g} s",
            str(self._file),
        )
        self._child.kill()
        self._child.wait()

    def _reported(self, said: bytes) -> OSError:
        """Why it ended as it did, from what it wrote on its standard output."""
        try:
            number, reason = json.loads(said)
            return OSError(int(number), str(reason), str(self._file))
        except (ValueError, TypeError):
            how = f"ended with exit code {self._child.returncode}"
            return OSError(errno.EIO, f"the process that writes it {how}", str(self._file))

    def _remove(self) -> None:
        with suppress(OSError):
            self._file.unlink()

    def _send(self) -> None:
        """Pass on what comes, until it ends or nobody takes it any more."""
        assert self._child.stdin is not None
        over = False
        with suppress(OSError), self._child.stdin as stream:
            while not over:
                over = self._over.wait(_EVERY_S)
                with suppress(queue.Empty):
                    while True:
                        stream.write(packed(self._queue.get_nowait()))
                        self._sent += 1
                stream.flush()
