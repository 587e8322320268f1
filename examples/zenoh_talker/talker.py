"""Two Zenoh programs that know nothing of formnet: one tells where it is, one hears it.

    python talker.py hear tcp/127.0.0.1:7447
    python talker.py tell tcp/127.0.0.1:7447

``hear`` listens there, ``tell`` connects; with a bridge between them (README.md) both listen.
"""

import argparse
import json
import time

import zenoh


def session(endpoint: str, listen: bool) -> zenoh.Session:
    """A session that meets others at ``endpoint`` alone: no multicast, no gossip."""
    config = {
        "listen": {"endpoints": [endpoint] if listen else []},
        "connect": {"endpoints": [] if listen else [endpoint]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


def tell(publisher: zenoh.Publisher, count: int, period_s: float) -> None:
    """Publish ``count`` poses, each with its number and when it was sent."""
    for number in range(count):
        publisher.put(f"{number} {time.monotonic_ns()} pose")
        time.sleep(period_s)


def hear(opened: zenoh.Session) -> None:
    """Say how many poses came and how late, once none has come for a second."""
    late_ms: list[float] = []

    def on_sample(sample: zenoh.Sample) -> None:
        _, sent_ns, _ = sample.payload.to_string().split()
        late_ms.append((time.monotonic_ns() - int(sent_ns)) / 1e6)

    with opened.declare_subscriber("rover/*/pose", on_sample):
        print("listening", flush=True)
        heard = 0
        while not late_ms or len(late_ms) > heard:
            heard = len(late_ms)
            time.sleep(1.0)
    print(f"heard {heard}, the median {sorted(late_ms)[heard // 2]:.1f} ms late")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("role", choices=["tell", "hear"])
    parser.add_argument("endpoint")
    parser.add_argument("--listen", action="store_true", help="tell: listen, too")
    asked = parser.parse_args()
    with session(asked.endpoint, asked.listen or asked.role == "hear") as opened:
        if asked.role == "hear":
            hear(opened)
        else:
            publisher = opened.declare_publisher("rover/1/pose")
            while not publisher.matching_status.matching:  # nobody hears it yet
                time.sleep(0.01)
            tell(publisher, count=200, period_s=0.01)
