"""A whole run in one process: the same robots, links and plant on an in-memory bus.

It is the oracle of the distributed run (bit-identical trajectories, faults too) and the
fast way to run many scenarios.
"""

from collections import deque
from collections.abc import Callable

from agent.law import LawFailed, failure, make
from agent.robot import Robot
from formation.messages import Drive
from formation.record import Event, LinkRows, Outcome, Samples, Sink
from formation.scenario import Scenario
from netem.link import IN_FLIGHT, LOST_DOWN
from plant.world import DIVERGED, World

_FLUSH_TICKS = 100


def run(
    scenario: Scenario, name: str, sink: Sink, stopped: Callable[[], bool] = lambda: False
) -> Outcome:
    """Run ``scenario`` as ``name``, reporting to ``sink``; ``stopped`` is asked now and then."""
    return _Run(scenario, name, sink).until_the_end(stopped)


class _Run:
    def __init__(self, scenario: Scenario, name: str, sink: Sink) -> None:
        self._scenario, self._name, self._sink = scenario, name, sink
        self._world = World(scenario)
        self._robots: dict[int, Robot] = {}  # those that have a process, or would have one

    def until_the_end(self, stopped: Callable[[], bool]) -> Outcome:
        world = self._world
        try:
            for robot in self._scenario.ids:
                self._start(robot)
            self._sink(Event("started", 0, {"robots": self._scenario.ids}))
            while not world.finished:
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
            return self._finish("failed", error.robot, str(error))
        if world.diverged is not None:
            return self._finish("diverged", world.diverged.robot, DIVERGED)
        return self._finish("completed", None, "")

    def _start(self, robot: int) -> None:
        try:
            law = make(self._scenario, robot)
            self._robots[robot] = Robot(
                self._scenario, robot, run=self._name, law=law, first_tick=self._world.tick
            )
        except Exception as error:  # a plug-in may raise anything
            raise failure(robot, error) from error

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
            outgoing, drive = robots[robot].on_sense(sense)
            if drive is not None:
                drives.append(drive)
            if outgoing is None:
                continue
            payload, note = outgoing.payload, outgoing.envelope.pack()
            for neighbour in self._scenario.neighbours_of[robot]:
                receiver = robots.get(neighbour)
                drive = None if receiver is None else receiver.on_broadcast(robot, payload, note)
                if drive is not None:
                    drives.append(drive)
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
        self._sink(Event("ended", t_ns, {"outcome": kind}))
        self._flush()
        for left in self._robots.values():
            self._report(left, IN_FLIGHT)
        self._sink(outcome)
        return outcome
