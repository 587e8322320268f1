"""A whole run in one process: the same robots, links and plant on an in-memory bus.

It is the oracle of the distributed run (bit-identical trajectories, faults too) and the
fast way to run many scenarios.
"""

import traceback
from collections import deque
from collections.abc import Callable

from formnet.agent.law import RAISED, LawFailed, failure, make, place
from formnet.agent.robot import Robot
from formnet.formation.scenario.model import Scenario
from formnet.formation.wire.messages import Drive
from formnet.formation.wire.record import Event, LinkRows, Outcome, Samples, Sink
from formnet.lab.launch import stuck
from formnet.lab.launch.signals import insisted
from formnet.lab.runs.exits import Stop
from formnet.netem.core.transit import IN_FLIGHT, LOST_DOWN
from formnet.netem.settings.timeline import NEVER
from formnet.plant.world import World

_FLUSH_TICKS = 100


def run(
    scenario: Scenario,
    name: str,
    sink: Sink,
    stopped: Callable[[], bool] = lambda: False,
    log: Callable[[int, str], None] = lambda *_: None,
    until_ns: int = NEVER,
) -> Outcome:
    """Run ``scenario`` as ``name``, reporting to ``sink``; ``stopped`` is asked now and then.

    ``log`` takes the number of a robot whose law raised, and the traceback. A signal to end
    ends the run in the middle of a law that does not come back, too. What is at ``until_ns`` is
    not run any more.
    """
    run = _Run(scenario, name, sink)
    with stuck.told(run.complain, run.tick), insisted(lambda: run.at_work > 0):
        return run.until_the_end(stopped, log, until_ns)


class _Run:
    def __init__(self, scenario: Scenario, name: str, sink: Sink) -> None:
        self._scenario, self._name, self._sink = scenario, name, sink
        self._world = World(scenario)
        self._robots: dict[int, Robot] = {}  # those that have a process, or would have one
        self._began = False
        self.at_work = 0
        """The robot that computes."""

    def tick(self) -> int:
        """How far it is."""
        return self._world.tick

    def complain(self, where: str) -> None:
        """Say on whom the run waits, as a plant does, and where its law is."""
        details = {"for": f"answer (it is at {where})", "robots": [self.at_work]}
        self._sink(Event("waiting", self._world.t_ns, details))

    def until_the_end(
        self, stopped: Callable[[], bool], log: Callable[[int, str], None], until_ns: int
    ) -> Outcome:
        """Run to the end, or to where it must end."""
        world = self._world
        try:
            for robot in self._scenario.ids:
                self._start(robot)
            self._began = True
            self._sink(Event("started", 0, {"robots": self._scenario.ids}))
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
            log(error.robot, "".join(traceback.format_exception(error.__cause__)))
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
            law = make(self._scenario, robot)
            self._robots[robot] = Robot(
                self._scenario, robot, run=self._name, law=law, first_tick=self._world.tick
            )
        except RAISED as error:
            raise failure(robot, error) from error
        self.at_work = 0

    def _happen(self) -> None:
        """What the launcher and the system do to processes in a distributed run."""
        for _, verb, robots in self._world.happenings:
            self._sink(Event(verb, self._world.t_ns, {"robots": robots}))
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
            for neighbour in self._scenario.neighbours_of[robot]:
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
            self._sink(Event("rejected", self._world.t_ns, rejected._asdict()))

    def _finish(self, kind: str, robot: int | None, reason: str) -> Outcome:
        world = self._world
        t_ns = world.t_ns if world.diverged is None else world.diverged.t_ns
        outcome = Outcome(kind, t_ns, robot, reason)
        self._sink(Event("last tick", t_ns, {}))
        self._flush()
        for left in self._robots.values():
            self._report(left, IN_FLIGHT)
        if self._began:
            self._sink(Event("extremes", t_ns, world.extremes.details()))
        self._sink(outcome)
        return outcome
