"""A client with a valid certificate that does not read, in a run with keys.

``PYTHONPATH=tests/helpers python tests/bus/stalled.py`` has twenty runs disturbed with each of two
certificates, and prints a table.
"""

import argparse
import json
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import ExitStack, contextmanager
from itertools import cycle, islice
from pathlib import Path
from typing import NamedTuple

from processes import until

from formnet.formation.briefing.resolving import resolve
from formnet.formation.records import events
from formnet.formation.scenario.loading import load
from formnet.lab.launch.launch import Launch, Place, free_port
from formnet.lab.machines import keys
from formnet.lab.runs.recording import Recording, trajectory_sha256
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.lab.verdict.model import judge

CLIENT = """
import json, sys, zenoh
config, *keys = map(json.loads, sys.argv[1:])
with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
    kept = [session.declare_subscriber(key, lambda sample: None) for key in keys]
    list(session.liveliness().get("formnet/*/alive/plant"))  # answered once the hub has them
    print("up", flush=True)
    sys.stdin.read()
"""
SMALLEST_BUFFER = 4096
HEARD = {
    "monitor": ["formnet/*/broadcast/*", "formnet/*/watch"],
    "robot-3": ["formnet/*/to-robot/3", "formnet/*/broadcast/*"],
}


class Kind(NamedTuple):
    """Whose certificate; which transport it asks for; whether its process or the network stops."""

    who: str
    low_latency: bool
    stops: str  # "process" or "network"

    def __str__(self) -> str:
        transport = "low latency" if self.low_latency else "batching"
        return f"{self.who}, {transport}, {self.stops} stops"


KINDS = [
    Kind(who, low_latency, stops)
    for who in HEARD
    for low_latency in (True, False)
    for stops in ("process", "network")
]


class Deaf:
    """A relay on loopback in front of a hub, which at some time reads nothing more, and stays."""

    def __init__(self, endpoint):
        self._hub = ("127.0.0.1", int(endpoint.rpartition(":")[2]))
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tls/127.0.0.1:{self._listener.getsockname()[1]}"
        self.deaf = threading.Event()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._relay)
        self._thread.start()

    def close(self):
        self.deaf.set()
        self._over.set()
        self._thread.join()

    def _to_hub(self):
        hubs = []

        def connected():
            hubs.append(socket.socket())
            hubs[-1].setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALLEST_BUFFER)
            if hubs[-1].connect_ex(self._hub):
                hubs.pop().close()
            return hubs

        until(connected, "the hub")
        return hubs[0]

    def _relay(self):
        with self._listener:
            client, _ = self._listener.accept()
            with client, self._to_hub() as hub:
                while not self.deaf.is_set():
                    for end in select.select([client, hub], [], [], 0.05)[0]:
                        data = end.recv(65536)
                        if not data:
                            return
                        (client if end is hub else hub).sendall(data)
                self._over.wait()


@contextmanager
def client(kind, endpoint, folder):
    """A client of this kind, in a process of its own, which has stopped reading."""
    relay = Deaf(endpoint) if kind.stops == "network" else None
    config = {
        "mode": "client",
        "connect": {"endpoints": [relay.endpoint if relay else endpoint], "timeout_ms": 20_000},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "unicast": {"lowlatency": kind.low_latency, "qos": {"enabled": False}},
            "link": {
                "tx": {"lease": 3_600_000},
                "tls": {
                    "root_ca_certificate": str(folder / "ca.pem"),
                    "connect_private_key": str(folder / f"{kind.who}-key.pem"),
                    "connect_certificate": str(folder / f"{kind.who}.pem"),
                    "enable_mtls": True,
                    "so_rcvbuf": SMALLEST_BUFFER,
                },
            },
        },
    }
    arguments = map(json.dumps, [config, *HEARD[kind.who]])
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", CLIENT, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={name: value for name, value in os.environ.items() if name != "ZENOH_RUNTIME"},
    )
    try:
        assert process.stdout.readline() == b"up\n"
        if relay is not None:
            relay.deaf.set()
        else:
            process.send_signal(signal.SIGSTOP)
        yield
    finally:
        process.kill()
        process.communicate()
        if relay is not None:
            relay.close()


class Found(NamedTuple):
    """What became of a run: how it ended, who was disconnected and who was lost.

    On whom it waited for a second or longer, and its trajectory.
    """

    outcome: str
    disconnected: list[str]
    lost: list[int]
    waits: list[tuple[int, ...]]
    sha256: str
    wall_s: float


def run(place, kind, duration_s, copies=1):
    """A lockstep run with ``copies`` of such a client from its start, in the folder ``place``."""
    folder, out = place / "keys", place / "run"
    keys.make(folder, range(1, 6), [], 30)
    scenario = load(CONFIGS / "paper" / "section5-delay.toml", [f"duration_s={duration_s}"])
    recording = Recording(out, scenario)
    where = Place(endpoint=f"tls/127.0.0.1:{free_port()}", keys=folder)
    began = time.monotonic()
    with ExitStack() as stack:

        def stall(endpoint, _run):
            for _ in range(copies):
                stack.enter_context(client(kind, endpoint, folder))

        launch = Launch(resolve(scenario), "run", recording, out / "logs", where, stall)
        outcome = launch.wait(lambda: False)
    wall_s = time.monotonic() - began
    recording.save()
    judged = judge(recording, mode="distributed", wall_s=wall_s)
    return Found(
        outcome.kind,
        [item.who for item in judged.messages.disconnected],
        [e.robot for e in recording.events if isinstance(e, events.Lost)],
        [
            e.robots
            for e in recording.events
            if isinstance(e, events.Waiting) and e.what == "answer"
        ],
        trajectory_sha256(recording.samples),
        wall_s,
    )


def main() -> int:
    """For each certificate so many runs, in turn of its kinds; 1 if one did not end as it should."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=20, help="for each certificate")
    parser.add_argument("--duration", type=float, default=8.0, help="of each run, s")
    asked = parser.parse_args()
    held, slowest_s = Counter(), Counter()
    for who in HEARD:
        kinds = [kind for kind in KINDS if kind.who == who]
        for kind in islice(cycle(kinds), asked.times):
            with tempfile.TemporaryDirectory() as place:
                found = run(Path(place), kind, asked.duration)
            slowest_s[kind] = max(slowest_s[kind], found.wall_s)
            if (found.outcome, found.disconnected, found.lost) == ("completed", [who], []):
                held[kind] += 1
            print(f"{kind}: {found}", flush=True)
        for kind in kinds:
            print(f"{kind!s:40} held {held[kind]} times, slowest {slowest_s[kind]:.1f} s")
        print(f"{who}: {sum(held[kind] for kind in kinds)} of {asked.times}", flush=True)
    return int(held.total() != asked.times * len(HEARD))


if __name__ == "__main__":
    sys.exit(main())
