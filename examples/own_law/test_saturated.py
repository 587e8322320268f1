"""The law by itself: no network, no plant, no process. Run with ``python -m pytest``."""

from math import cos, sin
from pathlib import Path

import pytest
from saturated import SaturatedLaw

from formnet.formation.briefing.resolving import resolve
from formnet.formation.scenario.loading import load
from formnet.formation.wire.state import Stamped, State

SCENARIO = Path(__file__).with_name("saturated.toml")


def test_speed_and_turn_rate_are_bounded_however_far_the_others_are():
    law = SaturatedLaw(resolve(load(SCENARIO)).situation(2))
    far = State(1e6, -1e6, 0.0, 0.0, 0.0)
    command = law.command(0, State(0.0, 0.0, 0.3, 0.0, 0.0), (Stamped(1, 0, far),))
    assert abs(command.first) == 1.5
    assert 0.5 < abs(command.second) <= 1.0


def test_w_never_rises_without_delays():
    """W of the module's docstring, along a motion in short steps in which everybody hears all."""
    scenario = load(SCENARIO)
    laws = {robot: SaturatedLaw(resolve(scenario).situation(robot)) for robot in scenario.ids}
    states = {robot: scenario.start_state(robot) for robot in scenario.ids}
    step_s, before = 0.01, float("inf")
    for _ in range(6_000):
        q = {robot: laws[robot].displacement(robot, state) for robot, state in states.items()}
        w = sum(
            0.5 * weight * ((q[i][0] - q[j][0]) ** 2 + (q[i][1] - q[j][1]) ** 2)
            for (i, j), weight in scenario.formation.weights.items()
        ) + sum(0.5 * laws[j].damping * (x * x + y * y) for j, (x, y) in q.items())
        assert w <= before + 1e-9
        before = w
        commands = {
            j: law.command(0, states[j], tuple(Stamped(i, 0, states[i]) for i in law.coupling))
            for j, law in laws.items()
        }
        for j, (speed, turn_rate) in commands.items():
            x, y, heading, _, _ = states[j]
            middle = heading + 0.5 * step_s * turn_rate
            states[j] = State(
                x + step_s * speed * cos(middle),
                y + step_s * speed * sin(middle),
                heading + step_s * turn_rate,
                speed,
                turn_rate,
            )
    assert w < 1e-2


@pytest.mark.parametrize("parameters", [{"gian": 1.0}, {"gain": 0.0}, {"gain": "high"}])
def test_parameters_that_cannot_work_are_refused(parameters):
    (name,) = parameters
    scenario = load(SCENARIO)
    scenario.law.parameters.clear()
    scenario.law.parameters.update(parameters)
    with pytest.raises(ValueError, match=f"law.parameters.{name}"):
        SaturatedLaw(resolve(scenario).situation(1))
