"""The bare Zenoh exchange: a lockstep tick's messages with nothing computed.

A hub process stands for the plant and one client process for each robot, with
formnet's own session settings, publishers, keys and message bytes, and with
formnet's style: the next messages are put right in the subscription's callback.
Messages are handed to Python as bytes, but nothing is decoded, checked,
integrated or recorded; they are counted, which suffices to know the tick,
because each path is ordered and blocks rather than drops. Per tick, as in
:mod:`agent.robot`: the hub puts a sense to every client; a client puts its
broadcast at every tenth tick, and its drive once it has counted both
neighbours' broadcasts of the latest broadcast tick; the hub goes on when it has
counted all drives. The hub's clock runs from the first sense to the last drive.

Before that, every path is proven by a message that came through it, repeated
until answered: a client says hello to the hub (the hub answers) and to its
neighbours, and reports ready when it has heard all three. Such messages are
one byte long, and no others are.

As a program: one of these processes; :func:`tick_ms` starts them all.
"""

import argparse
import secrets
import threading
import time
from functools import partial
from pathlib import Path

import zenoh

from benchmarks.children import reported
from benchmarks.wire import BROADCAST_EVERY, ring, wire
from formnet.formation.wire import bus
from formnet.formation.wire.process import on_stop
from formnet.lab.launch.launch import free_port

START_S, TICK_S = 30.0, 0.02
"""An exchange may take this long to start, and this long per tick, before it is given up."""
RETRY_S = 0.05
_HELLO, _READY = b"h", b"r"


class Hub:
    """Puts senses and counts drives."""

    def __init__(self, session: zenoh.Session, run: str, robots: int, ticks: int) -> None:
        keys = bus.Keys(run)
        ids = range(1, robots + 1)
        self._sense_bytes = wire(run).sense
        self._robots = robots
        self._left = ticks
        self._missing = robots
        self._lock = threading.Lock()
        self._silent = set(ids)
        self._ready = threading.Event()
        self._done = threading.Event()
        self._ended_s = 0.0
        self._to_robots = {robot: bus.publisher(session, keys.to_robot(robot)) for robot in ids}
        self._puts = [publisher.put for publisher in self._to_robots.values()]
        self._senders = {keys.from_robot(robot): robot for robot in ids}
        self._subscription = session.declare_subscriber(keys.from_robots, self._from_robot)

    def run(self) -> float:
        """Seconds from the first sense to the last drive."""
        self._ready.wait()
        started_s = time.perf_counter()
        self._sense()
        self._done.wait()
        return self._ended_s - started_s

    def _from_robot(self, sample: zenoh.Sample) -> None:
        if len(sample.payload.to_bytes()) == 1:
            self._greet(self._senders[str(sample.key_expr)], sample.payload.to_bytes())
            return
        with self._lock:
            self._missing -= 1
            if self._missing:
                return
            self._missing = self._robots
            self._left -= 1
            if self._left:
                self._sense()
                return
        self._ended_s = time.perf_counter()
        self._done.set()

    def _greet(self, robot: int, word: bytes) -> None:
        if word == _HELLO:
            self._to_robots[robot].put(_HELLO)
        else:
            self._silent.discard(robot)
            if not self._silent:
                self._ready.set()

    def _sense(self) -> None:
        for put in self._puts:
            put(self._sense_bytes)


class Client:
    """Answers every sense with a drive, as soon as its neighbours' broadcasts were counted."""

    def __init__(self, session: zenoh.Session, run: str, robot: int, robots: int) -> None:
        keys = bus.Keys(run)
        self._neighbours = ring(robot, robots)
        _, self._drive, self._broadcast, self._envelope = wire(run)
        self._tick = -1
        self._due = 0  # broadcasts that each neighbour has sent up to this tick
        self._counted = dict.fromkeys(self._neighbours, 0)
        self._pending = False
        self._lock = threading.Lock()
        self._heard: set[int] = set()
        self._acknowledged = False
        self._started = threading.Event()
        self._ended = threading.Event()
        self._to_hub = bus.publisher(session, keys.from_robot(robot))
        self._to_neighbours = bus.publisher(session, keys.broadcast(robot))
        self._subscriptions = [
            session.declare_subscriber(keys.to_robot(robot), self._on_sense),
            *(
                session.declare_subscriber(
                    keys.broadcast(neighbour), partial(self._on_broadcast, neighbour)
                )
                for neighbour in self._neighbours
            ),
        ]

    def stop(self) -> None:
        """End soon."""
        self._started.set()
        self._ended.set()

    def run(self) -> None:
        """Meet the others; the callbacks do the rest, until :meth:`stop`."""
        while not self._started.is_set():
            self._to_neighbours.put(_HELLO)
            if not self._acknowledged:
                self._to_hub.put(_HELLO)
            elif self._heard.issuperset(self._neighbours):
                self._to_hub.put(_READY)
            self._started.wait(RETRY_S)
        self._ended.wait()

    def _on_sense(self, sample: zenoh.Sample) -> None:
        if len(sample.payload.to_bytes()) == 1:
            self._acknowledged = True
            return
        with self._lock:
            self._tick += 1
            if self._tick == 0:
                self._started.set()
            if self._tick % BROADCAST_EVERY == 0:
                self._due += 1
                self._to_neighbours.put(self._broadcast, attachment=self._envelope)
            self._pending = True
            self._answer()

    def _on_broadcast(self, source: int, sample: zenoh.Sample) -> None:
        if len(sample.payload.to_bytes()) == 1:
            self._heard.add(source)
            return
        if sample.attachment is not None:
            sample.attachment.to_bytes()
        with self._lock:
            self._counted[source] += 1
            if self._pending:
                self._answer()

    def _answer(self) -> None:
        for count in self._counted.values():
            if count < self._due:
                return
        self._pending = False
        self._to_hub.put(self._drive)


def tick_ms(robots: int, ticks: int, logs: Path) -> float:
    """Run the exchange once; wall-clock milliseconds per tick.

    Raises:
        BenchmarkError: a process failed or the exchange got stuck.
    """
    # The name of a run is part of keys and broadcasts: as long as formnet's own.
    run = f"section5-delay-{secrets.token_hex(3)}"
    endpoint = f"tcp/{bus.LOOPBACK}:{free_port()}"
    common = ["benchmarks.bare", "--run", run, "--endpoint", endpoint, "--robots", str(robots)]
    commands = {"bare-hub": [*common, "--ticks", str(ticks)]}
    for robot in range(1, robots + 1):
        commands[f"bare-robot-{robot}"] = [*common, "--robot", str(robot)]
    return reported(commands, logs, limit_s=START_S + TICK_S * ticks) / ticks * 1e3


def main() -> None:
    """One process of the exchange: the hub, which prints its seconds, or client ``--robot``."""
    parser = argparse.ArgumentParser(description="One process of the bare Zenoh exchange.")
    parser.add_argument("--run", required=True)
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--robots", type=int, required=True)
    parser.add_argument("--ticks", type=int, default=0)
    parser.add_argument("--robot", type=int)
    asked = parser.parse_args()
    if asked.robot is None:
        with bus.session(listen=asked.endpoint) as session:
            hub = Hub(session, asked.run, asked.robots, asked.ticks)
            on_stop(lambda: None, at_end_of_input=True)
            print(hub.run(), flush=True)
    else:
        with bus.session(connect=asked.endpoint) as session:
            client = Client(session, asked.run, asked.robot, asked.robots)
            on_stop(client.stop, at_end_of_input=True)
            client.run()


if __name__ == "__main__":
    main()
