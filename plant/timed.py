"""All robots' bodies in continuous time, as a pure core: what :mod:`plant.world` is to ticks.

Nobody waits for anybody. Each body moves under its newest drive from the instant at which that
came; a drive older than ``plant.drive_timeout_s`` no longer counts and the robot brakes. The
caller says what time it is; every robot is sampled at exactly the recorded instants.
"""

import math

from formnet.formation.briefing.plan import Plan
from formnet.formation.plan.roster import Happening, Roster
from formnet.formation.records.rows import Sample
from formnet.formation.wire.state import State, finite
from formnet.netem.files.tables import nanoseconds
from formnet.plant.body import Body, braked, driven, left_alone, steered
from formnet.plant.extremes import Extremes
from formnet.plant.world import BAD_COMMAND, BAD_STATE, Diverged, diverged


class _Track:
    """One robot's motion up to ``t_ns``."""

    def __init__(self, body: Body, state: State) -> None:
        self.body = body
        self.state = state
        self.t_ns = 0
        self.drive: tuple[float, float] | None = None
        self.stale_ns = 0  # until when the drive counts
        self.tick = 0  # the next one that it comes to


class TimedWorld:
    """Feed it drives and the time; it says where everybody is.

    Attributes:
        diverged: the first robot whose command, or where it led, was not finite.
        extremes: those of the motion, over the ticks to which everybody has come.
    """

    def __init__(self, plan: Plan) -> None:
        self._ids = list(plan.ids)
        self.diverged: Diverged | None = None
        self._roster: Roster = plan.roster()
        self._control_ns = plan.clock.control_period_ns
        self._sample_ns = plan.clock.broadcast_period_ns
        self._ticks = plan.ticks
        self._end_ns = self._ticks * self._control_ns
        self._sample_every = plan.clock.broadcast_every
        self._timeout_ns = nanoseconds(plan.plant.drive_timeout_s)
        self._plant = plan.plant
        self._dynamic = plan.law.level == "dynamic"
        self._tracks = {
            robot: _Track(Body.of(plan.vehicles[robot]), plan.starts[robot]) for robot in self._ids
        }
        self._happenings: list[Happening] = self._roster.happenings()
        self.extremes = Extremes(self._ids, dynamic=self._dynamic)
        self._there: dict[int, dict[int, State]] = {}  # by tick, then by robot
        self._rows: dict[int, dict[int, Sample]] = {}  # by number of sample, then by robot
        self._complete = 0  # the next sample that not everybody has
        self._next_ns = 0  # when the next one is due

    @property
    def end_ns(self) -> int:
        """When the run is over."""
        return self._end_ns

    def up(self, robot: int, t_ns: int) -> bool:
        """Whether ``robot`` takes part at ``t_ns``."""
        return self._roster.up(robot, t_ns // self._control_ns)

    def next_ns(self) -> int:
        """When the next sample is due, or the next thing that is planned."""
        planned = self._happenings[:1]
        return min([self._next_ns, *(some.tick * self._control_ns for some in planned)])

    def measure(self, robot: int, t_ns: int) -> State:
        """Where ``robot`` is at ``t_ns`` (or at what was asked last, if that is later)."""
        track = self._tracks[robot]
        self._advance(robot, track, min(t_ns, self._end_ns))
        return track.state

    def drive(self, robot: int, t_ns: int, first: float, second: float) -> None:
        """``robot`` applies these from ``t_ns`` on (see :class:`formation.wire.messages.Drive`)."""
        track = self._tracks[robot]
        self._advance(robot, track, min(t_ns, self._end_ns))
        if not (math.isfinite(first) and math.isfinite(second)):
            self._diverge(robot, track.t_ns, BAD_COMMAND)
            return
        track.drive, track.stale_ns = (first, second), track.t_ns + self._timeout_ns
        if self.diverged is None:
            self.extremes.asked(track.t_ns, robot, first, second)

    def advance(self, t_ns: int) -> list[Happening]:
        """Move everybody up to ``t_ns``; returns what was planned until then."""
        t_ns = min(t_ns, self._end_ns)
        for robot, track in self._tracks.items():
            self._advance(robot, track, t_ns)
        self._next_ns = min((t_ns // self._sample_ns + 1) * self._sample_ns, self._end_ns)
        happened = []
        while self._happenings and self._happenings[0].tick * self._control_ns <= t_ns:
            happened.append(self._happenings.pop(0))
        return happened

    def lose(self, robot: int, t_ns: int) -> int:
        """``robot`` is gone, unplanned; returns from which tick of the control period on."""
        tick = t_ns // self._control_ns + 1
        self._roster.lose(robot, tick)
        return tick

    def take_samples(self) -> list[Sample]:
        """Samples that everybody has, since the last call, in the order of time and file."""
        taken: list[Sample] = []
        while len(self._rows.get(self._complete, ())) == len(self._ids):
            rows = self._rows.pop(self._complete)
            taken.extend(rows[robot] for robot in self._ids)
            self._complete += 1
        return taken

    def _advance(self, robot: int, track: _Track, t_ns: int) -> None:
        """In pieces in which nothing changes, and which end at every control tick."""
        while True:
            if track.t_ns == track.tick * self._control_ns:
                self._arrive(robot, track)
            if track.t_ns >= t_ns or self.diverged is not None:
                return
            until_ns = min(t_ns, track.tick * self._control_ns)
            if track.drive is not None and track.stale_ns > track.t_ns:
                until_ns = min(until_ns, track.stale_ns)
            reached = self._moved(robot, track, (until_ns - track.t_ns) * 1e-9)
            if not finite(reached):
                self._diverge(robot, until_ns, BAD_STATE)
            track.state, track.t_ns = reached, until_ns

    def _arrive(self, robot: int, track: _Track) -> None:
        """``robot`` has come to a control tick: note where it is."""
        tick = track.tick
        track.tick += 1
        if tick % self._sample_every == 0 or tick == self._ticks:
            self._take(robot, track, -(-tick // self._sample_every))  # the last is at the end
        if self.diverged is not None:
            return
        there = self._there.setdefault(tick, {})
        there[robot] = track.state
        if len(there) == len(self._ids):
            self.extremes.at(track.t_ns, self._there.pop(tick))

    def _moved(self, robot: int, track: _Track, seconds: float) -> State:
        applied = self._applied(robot, track)
        if applied is not None:
            if self._dynamic:
                return driven(track.body, track.state, applied[0], applied[1], seconds)
            return steered(track.state, applied[0], applied[1], seconds)
        if not self.up(robot, track.t_ns):
            body = track.body if self._dynamic else None
            return left_alone(self._plant, body, track.state, seconds)
        return braked(track.state, seconds, self._plant.brake_time_s)

    def _applied(self, robot: int, track: _Track) -> tuple[float, float] | None:
        """What drives a robot now; None if its brakes (or nothing) do."""
        if not self.up(robot, track.t_ns):
            track.drive = None  # one that comes back begins anew
            coasts = self._dynamic and self._plant.body_on_failure == "coast"
            return (0.0, 0.0) if coasts else None
        return track.drive if track.t_ns < track.stale_ns else None

    def _take(self, robot: int, track: _Track, sample: int) -> None:
        applied = self._applied(robot, track) if self._dynamic else None
        torques: tuple[float | None, float | None] = (None, None)
        if applied is not None:
            torques = track.body.saturated(applied[0]), track.body.saturated(applied[1])
        row = Sample(track.t_ns, robot, *track.state, *torques)
        self._rows.setdefault(sample, {})[robot] = row

    def _diverge(self, robot: int, t_ns: int, why: str) -> None:
        if self.diverged is None:
            states = {other: track.state for other, track in self._tracks.items()}
            self.diverged = diverged(t_ns, states, robot, why)
