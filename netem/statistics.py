"""What became of a link's messages, in numbers."""

from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from netem.link import CORRUPTED, DUPLICATED


class Fate(NamedTuple):
    """One copy of a message: when it was sent, when it arrives (None: lost), and its fate."""

    sent_ns: int
    arrived_ns: int | None
    fate: str


class LinkStatistics(NamedTuple):
    """One direction of one link, up to some instant.

    ``delivered`` counts copies, duplicates too; ``lost`` counts by cause;
    ``in_flight`` had not arrived yet. Delays in seconds, None if nothing
    arrived: ``delay_s`` has min, mean, p50, p95, p99 and max. ``jitter_s`` is
    the interarrival jitter of RFC 3550 (section 6.4.1) after the last arrival.
    ``longest_silence_s`` is the longest stretch without an arrival, from the
    first sending to the end.
    """

    sent: int
    delivered: int
    duplicated: int
    corrupted: int
    in_flight: int
    lost: dict[str, int]
    delay_s: dict[str, float] | None
    jitter_s: float
    longest_silence_s: float


def summarise(fates: Iterable[Fate], end_ns: int) -> LinkStatistics:
    """The statistics of a link at ``end_ns``."""
    rows = list(fates)
    counts = Counter(row.fate for row in rows)
    there = [row for row in rows if row.arrived_ns is not None and row.arrived_ns <= end_ns]
    arrived = sorted((row.arrived_ns or 0, row.sent_ns) for row in there)
    here = Counter(row.fate for row in there)
    times_ns = [min((row.sent_ns for row in rows), default=end_ns)]
    times_ns += [at for at, _ in arrived] + [end_ns]
    delays_ns = np.array([at - sent for at, sent in arrived], dtype=np.int64)
    return LinkStatistics(
        sent=len(rows) - counts[DUPLICATED],
        delivered=len(there),
        duplicated=here[DUPLICATED],
        corrupted=here[CORRUPTED],
        in_flight=sum(row.arrived_ns is not None for row in rows) - len(there),
        lost={
            fate.removeprefix("lost: "): count
            for fate, count in sorted(counts.items())
            if fate.startswith("lost: ")
        },
        delay_s=_delays(delays_ns / 1e9) if arrived else None,
        jitter_s=rfc3550_jitter(delays_ns) / 1e9,
        longest_silence_s=float(np.diff(times_ns).max(initial=0)) / 1e9,
    )


def rfc3550_jitter(delays_ns: Iterable[int]) -> float:
    """J += (|D| − J)/16 over successive delays in order of arrival; nanoseconds.

    D, the difference of the receivers' spacing and the senders', is the
    difference of two successive delays.
    """
    jitter, before = 0.0, None
    for delay in delays_ns:
        if before is not None:
            jitter += (abs(float(delay - before)) - jitter) / 16.0
        before = delay
    return jitter


def _delays(delays_s: "np.ndarray[tuple[int], np.dtype[np.float64]]") -> dict[str, float]:
    p50, p95, p99 = np.quantile(delays_s, [0.5, 0.95, 0.99])
    return {
        "min": float(delays_s.min()), "mean": float(delays_s.mean()), "p50": float(p50),
        "p95": float(p95), "p99": float(p99), "max": float(delays_s.max()),
    }  # fmt: skip
