"""Where two records of a run part: samples first, then messages, then extremes of the motion."""

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import Any, NamedTuple

from formnet.formation.records.rows import LinkRow, Sample
from formnet.formation.scenario.model import Scenario
from formnet.lab.runs.recording import Collected
from formnet.netem.settings.timeline import NEVER


class Difference(NamedTuple):
    """The first thing that differs: when, whose and what, and both values (None: missing)."""

    t_ns: int
    tick: int
    whose: str
    what: str
    first: object
    second: object

    def __str__(self) -> str:
        """For people."""
        return (
            f"t = {self.t_ns / 1e9:.9g} s (tick {self.tick}), {self.whose}, {self.what}: "
            f"{_words(self.first)} and {_words(self.second)}"
        )


class Differences(NamedTuple):
    """How two records of a run compare.

    ``first`` is where samples or messages differ first, ``motion`` the first extreme that
    differs, in words; None where every bit is the same.
    """

    first: Difference | None
    motion: str | None

    @property
    def identical(self) -> bool:
        """Whether nothing differs."""
        return self.first is None and self.motion is None

    @property
    def in_words(self) -> list[str]:
        """What differs, in words."""
        found = [] if self.first is None else [f"first at {self.first}"]
        return found if self.motion is None else [*found, f"motion, {self.motion}"]


def differences(first: Collected, second: Collected, until_ns: int = NEVER) -> Differences:
    """Compare the samples before ``until_ns`` (ns); of whole runs (NEVER) all that is recorded."""
    period_ns = first.scenario.clock.control_period_ns
    found = first_difference(
        before(first.samples, until_ns), before(second.samples, until_ns), period_ns
    )
    if until_ns != NEVER:  # what becomes of messages depends on what comes after
        return Differences(found, None)
    found = found or first_difference(first.sorted_link_rows, second.sorted_link_rows, period_ns)
    return Differences(found, other_extremes(first.motion, second.motion))


def before(samples: Sequence[Sample], until_ns: int) -> Sequence[Sample]:
    """The samples of instants before ``until_ns`` (ns)."""
    return (
        samples if until_ns == NEVER else [sample for sample in samples if sample.t_ns < until_ns]
    )


def without_gap(samples: Sequence[Sample], scenario: Scenario) -> tuple[int, int]:
    """Up to where (ns) no sample is missing that a run in virtual time has, and when the next is.

    A repetition goes no further than that: whatever duration a scenario gives, and whatever
    instants a table has, it takes as long as what was recorded did.
    """
    clock = scenario.clock
    period_ns = max(1, clock.broadcast_every) * clock.control_period_ns
    last_ns = samples[0].t_ns
    for sample in samples:
        if sample.t_ns > last_ns + period_ns:
            break
        last_ns = sample.t_ns
    return last_ns, last_ns + period_ns


def first_difference(
    first: Sequence[Sample] | Sequence[LinkRow],
    second: Sequence[Sample] | Sequence[LinkRow],
    period_ns: int,
) -> Difference | None:
    """Where two tables in the order of time differ first; None if every bit is the same.

    ``period_ns`` is that of control ticks.
    """
    pairs: zip_longest[Any] = zip_longest(first, second)
    for old, new in pairs:
        if _bits(old) != _bits(new):
            return _between(old, new, period_ns)
    return None


def other_extremes(first: Mapping[str, Any] | None, second: Mapping[str, Any] | None) -> str | None:
    """The first extreme of two motions that differs, in words; None if every bit is the same.

    Nothing is said of a motion that is not known: runs of older versions do not tell.
    """
    if first is None or second is None:
        return None
    for what in [*first, *(what for what in second if what not in first)]:
        one, other = first.get(what), second.get(what)
        if _bits(one) != _bits(other):
            return f"{what}: {_bits(one)} and {_bits(other)}"
    return None


def _between(
    old: Sample | LinkRow | None, new: Sample | LinkRow | None, period_ns: int
) -> Difference:
    """How two rows differ, one of which may be missing."""
    if old is not None and new is not None and _key(old) != _key(new):
        if _key(old) < _key(new):
            new = None
        else:
            old = None
    some = new if old is None else old
    assert some is not None
    t_ns = some[0]
    tick = t_ns // period_ns
    if old is None or new is None:
        return Difference(t_ns, tick, _whose(some), "the whole row", old, new)
    what = next(
        name for name, a, b in zip(old._fields, old, new, strict=True) if _bits(a) != _bits(b)
    )
    return Difference(t_ns, tick, _whose(old), what, getattr(old, what), getattr(new, what))


def _bits(value: object) -> str:
    """The same for the same bits: numbers written so that they can be read back (NaN, too).

    ``==`` would take 0.0 for -0.0, and NaN for something that differs from itself.
    """
    return repr(value)


def _key(row: Sample | LinkRow) -> tuple[int, ...]:
    """What a row is about."""
    if isinstance(row, Sample):
        return row.t_ns, row.robot
    return row.t_sent_ns, row.source, row.destination, row.sequence


def _whose(row: Sample | LinkRow) -> str:
    if isinstance(row, Sample):
        return f"robot {row.robot}"
    return f"message {row.sequence} from {row.source} to {row.destination}"


def _words(value: object) -> str:
    if value is None:
        return "nothing"
    return "something" if isinstance(value, tuple) else repr(value)
