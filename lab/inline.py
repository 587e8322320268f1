"""A whole run in one process: the same robots, links and plant on an in-memory bus.

It is the oracle of the distributed run (bit-identical trajectories) and the
fast way to run many scenarios.
"""

from collections import deque
from collections.abc import Callable

from agent.law import LawFailed, make
from agent.robot import Robot
from formation.messages import Drive
from formation.record import Event, LinkRows, Outcome, Samples, Sink
from formation.scenario import Scenario
from plant.world import DIVERGED, World

_FLUSH_TICKS = 100


def run(
    scenario: Scenario, name: str, sink: Sink, stopped: Callable[[], bool] = lambda: False
) -> Outcome:
    """Run ``scenario`` as ``name``, reporting to ``sink``; ``stopped`` is asked now and then."""
    world = World(scenario)
    robots: dict[int, Robot] = {}
    for robot in scenario.ids:
        try:
            robots[robot] = Robot(scenario, robot, run=name, law=make(scenario, robot))
        except Exception as error:  # a plug-in may raise anything
            return _finish(
                Outcome("failed", 0, robot, f"{type(error).__name__}: {error}"), world, {}, sink
            )
    heard_by = {robot: [robots[i] for i in scenario.neighbours[robot]] for robot in robots}
    sink(Event("started", 0, {"robots": scenario.ids}))
    drives: deque[Drive] = deque()
    try:
        while True:
            for robot, sense in world.senses():
                outgoing, drive = robots[robot].on_sense(sense)
                if drive is not None:
                    drives.append(drive)
                if outgoing is None:
                    continue
                payload, note = outgoing.payload, outgoing.envelope.pack()
                for receiver in heard_by[robot]:
                    drive = receiver.on_broadcast(robot, payload, note)
                    if drive is not None:
                        drives.append(drive)
            while drives:
                world.on_drive(drives.popleft())
            if world.finished:
                break
            if world.tick % _FLUSH_TICKS == 0:
                _flush(world, robots, sink)
                if stopped():
                    return _finish(
                        Outcome("interrupted", world.t_ns, None, "stopped by the user"),
                        world, robots, sink,
                    )  # fmt: skip
    except LawFailed as error:
        return _finish(Outcome("failed", world.t_ns, error.robot, str(error)), world, robots, sink)
    diverged = world.diverged
    outcome = (
        Outcome("completed", world.t_ns, None, "")
        if diverged is None
        else Outcome("diverged", diverged.t_ns, diverged.robot, DIVERGED)
    )
    return _finish(outcome, world, robots, sink)


def _flush(world: World, robots: dict[int, Robot], sink: Sink, *, last: bool = False) -> None:
    sink(Samples(world.take_samples()))
    for robot in robots.values():
        sink(LinkRows(robot.take_last_link_rows() if last else robot.take_link_rows()))
        for rejected in robot.take_rejections():
            sink(Event("rejected", world.t_ns, rejected._asdict()))


def _finish(outcome: Outcome, world: World, robots: dict[int, Robot], sink: Sink) -> Outcome:
    sink(Event("ended", outcome.t_ns, {"outcome": outcome.kind}))
    _flush(world, robots, sink, last=True)
    sink(outcome)
    return outcome
