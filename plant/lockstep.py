"""The plant in lockstep: a thin shell around :class:`plant.world.World`.

Drives arrive on one thread of the bus, which integrates, and sends the next senses
when a tick is complete; the main thread does everything that goes wrong.
"""

import traceback
from collections.abc import Callable, Mapping
from typing import ClassVar

from formnet.formation.briefing.plan import Plan
from formnet.formation.records import events
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.rows import LinkRows, Samples
from formnet.formation.records.stream import Stir, Streamed
from formnet.formation.wire.messages import (
    KILL,
    CatchUp,
    Drive,
    End,
    Gone,
    Join,
    Meet,
    Message,
    Ready,
    Waiting,
    encode,
)
from formnet.formation.wire.plant_bus import PlantBus
from formnet.netem.settings.timeline import NEVER
from formnet.plant.blame import culprits
from formnet.plant.extremes import Extremes
from formnet.plant.host import START_PATIENCE_S, Ended, Host, Mailbox, Note, Turn, Vanished
from formnet.plant.world import World

_FLUSH_TICKS = 100
_MOST_UNREAD = 500
"""How many broadcasts may wait in the network's buffers (64 KiB, at least) for a paused robot."""


class Wait:
    """The main thread waits, while time stands still, for each of ``robots`` to do ``what``.

    Those in ``done`` have. Who takes too long is lost, unless it is ``dying`` anyway.
    """

    what: ClassVar[str]
    dying: ClassVar[bool] = False

    def __init__(self, robots: list[int], done: set[int]) -> None:
        self.robots = robots
        self.done = done

    def take(self, note: Note) -> bool:
        """Whether ``note`` says what this waits for; then it is dealt with."""
        raise NotImplementedError


class Leaving(Wait):
    """Those that are to be killed hand in their last reports."""

    what: ClassVar[str] = "say its last"
    dying: ClassVar[bool] = True

    def take(self, note: Note) -> bool:
        """The end of its reports, or of its connection."""
        if isinstance(note, End | Vanished) and note.robot in self.robots:
            self.done.add(note.robot)
            return True
        return False


class Dying(Wait):
    """Their processes end."""

    what: ClassVar[str] = "die"
    dying: ClassVar[bool] = True

    def take(self, note: Note) -> bool:
        """The end of its connection."""
        if isinstance(note, Vanished) and note.robot in self.robots:
            self.done.add(note.robot)
            return True
        return False


class Joining(Wait):
    """Processes that were started anew connect."""

    what: ClassVar[str] = "join"

    def take(self, note: Note) -> bool:
        """That it is here."""
        if isinstance(note, Join) and note.robot in self.robots:
            self.done.add(note.robot)
            return True
        return False


class Meeting(Wait):
    """Those that were started anew and their neighbours hear each other before ``tick``."""

    what: ClassVar[str] = "meet its neighbours"

    def __init__(self, robots: list[int], done: set[int], tick: int) -> None:
        super().__init__(robots, done)
        self.tick = tick

    def take(self, note: Note) -> bool:
        """That it hears all it had to meet; one for an earlier tick may still be on its way."""
        if isinstance(note, Ready):
            if note.tick == self.tick:
                self.done.add(note.robot)
            return True
        return False


class CatchingUp(Wait):
    """Paused robots take in what their neighbours have sent."""

    what: ClassVar[str] = "catch up"

    def take(self, note: Note) -> bool:
        """That it has."""
        if isinstance(note, CatchUp):
            self.done.add(note.robot)
            return True
        return False


class LockstepPlant(Host):
    """Owns virtual time: a tick is over once every robot that is up has answered it."""

    def __init__(
        self,
        bus: PlantBus,
        plan: Plan,
        sink: Callable[[Streamed], None],
        start_patience_s: float | None = None,
        mailbox: Mailbox | None = None,
    ) -> None:
        super().__init__(bus, plan, sink, start_patience_s, mailbox)
        self._world = World(plan)
        self._gone: list[Gone] = []  # who was lost, unplanned
        self._paused: set[int] = set()
        self._stir_at = NEVER  # the tick at which they have to take in what they have been sent
        self._begun = -1  # the tick whose senses were sent last
        self._puts: list[tuple[int, Callable[[bytes], None]]] = []  # to those who are up
        self._prepared: dict[int, bytes] = {}  # each robot's next sense, as soon as it is known

    def _t_ns(self) -> int:
        return self._world.t_ns

    def _last_tick(self) -> int:
        return self._world.tick - 1

    def _go(self) -> None:
        self._running = True
        self._turn()
        self._attend()

    def _extremes(self) -> Extremes:
        return self._world.extremes

    def _wind_up(self) -> None:
        if self._paused:  # to say their last they have to run
            self._sink(Stir(tuple(sorted(self._paused)), True))

    def _report(self) -> None:
        self._sink(Samples(self._world.take_samples()))
        self._sink(LinkRows(self._world.take_down_rows()))

    def _attend(self) -> None:
        """Record what comes in until the run ends (by raising).

        While nothing moves, complain, and in the end go on without those who do not answer.
        """
        world = self._world
        waiting: dict[int, Waiting] = {}  # what each robot has said last of whom it waits for
        patience, last_patience = self._patience(), self._patience(self._plan.run.patience_s)
        beat = self._patience()
        while True:
            tick, awaited = world.tick, world.awaited()
            if patience.lost(tick):
                self._complain("answer", self._culprits(awaited, waiting))
            if last_patience.lost((tick, awaited)):
                why = f"did not answer for {self._plan.run.patience_s:g} s"
                for robot in self._culprits(awaited, waiting):
                    self._lose(robot, why)
                waiting.clear()
            if beat.lost(None):  # the launcher takes a silent plant for one that hangs
                with self._lock:
                    self._flush()
            message = self._next()
            if isinstance(message, Waiting):
                waiting[message.robot] = message
            elif isinstance(message, Turn):
                self._turn()
            elif message is not None:
                self._handle(message)

    def _culprits(self, awaited: list[int], waiting: Mapping[int, Waiting]) -> list[int]:
        """On whom the tick waits; nobody, if it has just been answered."""
        if not awaited:
            return []
        up, hears = self._world.up, self._plan.neighbours_of
        return culprits(awaited, waiting, self._world.tick, up, hears)

    # --- robots that fail --------------------------------------------------------------

    def _turn(self) -> None:
        """See to what is planned for this tick, and begin it. Time stands still meanwhile."""
        world = self._world
        if world.tick <= self._begun and world.up and not world.finished:
            return  # it has begun already
        while not world.finished:
            restarted: list[int] = []
            for _, verb, robots in world.happenings if world.tick > self._begun else []:
                if verb == "kill":
                    self._dismiss(robots)
                self._sink(events.planned(verb, world.t_ns, robots))
                if verb == "kill":
                    self._paused.difference_update(robots)
                    self._wait(Dying(robots, set(robots) - self._connected))
                elif verb == "restart":
                    restarted = robots
                elif verb == "pause":
                    self._paused.update(robots)
                else:
                    self._paused.difference_update(robots)
            if restarted:
                self._welcome(restarted)
            if world.up:
                break
            world.idle()
        self._stir()
        self._begin_tick()

    def _stir(self) -> None:
        """Have paused robots take in what their neighbours have sent, before it is too much."""
        world = self._world
        if world.tick >= self._stir_at:
            stirred = sorted(self._paused & self._joined)
            self._sink(Stir(tuple(stirred), True))
            for robot in stirred:
                self._tell(robot, CatchUp(robot, world.tick - 1))
            self._wait(CatchingUp(stirred, set()))
            again = tuple(robot for robot in stirred if robot in self._paused)
            self._sink(Stir(again, False))
            self._stir_at = NEVER
        degree = max((len(self._plan.neighbours_of[r]) for r in self._paused), default=0)
        if degree:
            ticks = max(1, _MOST_UNREAD // degree) * self._plan.clock.broadcast_every
            self._stir_at = min(self._stir_at, world.tick + ticks)
        else:
            self._stir_at = NEVER

    def _begin_tick(self) -> None:
        """Send the senses of this tick, or end the run after the last."""
        with self._lock:
            if self._world.finished:
                self._inbox.put(self._completed())
                return
            self._begun = self._world.tick
            up = self._world.up
            self._puts = [(robot, self._to_robots[robot]) for robot in up]
            for robot, sense in self._world.senses():
                self._tell(robot, sense)

    def _dismiss(self, robots: list[int]) -> None:
        """Have robots that are to be killed hand in their last reports."""
        stopped = [robot for robot in robots if robot in self._paused]
        if stopped:  # to say their last they have to run
            self._sink(Stir(tuple(stopped), True))
        leaving = [robot for robot in robots if robot in self._joined]
        for robot in leaving:
            self._tell(robot, End(robot, KILL, self._world.tick - 1))
        self._wait(Leaving(leaving, set()))
        self._joined.difference_update(robots)

    def _welcome(self, restarted: list[int]) -> None:
        """Brief new processes, and have them and their neighbours meet."""
        world, neighbours = self._world, self._plan.neighbours_of
        self._wait(Joining(restarted, self._joined), START_PATIENCE_S)
        here = [robot for robot in world.up if robot in self._joined]
        meeting: list[int] = []
        for robot in here:
            new = robot in restarted
            met = [r for r in neighbours[robot] if r in here and (new or r in restarted)]
            if new:
                self._tell(robot, self._brief(robot, world.tick, met))
                for gone in self._gone:
                    self._tell(robot, gone)
            elif met:
                self._tell(robot, Meet(world.tick, met))
            if new or met:
                meeting.append(robot)
        self._wait(Meeting(meeting, set(), world.tick), START_PATIENCE_S)

    def _wait(self, wait: Wait, least_s: float = 0.0) -> None:
        """Until all of the wait's robots that are still here have done it."""
        patience = self._patience()
        last_patience = self._patience(max(least_s, self._plan.run.patience_s))
        while True:
            here = wait.robots if wait.dying else [*self._world.up, *self._paused]
            left = [robot for robot in wait.robots if robot in here and robot not in wait.done]
            if not left:
                return
            if patience.lost(left):
                self._complain(wait.what, left)
            if last_patience.lost(left):
                if wait.dying:
                    return
                for robot in left:
                    self._lose(robot, f"did not {wait.what} in time")
            message = self._next()
            if message is not None and not wait.take(message):
                self._handle(message)

    def _lose(self, robot: int, why: str) -> None:
        """Go on without ``robot``, or end the run."""
        world = self._world
        if self._plan.run.on_unscheduled_loss == "abort":
            raise Ended(self._outcome("lost", robot, why))
        with self._lock:
            tick, t_ns = world.tick, world.t_ns
            gone = Gone(robot, world.lose(robot))
        self._joined.discard(robot)
        self._paused.discard(robot)
        self._gone.append(gone)
        self._sink(events.Lost(t_ns, robot, why, gone.tick))
        for other in self._joined:
            self._tell(other, gone)
        if world.finished or world.tick > tick or not world.up:
            self._inbox.put(Turn())

    def _completed(self) -> Outcome:
        diverged = self._world.diverged
        if diverged is None:
            return self._outcome("completed", None, "")
        return self._outcome("diverged", diverged.robot, diverged.reason)

    # --- the bus's threads -------------------------------------------------------------

    def _on_message(self, robot: int, message: Message) -> None:
        if type(message) is not Drive:
            self._pass_on(robot, message)
            return
        with self._lock:
            if self._running:
                self._on_drive(robot, message)

    def _on_drive(self, robot: int, drive: Drive) -> None:
        world = self._world
        try:
            if drive.robot != robot:
                raise ValueError(f"claims to be robot {drive.robot}")
            self._prepared[robot] = encode(world.on_drive(drive))
            self._go_on(drive.tick)
        except ValueError as problem:  # mypyc: a name has one type
            self._refuse(robot, str(problem))
        except Exception as error:  # our own mistake: it must not hang the run
            traceback.print_exc()
            self._inbox.put(self._outcome("broken", robot, f"{type(error).__name__}: {error}"))

    def _go_on(self, tick: int) -> None:
        """``tick`` has one answer more; if it was the last, what is next."""
        world = self._world
        if world.finished:
            self._running = False
            self._inbox.put(self._completed())
        elif world.tick > tick:
            if world.changed or world.tick >= self._stir_at:
                self._inbox.put(Turn())
            else:
                self._begun = world.tick
                for robot, put in self._puts:
                    put(self._prepared[robot])
            if world.tick % _FLUSH_TICKS == 0:
                self._flush()

    def _flush(self) -> None:
        """Have the main thread report what is new; the caller holds the lock."""
        self._inbox.put(Samples(self._world.take_samples()))
        self._inbox.put(LinkRows(self._world.take_down_rows()))
