"""Another clock than one's own, from messages that go there and back."""

from collections import deque
from collections.abc import Iterable
from statistics import quantiles


class RemoteClock:
    """Estimates a remote clock from exchanges, as NTP does (RFC 5905, section 8).

    A request leaves at ``sent_ns`` and its answer comes at ``received_ns``, both by the own
    clock; the answer says what time it was there in between. Half the round trip bounds the
    error, whatever the two directions take, so of the latest exchanges the one with the
    shortest round trip counts (section 10's minimum filter), worse by ``drift`` for its age.
    """

    def __init__(self, window_ns: int = 2_000_000_000, drift: float = 1e-4) -> None:
        self._window_ns = window_ns
        self._drift = drift
        self._exchanges: deque[tuple[int, int, int]] = deque()  # received, offset, error
        self._now_ns = 0

    @property
    def known(self) -> bool:
        """Whether there was an exchange."""
        return bool(self._exchanges)

    def exchange(self, sent_ns: int, remote_ns: int, received_ns: int) -> None:
        """An exchange; ``remote_ns`` is what the other clock said in between."""
        error_ns = (received_ns - sent_ns + 1) // 2
        offset_ns = remote_ns - (sent_ns + received_ns) // 2
        exchanges = self._exchanges
        while exchanges and self._error_ns(exchanges[-1], received_ns) >= error_ns:
            exchanges.pop()  # it will never be the best again
        exchanges.append((received_ns, offset_ns, error_ns))
        while exchanges[0][0] < received_ns - self._window_ns:
            exchanges.popleft()

    def _error_ns(self, exchange: tuple[int, int, int], now_ns: int) -> float:
        return exchange[2] + self._drift * (now_ns - exchange[0])

    def offset_ns(self) -> int:
        """The remote clock minus the own one."""
        return self._exchanges[0][1]

    def uncertainty_ns(self, now_ns: int) -> int:
        """By how much :meth:`offset_ns` may be wrong at ``now_ns`` by the own clock."""
        return round(self._error_ns(self._exchanges[0], now_ns))

    def at(self, own_ns: int) -> int:
        """The remote time at ``own_ns``; never less than what was said before."""
        self._now_ns = max(self._now_ns, own_ns + self.offset_ns())
        return self._now_ns


class Spread:
    """How values spread: median, 99th percentile and maximum; the first two of the latest."""

    def __init__(self, window: int = 1_000_000) -> None:
        self._latest: deque[float] = deque(maxlen=window)
        self._max = -float("inf")
        self.count = 0

    def add(self, value: float) -> None:
        """One more."""
        self._latest.append(value)
        self.count += 1
        if value > self._max:
            self._max = value

    def summary(self) -> list[float]:
        """[p50, p99, max]; empty without values."""
        if not self._latest:
            return []
        return [*percentiles(self._latest, (50, 99)), self._max]


def percentiles(values: Iterable[float], wanted: Iterable[int]) -> list[float]:
    """Percentiles with linear interpolation between values (``numpy``'s default)."""
    cuts = sorted(values)
    cuts = cuts * 2 if len(cuts) == 1 else cuts
    found = quantiles(cuts, n=100, method="inclusive")
    return [found[percent - 1] for percent in wanted]
