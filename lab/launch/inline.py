"""A whole run in one process: the same robots, links and plant on an in-memory bus.

It is the oracle of the distributed run (bit-identical trajectories, faults too) and the
fast way to run many scenarios.
"""

import traceback
from collections import deque
from collections.abc import Callable
from pathlib import Path

from formnet.agent.law import RAISED, LawFactory, LawFailed, failure, make, place
from formnet.agent.robot import Robot
from formnet.formation.briefing.plan import Plan
from formnet.formation.records import events
from formnet.formation.records.outcome import Outcome, OutcomeKind
from formnet.formation.records.rows import LinkRows, Samples
from formnet.formation.records.stream import Sink
from formnet.formation.wire.messages import Drive
from formnet.lab.launch import stuck
from formnet.lab.launch.engine import EngineName, never
from formnet.lab.launch.signals import insisted
from formnet.lab.runs.exits import Stop
from formnet.netem.core.transit import IN_FLIGHT, LOST_DOWN
from formnet.netem.settings.timeline import NEVER
from formnet.plant.world import World

_FLUSH_TICKS = 100


class Inline:
    """An :class:`~formnet.lab.launch.engine.Engine`.

    The traceback of a law that raised goes into ``logs``. ``law`` makes the law of every robot
    instead of the one that the plan names.
    """

    name: EngineName = "inline"

    def __init__(self, logs: Path | None = None, law: LawFactory = make) -> None:
        self._logs = logs
        self._law = law

    def run(
        self,
        plan: Plan,
        sink: Sink,
        stopped: Callable[[], bool] = never,
        until_ns: int = NEVER,
    ) -> Outcome:
        """See :class:`~formnet.lab.launch.engine.Engine`.

        A signal to end ends the run in the middle of a law that does not come back, too.
        """
        run = _Run(plan, sink, self._law, self._log)
        with stuck.told(run.complain, run.tick), insisted(lambda: run.at_work > 0):
            return run.until_the_end(stopped, until_ns)

    def _log(self, robot: int, text: str) -> None:
        if self._logs is not None:
            self._logs.mkdir(exist_ok=True)
            (self._logs / f"robot-{robot}.log").write_text(text, encoding="utf-8")


class _Run:
    def __init__(
        self, plan: Plan, sink: Sink, law: LawFactory, log: Callable[[int, str], None]
    ) -> None:
        self._plan, self._sink, self._law, self._log = plan, sink, law, log
        self._world = World(plan)
        self._robots: dict[int, Robot] = {}  # those that have a process, or would have one
        self._began = False
        self.at_work = 0
        """The robot that computes."""

    def tick(self) -> int:
        """How far it is."""
        return self._world.tick

    def complain(self, where: str) -> None:
        """Say on whom the run waits, as a plant does, and where its law is."""
        what = f"answer (it is at {where})"
        self._sink(events.Waiting(self._world.t_ns, what, (self.at_work,)))

    def until_the_end(self, stopped: Callable[[], bool], until_ns: int) -> Outcome:
        """Run to the end, or to where it must end."""
        world = self._world
        try:
            for robot in self._plan.ids:
                self._start(robot)
            self._began = True
            self._sink(events.Started(0, self._plan.ids))
            while not world.finished and world.t_ns < until_ns:
                if world.happenings:
                    self._happen()
                if not world.up:
                    world.idle()
                    continue
                self._tick()
                if world.tick % _FLUSH_TICKS == 0:
                    self._flush()
                    if stopped():
                        return self._finish("interrupted", None, "stopped by the user")
        except LawFailed as error:
            self._log(error.robot, "".join(traceback.format_exception(error.__cause__)))
            return self._finish("failed", error.robot, str(error))
        except Stop as stop:
            where = f"in the law of robot {self.at_work}{place(stop)}"
            return self._finish("interrupted", None, f"stopped by the user, {where}")
        if not world.finished:
            return self._finish("interrupted", None, "as far as it was to go")
        if world.diverged is not None:
            return self._finish("diverged", world.diverged.robot, world.diverged.reason)
        return self._finish("completed", None, "")

    def _start(self, robot: int) -> None:
        self.at_work = robot
        try:
            plan = self._plan.robot(robot)
            law = self._law(plan.situation)
            self._robots[robot] = Robot(
                plan, run=self._plan.name, law=law, first_tick=self._world.tick
            )
        except RAISED as error:
            raise failure(robot, error) from error
        self.at_work = 0

    def _happen(self) -> None:
        """What the launcher and the system do to processes in a distributed run."""
        for _, verb, robots in self._world.happenings:
            self._sink(events.planned(verb, self._world.t_ns, robots))
            for robot in robots:
                if verb == "kill":
                    self._report(self._robots.pop(robot), LOST_DOWN)
                elif verb == "restart":
                    self._start(robot)

    def _tick(self) -> None:
        world, robots = self._world, self._robots
        drives: deque[Drive] = deque()
        for robot, sense in world.senses():
            self.at_work = robot
            outgoing, drive = robots[robot].on_sense(sense)
            if drive is not None:
                drives.append(drive)
            if outgoing is None:
                continue
            payload, note = outgoing.payload, outgoing.envelope.pack()
            for neighbour in self._plan.neighbours_of[robot]:
                receiver = robots.get(neighbour)
                self.at_work = neighbour
                drive = None if receiver is None else receiver.on_broadcast(robot, payload, note)
                if drive is not None:
                    drives.append(drive)
        self.at_work = 0
        while drives:
            world.on_drive(drives.popleft())

    def _flush(self) -> None:
        self._sink(Samples(self._world.take_samples()))
        self._sink(LinkRows(self._world.take_down_rows()))
        for robot in self._robots.values():
            self._report(robot)

    def _report(self, robot: Robot, last: str | None = None) -> None:
        """Fates and refusals; ``last`` is what becomes of what is still in flight."""
        rows = robot.take_link_rows() if last is None else robot.take_last_link_rows(last)
        self._sink(LinkRows(rows))
        for rejected in robot.take_rejections():
            self._sink(events.Rejected(self._world.t_ns, **rejected._asdict()))

    def _finish(self, kind: OutcomeKind, robot: int | None, reason: str) -> Outcome:
        world = self._world
        t_ns = world.t_ns if world.diverged is None else world.diverged.t_ns
        outcome = Outcome(kind, t_ns, robot, reason)
        self._sink(events.LastTick(t_ns))
        self._flush()
        for left in self._robots.values():
            self._report(left, IN_FLIGHT)
        if self._began:
            self._sink(world.extremes.event(t_ns))
        self._sink(outcome)
        return outcome
