"""From a valid scenario to the plan of a run: every reference is looked up here, once."""

from formnet.formation.briefing.plan import Plan, PlannedLink
from formnet.formation.briefing.situation import body_estimate
from formnet.formation.plan.fault import spans_of
from formnet.formation.plan.timeline import effects
from formnet.formation.scenario.loading import dumps
from formnet.formation.scenario.model import Scenario
from formnet.netem.files.tables import nanoseconds
from formnet.netem.settings.links import LinkSettings
from formnet.netem.settings.timeline import NEVER, Action


def resolve(scenario: Scenario) -> Plan:
    """The plan of a run of ``scenario``, which is valid."""
    weights = scenario.formation.weights
    settings: dict[str, tuple[int, LinkSettings]] = {}
    actions: list[tuple[int, Action]] = []
    links = []
    for source, destination in scenario.directed_links:
        own = scenario.link_settings(source, destination)
        number, _ = settings.setdefault(own.model_dump_json(), (len(settings), own))
        numbers = []
        for action in effects(scenario.timeline, source, destination, scenario.ids):
            if action not in actions:
                actions.append(action)
            numbers.append(actions.index(action))
        links.append(PlannedLink(source, destination, number, tuple(numbers)))
    period_ns = scenario.clock.control_period_ns
    spans = spans_of(enumerate(scenario.timeline), scenario.ids, scenario.seed, period_ns)
    drops = scenario.neighbours.on_silence == "drop"
    return Plan(
        name=scenario.name,
        scenario=dumps(scenario.without_hosts),
        seed=scenario.seed,
        clock=scenario.clock,
        ticks=scenario.ticks,
        law=scenario.law,
        plant=scenario.plant,
        run=scenario.run,
        ids=tuple(scenario.ids),
        vehicles=scenario.vehicles,
        estimates={
            robot: body_estimate(vehicle, scenario.law.length_scale_m)
            for robot, vehicle in scenario.vehicles.items()
        },
        starts={robot: scenario.start_state(robot) for robot in scenario.ids},
        offsets_m={robot.id: robot.offset_m for robot in scenario.robots},
        coupling={
            robot: {other: weights[min(robot, other), max(robot, other)] for other in others}
            for robot, others in scenario.neighbours_of.items()
        },
        silence_ns=nanoseconds(scenario.neighbours.silence_s) if drops else NEVER,
        spans={robot: tuple(some) for robot, some in spans.items()},
        links=tuple(links),
        settings=tuple(own for _, own in settings.values()),
        actions=tuple(actions),
    )
