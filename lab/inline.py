"""A whole run in one process: the same robots, links and plant on an in-memory bus.

It is the oracle of the distributed run (bit-identical trajectories) and the
fast way to run many scenarios.
"""

from collections import deque

from agent.law import make
from agent.robot import Robot
from formation.messages import Drive, Sense
from formation.scenario import Scenario
from plant.world import World

def simulate(scenario):
    world = World(scenario)
    robots = {robot: Robot(scenario, robot, run="inline", law=make(scenario, robot)) for robot in scenario.ids}
    receivers = scenario.neighbours
    samples=[]
    while True:
        drives=[]
        for robot, sense in world.senses():
            for out in robots[robot].on_sense(sense):
                if isinstance(out, Drive): drives.append(out)
                else:
                    env = out.envelope.pack()
                    for r in receivers[robot]:
                        d = robots[r].on_broadcast(robot, out.payload, env)
                        if d: drives.append(d)
        for d in drives: world.on_drive(d)
        samples+=world.take_samples()
        if world.finished: return samples
