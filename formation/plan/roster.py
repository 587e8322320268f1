"""Who takes part in which tick: the spans in which robots are down, planned or not.

Everybody who keeps virtual time derives it from the scenario, so that nobody waits for
a robot that is down, and a run with faults stays exact to the bit. What nobody planned
(a process that dies) is decided by the plant, which tells the others: :meth:`Roster.lose`.
"""

from bisect import bisect_right
from collections.abc import Iterable, Mapping
from typing import Literal, NamedTuple

from formnet.netem.settings.timeline import NEVER

Verb = Literal["kill", "restart", "pause", "resume"]


class Span(NamedTuple):
    """A robot is down from tick ``begin`` to before tick ``end`` (NEVER: to the end).

    ``killed``: its process is gone and comes back, if it does, as a new one that
    remembers nothing; otherwise it is stopped and goes on where it was. ``lost``: it went
    down unplanned.
    """

    begin: int
    end: int
    killed: bool
    lost: bool = False


class Happening(NamedTuple):
    """What is done to ``robots`` at ``tick``."""

    tick: int
    verb: Verb
    robots: list[int]


class Roster:
    """The spans of every robot; each robot's ascend and do not overlap."""

    def __init__(self, spans: Mapping[int, Iterable[Span]]) -> None:
        self._spans = {robot: list(some) for robot, some in spans.items()}

    def span(self, robot: int, tick: int) -> Span | None:
        """The span in which ``robot`` is down at ``tick``; None if it is up."""
        spans = self._spans.get(robot, [])
        place = bisect_right(spans, tick, key=_begin)
        if not place or spans[place - 1].end <= tick:
            return None
        return spans[place - 1]

    def up(self, robot: int, tick: int) -> bool:
        """Whether ``robot`` takes part in ``tick``."""
        return self.span(robot, tick) is None

    def killed(self, robot: int, tick: int) -> bool:
        """Whether ``robot`` has no process at ``tick``."""
        span = self.span(robot, tick)
        return span is not None and span.killed

    def last_up(self, robot: int, tick: int, every: int) -> int:
        """The last multiple of ``every`` up to ``tick`` at which ``robot`` is up; -1: none is."""
        tick -= tick % every  # -1 becomes -every
        while tick >= 0:
            span = self.span(robot, tick)
            if span is None:
                return tick
            tick = (span.begin - 1) // every * every if span.begin else -1
        return -1

    def next_up(self, robot: int, tick: int) -> int:
        """The first tick from ``tick`` on in which ``robot`` takes part, or NEVER."""
        while tick < NEVER:
            span = self.span(robot, tick)
            if span is None:
                break
            tick = span.end
        return tick

    def next_down(self, robot: int, tick: int) -> int:
        """The first tick from ``tick`` on at which ``robot`` goes down, or NEVER."""
        return min(
            (span.begin for span in self._spans.get(robot, []) if span.begin >= tick),
            default=NEVER,
        )

    def lives(self, robot: int, tick: int) -> int:
        """How many processes of ``robot`` had ended by ``tick``."""
        return sum(span.killed and span.end <= tick for span in self._spans.get(robot, []))

    def happenings(self) -> list[Happening]:
        """All that is planned, by tick; kills before pauses before restarts before resumes."""
        found: dict[tuple[int, int], tuple[Verb, list[int]]] = {}

        def note(tick: int, order: int, verb: Verb, robot: int) -> None:
            if tick < NEVER:
                found.setdefault((tick, order), (verb, []))[1].append(robot)

        for robot, spans in self._spans.items():
            for span, following in zip(spans, [*spans[1:], None], strict=True):
                if not span.lost:
                    note(span.begin, *((0, "kill") if span.killed else (1, "pause")), robot)
                if following is not None and following.begin == span.end:
                    continue  # killed while paused
                note(span.end, *((2, "restart") if span.killed else (3, "resume")), robot)
        return [
            Happening(tick, verb, robots) for (tick, _), (verb, robots) in sorted(found.items())
        ]

    def lose(self, robot: int, tick: int) -> None:
        """``robot`` is gone from ``tick`` on: until its next planned restart, if there is one."""
        spans = self._spans.setdefault(robot, [])
        end = next((span.end for span in spans if span.killed and span.end > tick), NEVER)
        before = [
            span if span.end <= tick else span._replace(end=tick)
            for span in spans
            if span.begin < tick
        ]
        after = [span for span in spans if span.begin >= end]
        self._spans[robot] = [*before, Span(tick, end, killed=True, lost=True), *after]


def _begin(span: Span) -> int:
    return span.begin
