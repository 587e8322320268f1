"""From a valid scenario to the plan of a run: every reference is looked up here, once."""

from formnet.formation.briefing.plan import Plan, PlannedLink
from formnet.formation.briefing.situation import body_estimate
from formnet.formation.scenario.loading import dumps
from formnet.formation.scenario.model import Scenario
from formnet.netem.files.tables import nanoseconds
from formnet.netem.settings.links import LinkSettings
from formnet.netem.settings.timeline import NEVER, Action


def resolve(scenario: Scenario) -> Plan:
    """The plan of a run of ``scenario``, which is valid."""
    weights = scenario.formation.weights
    variants = scenario.network.variants
    settings: dict[str, tuple[int, LinkSettings]] = {}
    actions: list[tuple[int, Action]] = []
    of_variant: dict[int, int] = {}  # the number among settings
    of_entry: dict[int, list[int]] = {}  # those among actions
    links = []
    for link in scenario.directed_links:
        variant = variants.number(*link)
        if variant not in of_variant:
            own = variants.settings[variant]
            found = settings.setdefault(own.model_dump_json(), (len(settings), own))
            of_variant[variant] = found[0]
        entries = scenario.effects.entries(*link)
        for entry in entries:
            if entry not in of_entry:
                of_entry[entry] = [
                    _number(actions, action) for action in scenario.effects.of_entry(entry)
                ]
        numbers = tuple(number for entry in entries for number in of_entry[entry])
        links.append(PlannedLink(*link, of_variant[variant], numbers))
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
        spans={robot: tuple(some) for robot, some in scenario.spans.items()},
        links=tuple(links),
        settings=tuple(own for _, own in settings.values()),
        actions=tuple(actions),
    )


def _number(actions: list[tuple[int, Action]], action: tuple[int, Action]) -> int:
    """Which of ``actions`` is ``action``, which is put there if it is not."""
    if action not in actions:
        actions.append(action)
    return actions.index(action)
