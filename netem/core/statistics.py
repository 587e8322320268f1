"""What became of a link's messages, in numbers."""

from collections import Counter, deque
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from formnet.netem.core.transit import CORRUPTED, DUPLICATED


class Fate(NamedTuple):
    """One copy of a message: which, when it was sent, when it arrived, its fate.

    ``arrived_ns`` is None for one that did not arrive.
    """

    sequence: int
    sent_ns: int
    arrived_ns: int | None
    fate: str


class LinkStatistics(NamedTuple):
    """One direction of one link, up to some instant.

    ``sent`` counts messages; ``delivered`` copies, duplicates too; ``lost`` copies
    by cause; ``in_flight`` copies whose fate is open. Delays in seconds, None if
    nothing arrived: ``delay_s`` has min, mean, p50, p95, p99 and max.
    ``jitter_s`` is the interarrival jitter of RFC 3550 (section 6.4.1) after the
    last arrival. ``longest_silence_s`` is the longest stretch without an arrival,
    from the first sending to the end.
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


class Tally:
    """Counts what becomes of a link's messages while it happens.

    Tell it of every message (:meth:`sent`) and of every copy, once: as it arrives, in
    the order of arrival, or as it is lost. Everything is exact but the quantiles of the
    delay, which go by the latest ``window`` arrivals (None: by all).
    """

    def __init__(self, window: int | None = None) -> None:
        self._sent = self._copies = 0
        self._first_ns: int | None = None
        self._latest_ns = 0
        self._fates: Counter[str] = Counter()
        self._delays_ns: deque[int] = deque(maxlen=window)
        self._least_ns, self._greatest_ns, self._sum_ns = 2**63, 0, 0
        self._jitter_ns = 0.0
        self._silence_ns = 0

    def sent(self, sent_ns: int, copies: int = 1) -> None:
        """A message was sent, in so many copies."""
        if self._first_ns is None:
            self._first_ns = self._latest_ns = sent_ns
        self._sent += 1
        self._copies += copies

    def lost(self, fate: str) -> None:
        """A copy was lost."""
        self._fates[fate] += 1

    def arrived(self, sent_ns: int, arrived_ns: int, fate: str) -> None:
        """A copy has arrived."""
        self._fates[fate] += 1
        delay_ns = arrived_ns - sent_ns
        if self._delays_ns:
            self._jitter_ns = next_jitter(self._jitter_ns, delay_ns - self._delays_ns[-1])
        self._delays_ns.append(delay_ns)
        self._sum_ns += delay_ns
        self._least_ns = min(self._least_ns, delay_ns)
        self._greatest_ns = max(self._greatest_ns, delay_ns)
        self._silence_ns = max(self._silence_ns, arrived_ns - self._latest_ns)
        self._latest_ns = arrived_ns

    def at(self, end_ns: int) -> LinkStatistics:
        """The statistics up to ``end_ns``."""
        lost = {
            fate.removeprefix("lost: "): count
            for fate, count in sorted(self._fates.items())
            if fate.startswith("lost: ")
        }
        delivered = sum(self._fates.values()) - sum(lost.values())
        waited_ns = 0 if self._first_ns is None else end_ns - self._latest_ns
        return LinkStatistics(
            sent=self._sent,
            delivered=delivered,
            duplicated=self._fates[DUPLICATED],
            corrupted=self._fates[CORRUPTED],
            in_flight=self._copies - delivered - sum(lost.values()),
            lost=lost,
            delay_s=self._delay_s(delivered) if delivered else None,
            jitter_s=self._jitter_ns / 1e9,
            longest_silence_s=max(self._silence_ns, waited_ns) / 1e9,
        )

    def _delay_s(self, delivered: int) -> dict[str, float]:
        delays_ns = sorted(self._delays_ns)
        mean = self._sum_ns / delivered / 1e9
        return {
            "min": self._least_ns / 1e9,
            "mean": mean,
            "p50": _quantile_s(delays_ns, 0.5),
            "p95": _quantile_s(delays_ns, 0.95),
            "p99": _quantile_s(delays_ns, 0.99),
            "max": self._greatest_ns / 1e9,
        }


def _quantile_s(delays_ns: Sequence[int], share: float) -> float:
    """A quantile of delays that ascend, interpolated between the two nearest; to NumPy's bit."""
    position = (len(delays_ns) - 1) * share
    index = int(position)
    part = position - index
    low = delays_ns[index] / 1e9
    high = delays_ns[min(index + 1, len(delays_ns) - 1)] / 1e9
    if part < 0.5:
        return low + (high - low) * part
    return high - (high - low) * (1.0 - part)


def summarise(fates: Iterable[Fate], end_ns: int) -> LinkStatistics:
    """The statistics of a link at ``end_ns``, of copies in any order."""
    tally = Tally()
    rows = list(fates)
    copies = Counter((row.sent_ns, row.sequence) for row in rows)
    for (sent_ns, _), count in sorted(copies.items()):
        tally.sent(sent_ns, count)
    arrivals = []
    for row in rows:
        if row.fate.startswith("lost"):
            tally.lost(row.fate)
        elif row.arrived_ns is not None and row.arrived_ns <= end_ns:
            arrivals.append((row.arrived_ns, row.sent_ns, row.fate))
    for arrived_ns, sent_ns, fate in sorted(arrivals):
        tally.arrived(sent_ns, arrived_ns, fate)
    return tally.at(end_ns)


def next_jitter(jitter: float, difference: float) -> float:
    """RFC 3550, section 6.4.1: J += (|D| − J)/16.

    D, the difference of the receivers' spacing and the senders', is the
    difference of two successive delays, in order of arrival.
    """
    return jitter + (abs(difference) - jitter) / 16.0
