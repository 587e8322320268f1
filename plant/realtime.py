"""The plant in real time: a thin shell around :class:`plant.timed.TimedWorld`.

Robots ask where they are and say what they do, whenever they like; both is dealt with on one
Zenoh thread, at once. The main thread takes samples when they are due and does everything that
goes wrong.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from functools import partial
from typing import ClassVar

from formnet.formation.briefing.plan import Plan
from formnet.formation.records import events
from formnet.formation.records.events import PlantTiming, Quantiles, RobotTiming
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.rows import LinkRows, Samples
from formnet.formation.records.stream import Stir, Streamed
from formnet.formation.wire.broadcast import HELLO, Envelope
from formnet.formation.wire.message_error import MessageError
from formnet.formation.wire.messages import (
    PROTOCOL,
    Ask,
    Begin,
    Drive,
    Join,
    Links,
    Measured,
    Message,
    Ready,
    Timing,
    encode,
)
from formnet.formation.wire.plant_bus import PlantBus
from formnet.formation.wire.sync import Spread
from formnet.netem.core.wallclock import wake_punctually
from formnet.netem.files.tables import nanoseconds
from formnet.plant.extremes import Extremes
from formnet.plant.host import START_PATIENCE_S, Ended, Host, Mailbox, Note, Vanished
from formnet.plant.timed import TimedWorld
from formnet.plant.witness import Witness

_REPORT_S = 0.1
_MOST_AHEAD = 10
"""By how many periods a robot's clock may be ahead before its questions are refused."""


class RealtimePlant(Host):
    """Time is the monotonic clock's, from the first tick on."""

    blocking: ClassVar[bool] = False

    def __init__(
        self,
        bus: PlantBus,
        plan: Plan,
        sink: Callable[[Streamed], None],
        start_patience_s: float | None = None,
        mailbox: Mailbox | None = None,
    ) -> None:
        super().__init__(bus, plan, sink, start_patience_s, mailbox)
        self._world = TimedWorld(plan)
        self._aborts = plan.run.on_unscheduled_loss == "abort"
        self._origin_ns = 0
        self._heard_s: dict[int, float] = {}  # when each robot said something last
        self._sensed: dict[int, tuple[int, int]] = {}  # each robot's last question, and when
        self._latency_s = {robot: Spread() for robot in plan.ids}  # sense to drive
        self._driven: dict[int, tuple[int, int]] = {}  # each robot's last drive: period, when
        self._lost_ns: dict[int, int] = {}  # when robots were lost
        self._before: dict[int, tuple[int, int]] = {}  # periods and missed ones of earlier lives
        self._period_ns = plan.clock.control_period_ns
        self._lateness_s = Spread()
        self._timings: dict[int, Timing] = {}
        self._worst_s: dict[int, float] = {}  # each robot's greatest uncertainty of time
        self._paused: set[int] = set()
        self._witness = Witness()
        self._witnessed: set[int] = set()  # whose broadcasts are listened to
        self._dead: set[int] = set()  # killed or lost, and not restarted
        for happening in plan.roster().happenings():
            if happening.verb == "kill":
                self._watch(happening.robots)

    def _t_ns(self) -> int:
        if not self._origin_ns:
            return 0
        return min(time.monotonic_ns() - self._origin_ns, self._world.end_ns)

    def _last_tick(self) -> int:
        return -1

    # --- the main thread -----------------------------------------------------------

    def _go(self) -> None:
        wake_punctually()
        self._origin_ns = time.monotonic_ns()
        self._running = True
        now_s = time.monotonic()
        for robot in self._plan.ids:
            self._heard_s[robot] = now_s
            self._tell(robot, Begin(0))
        report_at = now_s
        while True:
            with self._lock:
                next_ns = self._world.next_ns()
            wait_ns = self._origin_ns + next_ns - time.monotonic_ns()
            message = self._next(max(wait_ns, 0) / 1e9)
            if message is not None:
                self._handle(message)
            now_ns = time.monotonic_ns() - self._origin_ns
            if now_ns < next_ns:
                continue
            self._lateness_s.add((now_ns - next_ns) / 1e9)
            with self._lock:
                happened = self._world.advance(now_ns)
                over = now_ns >= self._world.end_ns or self._world.diverged is not None
            for happening in happened:
                self._happen(happening.verb, happening.robots)
            if over or time.monotonic() > report_at:
                report_at = time.monotonic() + _REPORT_S
                self._report()
                self._look_for_silent()
            if over:
                raise Ended(self._completed())

    def _happen(self, verb: str, robots: list[int]) -> None:
        self._sink(events.planned(verb, self._t_ns(), robots))
        if verb in ("kill", "restart"):
            self._joined.difference_update(robots)
        if verb == "kill":
            self._dead.update(robots)
        elif verb == "restart":
            for robot in robots:
                self._close(robot)
            self._bury(robots)
            self._dead.difference_update(robots)
        if verb == "pause":
            self._paused.update(robots)
        else:
            self._paused.difference_update(robots)
        patience_s = START_PATIENCE_S if verb == "restart" else 0.0
        for robot in robots:
            self._heard_s[robot] = time.monotonic() + patience_s

    def _look_for_silent(self) -> None:
        """Go on without those from whom nothing has come for too long."""
        patience_s, now_s = self._plan.run.patience_s, time.monotonic()
        t_ns = self._t_ns()
        for robot in self._plan.ids:
            if self._world.up(robot, t_ns) and now_s - self._heard_s[robot] > patience_s:
                self._lose(robot, f"did not ask or drive for {patience_s:g} s")

    def _handle(self, message: Note) -> None:
        if isinstance(message, Join):
            self._welcome(message)
        elif isinstance(message, Ready):
            if message.robot in self._joined:
                self._heard_s[message.robot] = time.monotonic()
                self._tell(message.robot, Begin(self._t_ns()))
        elif isinstance(message, Timing):
            self._note(message)
        elif isinstance(message, Links):
            own = [row for row in message.rows if row.destination == message.robot]
            with self._lock:
                self._witness.told(own)  # others' are refused
            super()._handle(message)
        elif isinstance(message, Vanished) and not self._world.up(message.robot, self._t_ns()):
            pass  # killed, as planned
        else:
            super()._handle(message)

    def _welcome(self, join: Join) -> None:
        """A robot that was restarted is there: it takes part as soon as it can."""
        robot = join.robot
        if join.protocol != PROTOCOL:
            self._refuse(robot, f"speaks protocol {join.protocol}, not {PROTOCOL}")
        elif robot in self._plan.ids and robot not in self._joined:
            self._joined.add(robot)
            self._sensed.pop(robot, None)
            self._driven[robot] = -1, self._t_ns()
            tick = self._t_ns() // self._plan.clock.control_period_ns
            self._tell(robot, self._brief(robot, tick, []))

    def _note(self, timing: Timing) -> None:
        if {len(timing.lateness_s), len(timing.transit_s)} - {0, len(fields(Quantiles))}:
            self._refuse(timing.robot, "tells of its timing in other numbers than p50, p99, max")
            return
        self._timings[timing.robot] = timing
        worst_s = max(self._worst_s.get(timing.robot, 0.0), timing.uncertainty_s)
        bound_s = self._plan.clock.sync_bound_s
        if worst_s > bound_s >= self._worst_s.get(timing.robot, 0.0):
            self._sink(events.ClockUncertain(self._t_ns(), timing.robot, worst_s, bound_s))
        self._worst_s[timing.robot] = worst_s

    def _miss(self, robots: list[int], outcome: Outcome) -> Outcome:
        """Who had not driven any more at the end is lost since then."""
        timeout_ns = nanoseconds(self._plan.plant.drive_timeout_s)
        for robot in robots:
            driven_ns = self._driven.get(robot, (-1, 0))[1]
            if not self._world.up(robot, outcome.t_ns) or outcome.t_ns - driven_ns <= timeout_ns:
                continue
            why = f"nothing came from it after t = {driven_ns / 1e9:.3f} s"
            if self._aborts and outcome.kind == "completed":
                return replace(outcome, kind="lost", robot=robot, reason=why)
            self._write_off(robot, why, outcome.t_ns, driven_ns)
        return outcome

    def _lose(self, robot: int, why: str) -> None:
        if self._aborts:
            raise Ended(self._outcome("lost", robot, why))
        t_ns = self._t_ns()
        self._write_off(robot, why, t_ns, t_ns)

    def _write_off(self, robot: int, why: str, t_ns: int, since_ns: int) -> None:
        """``robot`` is found to be lost at ``t_ns``, and to have been so since ``since_ns``."""
        with self._lock:
            tick = self._world.lose(robot, since_ns)
        self._lost_ns[robot] = t_ns
        self._joined.discard(robot)
        self._dead.add(robot)
        self._watch([robot])
        self._sink(events.Lost(t_ns, robot, why, tick))

    def _extremes(self) -> Extremes:
        return self._world.extremes

    def _wind_up(self) -> None:
        if self._paused:
            self._sink(Stir(tuple(sorted(self._paused)), True))

    def _report(self) -> None:
        with self._lock:
            samples = self._world.take_samples()
        self._sink(Samples(samples))
        self._bury(self._dead - self._connected)  # others may still be heard of

    def _watch(self, robots: Iterable[int]) -> None:
        """Count what is sent to ``robots``."""
        for robot in robots:
            neighbours = self._plan.neighbours_of[robot]
            with self._lock:
                self._witness.watch(robot, neighbours)
            for source in neighbours:
                if source not in self._witnessed:
                    self._bus.overhear(source, partial(self._on_broadcast, source))
            self._witnessed.update(neighbours)

    def _bury(self, robots: Iterable[int]) -> None:
        """Report the messages of which ``robots`` tell no more."""
        with self._lock:
            rows = [row for robot in robots for row in self._witness.lost_with(robot)]
        if rows:
            self._sink(LinkRows(rows))

    def _last_words(self) -> None:
        """What nobody has told of, and how well time was kept."""
        self._bury(self._plan.ids)
        robots = {}
        for robot, timing in sorted(self._timings.items()):
            periods, missed = self._counts(robot)
            robots[robot] = RobotTiming(
                periods=periods,
                missed=missed,
                sense_to_drive_s=Quantiles.of(self._latency_s[robot].summary()),
                woke_late_s=Quantiles.of(timing.lateness_s),
                transit_s=Quantiles.of(timing.transit_s),
                clock_offset_s=timing.offset_s,
                clock_uncertainty_s=self._worst_s[robot],
            )
        plant = PlantTiming(Quantiles.of(self._lateness_s.summary()))
        self._sink(events.Timing(self._t_ns(), plant, robots))

    def _close(self, robot: int) -> None:
        """A life of ``robot`` is over."""
        if robot in self._timings:
            self._before[robot] = self._counts(robot)
            self._timings[robot] = self._timings[robot]._replace(periods=0, missed=0)
        self._lost_ns.pop(robot, None)

    def _counts(self, robot: int) -> tuple[int, int]:
        """Control periods of all lives of ``robot``, and how many it missed: once lost, all."""
        timing = self._timings[robot]
        periods, missed = timing.periods, timing.missed
        if robot in self._lost_ns and robot in self._sensed:
            number, sensed_ns = self._sensed[robot]
            answered = max(periods, self._driven.get(robot, (-1, 0))[0] + 1)
            periods = number + 1 + (self._lost_ns[robot] - sensed_ns) // self._period_ns
            missed += periods - answered
        before = self._before.get(robot, (0, 0))
        return before[0] + periods, before[1] + missed

    def _completed(self) -> Outcome:
        diverged = self._world.diverged
        if diverged is None:
            return self._outcome("completed", None, "")
        return Outcome("diverged", diverged.t_ns, diverged.robot, diverged.reason)

    # --- the bus's threads -------------------------------------------------------------

    def _on_message(self, robot: int, message: Message) -> None:
        now_ns = time.monotonic_ns() - self._origin_ns
        if type(message) is Ask:
            with self._lock:
                self._on_ask(robot, message, now_ns)
        elif type(message) is Drive:
            with self._lock:
                self._on_drive(robot, message, now_ns)
        else:
            self._pass_on(robot, message)

    def _on_broadcast(self, source: int, envelope: bytes) -> None:
        try:
            note = Envelope.unpack(envelope)
        except MessageError:
            return  # its receivers refuse it
        if note.tick != HELLO and note.robot == source:
            with self._lock:
                self._witness.sent(source, note.sequence, note.tick)

    def _on_ask(self, robot: int, ask: Ask, now_ns: int) -> None:
        if not self._running or not self._world.up(robot, now_ns):
            return
        last = self._sensed.get(robot, (-1, 0))[0]
        if ask.robot != robot:
            self._refuse(robot, f"claims to be robot {ask.robot}")
        elif not last < ask.number <= now_ns // self._period_ns + _MOST_AHEAD:
            self._refuse(robot, "asks for a period that was or is not yet")
        else:
            state = self._world.measure(robot, now_ns)
            self._to_robots[robot](encode(Measured(ask.number, now_ns, state)))
            self._sensed[robot] = (ask.number, now_ns)
            self._heard_s[robot] = time.monotonic()

    def _on_drive(self, robot: int, drive: Drive, now_ns: int) -> None:
        if not self._running or not self._world.up(robot, now_ns):
            return
        number, sensed_ns = self._sensed.get(robot, (-1, 0))
        if drive.robot != robot:
            self._refuse(robot, f"claims to be robot {drive.robot}")
        elif drive.tick != number or number <= self._driven.get(robot, (-1, 0))[0]:
            self._refuse(robot, "a drive for another period than it asked for last")
        else:
            self._driven[robot] = number, now_ns
            self._world.drive(robot, now_ns, drive.right, drive.left)
            self._latency_s[robot].add((now_ns - sensed_ns) / 1e9)
