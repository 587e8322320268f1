"""The scenario: everything that defines a run, typed, validated and immutable.

:class:`Scenario` puts the format's tables together; each kind of table has a module beside this
one. Reading files, reporting errors and resolving overrides is
:mod:`formation.scenario.loading`'s; what the theory says of a scenario is
:mod:`formation.paper.theory`'s.
"""

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar

from pydantic import Field

from formnet.formation.formats.migration import FORMAT
from formnet.formation.machines.hosts import Hosts
from formnet.formation.plan.fault import spans_of
from formnet.formation.plan.roster import Roster, Span
from formnet.formation.plan.timeline import Effects, PlanEntry, TimelineAction, plan_of
from formnet.formation.scenario.clock import Clock
from formnet.formation.scenario.expect import Expect
from formnet.formation.scenario.failures import Plant, Run
from formnet.formation.scenario.graph import Formation
from formnet.formation.scenario.law import LawSettings
from formnet.formation.scenario.network import MOST_ENTRIES, Neighbours, Network
from formnet.formation.scenario.robots import RobotTable, Vehicle
from formnet.formation.wire.state import State
from formnet.netem.files.tables import LongSeconds, Table, nanoseconds
from formnet.netem.settings.links import LinkSettings
from formnet.netem.settings.timeline import Timeline

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

T = TypeVar("T")

MOST_ROBOTS = 1000


class Scenario(Table):
    """One run, from a TOML file."""

    format: Literal[2] = Field(
        default=FORMAT,
        description="The format of the file (1 if missing); `formnet migrate` updates older files.",
    )
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", max_length=80)] = Field(
        description="Name of the run and its folder."
    )
    description: str = Field(default="", max_length=100_000, description="Free text.")
    seed: Annotated[int, Field(ge=0, lt=2**63)] = Field(
        default=1, description="Seed of all random numbers."
    )
    duration_s: LongSeconds = Field(
        description="Length of the run; a multiple of clock.control_period_s."
    )
    clock: Clock = Clock()
    formation: Formation
    law: LawSettings = LawSettings()
    network: Network = Network()
    neighbours: Neighbours = Neighbours()
    plant: Plant = Plant()
    run: Run = Run()
    robot_defaults: Vehicle = Vehicle()
    timeline: list[TimelineAction] = Field(
        default=[], max_length=MOST_ENTRIES, description="Planned events."
    )
    robots: Annotated[list[RobotTable], Field(min_length=1, max_length=MOST_ROBOTS)] = Field(
        description="The robots."
    )
    expect: Expect | None = None
    hosts: Hosts | None = None

    @property
    def without_hosts(self) -> "Scenario":
        """The experiment alone, as others get it: machines are no part of it."""
        return self.model_copy(update={"hosts": None})

    @cached_property
    def ids(self) -> list[int]:
        """Robot ids in the order of the file; every array of a run has this order."""
        return [robot.id for robot in self.robots]

    @property
    def ticks(self) -> int:
        """Control periods in the run; the run samples ticks 0 to ``ticks``, both included."""
        return nanoseconds(self.duration_s) // self.clock.control_period_ns

    @cached_property
    def vehicles(self) -> dict[int, Vehicle]:
        """Every robot's resolved parameters."""
        return {robot.id: robot.vehicle(self.robot_defaults) for robot in self.robots}

    @cached_property
    def neighbours_of(self) -> dict[int, list[int]]:
        """𝒩_j of every robot, ascending."""
        table: dict[int, set[int]] = {robot: set() for robot in self.ids}
        for first, second in self.formation.edges:
            table[first].add(second)
            table[second].add(first)
        return {robot: sorted(others) for robot, others in table.items()}

    @cached_property
    def directed_links(self) -> list[tuple[int, int]]:
        """Every (source, destination) that carries broadcasts, ascending."""
        return sorted((i, j) for j, others in self.neighbours_of.items() for i in others)

    def link_settings(self, source: int, destination: int) -> LinkSettings:
        """One directed link's settings at the beginning."""
        return self.network.settings(source, destination)

    def of_links(self, of: Callable[[LinkSettings], T]) -> Iterator[tuple[tuple[int, int], T]]:
        """Every directed link, ascending, and ``of`` its settings at the beginning.

        ``of`` is called once for links that share them.
        """
        variants, known = self.network.variants, dict[int, T]()
        for link in self.directed_links:
            number = variants.number(*link)
            if number not in known:
                known[number] = of(variants.settings[number])
            yield link, known[number]

    @cached_property
    def spans(self) -> dict[int, list[Span]]:
        """When each robot is down, as planned. Raises FaultError."""
        period_ns = max(1, self.clock.control_period_ns)
        return spans_of(enumerate(self.timeline), self.ids, self.seed, period_ns)

    def roster(self) -> Roster:
        """Who is down when, as planned. Raises FaultError."""
        return Roster(self.spans)

    @cached_property
    def effects(self) -> Effects:
        """What the timeline does to links."""
        return Effects(self.timeline, self.ids)

    def timeline_of(self, source: int, destination: int) -> Timeline:
        """What happens to one directed link."""
        settings = self.link_settings(source, destination)
        return Timeline(settings, self.effects.on(source, destination))

    @cached_property
    def plan(self) -> list[PlanEntry]:
        """What happens in the run, and when."""
        happenings = self.roster().happenings()
        period_ns = self.clock.control_period_ns
        return plan_of(self.timeline, self.directed_links, self.ids, happenings, period_ns)

    @property
    def offsets_m(self) -> "NDArray[np.float64]":
        """The pattern (p_x, p_y), shape (n_robots, 2). For the lab: robots do without NumPy."""
        import numpy as np

        return np.array([robot.offset_m for robot in self.robots])

    def start_state(self, robot: int) -> State:
        """Pose at t = 0, at rest."""
        start = next(r.start for r in self.robots if r.id == robot)
        return State(start.x_m, start.y_m, start.heading_rad, 0.0, 0.0)
