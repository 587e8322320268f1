"""Two plain Zenoh programs, a publisher and a subscriber, that know nothing of formnet.

``python -m benchmarks.zenoh_ends publish ...`` greets on ``<key>/hello`` until a line comes
on standard input, publishes ``--count`` messages and a delete, and ends with its input.
``... subscribe ...`` prints a line when it has heard a greeting and, as JSON, what it received:
after ``--count`` messages, or when its input ends.
"""

import argparse
import json
import sys
import threading
import time
from collections.abc import Callable

import zenoh

PAYLOAD_BYTES = 100


def main() -> None:
    """Be one of the two."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("role", choices=["publish", "subscribe"])
    parser.add_argument("key", help="what to publish on, or to subscribe to")
    parser.add_argument("--listen", metavar="ENDPOINT")
    parser.add_argument("--connect", metavar="ENDPOINT")
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--period", type=float, default=0.0, help="seconds; 0: at once")
    asked = parser.parse_args()
    config = {
        "mode": "peer",
        "listen": {"endpoints": [asked.listen] if asked.listen else []},
        "connect": {"endpoints": [asked.connect] if asked.connect else []},
        "scouting": {"multicast": {"enabled": False}},
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
        if asked.role == "publish":
            _publish(session, asked.key, asked.count, asked.period)
        else:
            _subscribe(session, asked.key, asked.count)


def _publish(session: zenoh.Session, key: str, count: int, period_s: float) -> None:
    told = threading.Event()
    _when_read(sys.stdin.readline, told)
    publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
    while not told.wait(0.05):
        session.put(f"{key}/hello", b"hello")
    start_ns = time.monotonic_ns()
    for number in range(count):
        due_ns = start_ns + int(number * period_s * 1e9)
        while (left_ns := due_ns - time.monotonic_ns()) > 0:
            time.sleep(left_ns / 1e9)
        payload = f"{number} {time.monotonic_ns()}".ljust(PAYLOAD_BYTES).encode()
        publisher.put(payload, encoding="text/plain;x", attachment=f"note {number}".encode())
    publisher.delete(attachment=b"gone")
    sys.stdin.read()


def _subscribe(session: zenoh.Session, key: str, count: int) -> None:
    received: list[dict[str, object]] = []
    greeted, complete = threading.Event(), threading.Event()
    _when_read(sys.stdin.read, complete)

    def on_sample(sample: zenoh.Sample) -> None:
        now_ns = time.monotonic_ns()
        if str(sample.key_expr).endswith("/hello"):
            greeted.set()
            return
        words = sample.payload.to_bytes().split()
        number, sent_ns = (int(words[0]), int(words[1])) if words else (None, None)
        received.append(
            {
                "key": str(sample.key_expr),
                "number": number,
                "kind": "PUT" if sample.kind == zenoh.SampleKind.PUT else "DELETE",
                "sent_ns": sent_ns,
                "arrived_ns": now_ns,
                "encoding": str(sample.encoding),
                "attachment": sample.attachment.to_string() if sample.attachment else None,
            }
        )
        if len(received) >= count:
            complete.set()

    with session.declare_subscriber(key, on_sample):
        greeted.wait()
        print("ready", flush=True)
        complete.wait()
    print(json.dumps(received), flush=True)


def _when_read(read: Callable[[], str], event: threading.Event) -> None:
    """Set ``event`` once ``read`` returns."""

    def wait() -> None:
        read()
        event.set()

    threading.Thread(target=wait, daemon=True).start()


if __name__ == "__main__":
    main()
