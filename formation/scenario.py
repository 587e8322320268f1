"""The scenario: everything that defines a run, typed, validated and immutable.

This module is the format's schema. Reading files, reporting errors and
resolving overrides is :mod:`formation.loading`'s; what the theory says of a
scenario is :mod:`formation.theory`'s.
"""

from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Discriminator, Field, Tag, create_model, model_validator

from formation.fault import spans_of
from formation.hosts import Hosts
from formation.messages import State
from formation.roster import Roster
from formation.selectors import RobotId, Robots, pair_covers
from formation.timeline import PlanEntry, TimelineAction, effects, plan_of
from netem.link import Link
from netem.settings import LinkOverrides, LinkSettings
from netem.tables import STRICT, Positive, PositiveSeconds, Table, nanoseconds
from netem.timeline import Timeline

NonNegative = Annotated[float, Field(ge=0.0)]


class Clock(Table):
    """``[clock]``: virtual time in lockstep or real time, and the periods of the sampled loop.

    In real time a robot whose estimate of the plant's clock may be wrong by more than
    ``sync_bound_s`` is reported.
    """

    mode: Literal["lockstep", "realtime"] = "lockstep"
    control_period_s: Positive = 0.001
    broadcast_period_s: Positive = 0.01
    sync_bound_s: PositiveSeconds = 0.005

    @property
    def control_period_ns(self) -> int:
        return nanoseconds(self.control_period_s)

    @property
    def broadcast_period_ns(self) -> int:
        return nanoseconds(self.broadcast_period_s)

    @property
    def broadcast_every(self) -> int:
        """Control ticks per broadcast."""
        return self.broadcast_period_ns // self.control_period_ns


class Formation(Table):
    """``[formation]``: who hears whom (undirected) and the weights b_ji = b_ij.

    ``coupling`` is one number, or a table with one entry per edge, such as
    ``{ "1-2" = 2.0, "2-3" = 0.5 }``.
    """

    edges: list[Annotated[tuple[RobotId, RobotId], Field(strict=False)]]
    coupling: Annotated[
        Annotated[Positive, Tag("number")] | Annotated[dict[str, Positive], Tag("table")],
        Discriminator(lambda value: "table" if isinstance(value, dict) else "number"),
    ] = 1.0

    @cached_property
    def weights(self) -> dict[tuple[int, int], float]:
        """b of every edge, keyed by the edge with its smaller robot first."""
        table = {
            (min(edge), max(edge)): self.coupling
            if isinstance(self.coupling, float | int)
            else self.coupling.get(
                f"{edge[0]}-{edge[1]}", self.coupling.get(f"{edge[1]}-{edge[0]}")
            )
            for edge in self.edges
        }
        return {edge: float(weight) for edge, weight in table.items() if weight is not None}


class W1(Table):
    """``law.w1``: w1(t) = bias + amplitude · sin(frequency · t)."""

    bias: float = 0.5
    amplitude: float = 0.0
    frequency_radps: NonNegative = 0.0


class LawSettings(Table):
    """``[law]``: the control law and its parameters, named as in the paper.

    ``kind`` is a built-in law or the name of an installed plug-in; a plug-in
    finds its own settings in ``parameters``.
    """

    kind: str = "cooperative"
    level: Literal["kinematic", "dynamic"] = "dynamic"
    beta: Positive = 10.0
    w1: W1 = W1()
    feedback_gain: Positive = 10.0
    feedback_shape: Literal["identity", "inertia"] = "inertia"
    robust: bool = True
    gamma: Positive = 0.1
    boundary_layer: Positive = 1.0
    length_scale_m: Positive = 1.0
    delta: Literal["corrected", "printed"] = "corrected"
    cross_term: Literal["printed", "compensated"] = "printed"
    parameters: dict[str, Any] = {}


class LinkRule(LinkOverrides):
    """``[[network.links]]``: settings for the links from any of ``from`` to any of ``to``.

    ``both_ways`` adds the links back.
    """

    model_config = ConfigDict(**STRICT, validate_by_name=True)
    sources: Robots = Field(alias="from")
    destinations: Robots = Field(alias="to")
    both_ways: bool = False

    def covers(self, source: int, destination: int) -> bool:
        """Whether the rule is about the link from ``source`` to ``destination``."""
        pair = (self.sources, self.destinations)
        return pair_covers(pair, source, destination, both_ways=self.both_ways)


class Network(Table):
    """``[network]``: the default of every directed link, and overrides; later ones win."""

    default: LinkSettings = LinkSettings()
    links: list[LinkRule] = []

    def settings(self, source: int, destination: int) -> LinkSettings:
        """The settings of the link from ``source`` to ``destination``."""
        settings = self.default
        for rule in self.links:
            if rule.covers(source, destination):
                settings = settings.changed(rule)
        return settings


class Neighbours(Table):
    """``[neighbours]``: what a robot does with what it hears.

    A neighbour from which nothing came for ``silence_s``, by the robot's own clock, is
    dropped from the law's sums until it is heard again, or its last state is held.
    ``playout = "fixed"`` holds every message until ``playout_s`` after its stamp and drops
    later ones (on links whose own ``playout_s`` is 0); ``"latest"`` uses it as it comes.
    """

    on_silence: Literal["hold", "drop"] = "drop"
    silence_s: PositiveSeconds = 0.5
    playout: Literal["latest", "fixed"] = "latest"
    playout_s: PositiveSeconds | None = None

    @model_validator(mode="after")
    def _needs_a_time(self) -> "Neighbours":
        if self.playout == "fixed" and self.playout_s is None:
            raise ValueError('playout = "fixed" needs playout_s')
        return self


class Plant(Table):
    """``[plant]``: what the body of a robot does whose process is gone, stopped or too slow.

    brake
        its velocities decay with the time constant ``brake_time_s``;
    coast
        no torque on the wheels (at the kinematic level: the velocities stay);
    freeze
        it stands still at once.

    In real time, a robot whose newest drive is older than ``drive_timeout_s`` brakes.
    """

    body_on_failure: Literal["brake", "coast", "freeze"] = "brake"
    brake_time_s: PositiveSeconds = 0.1
    drive_timeout_s: PositiveSeconds = 0.25


class Run(Table):
    """``[run]``: what happens when something goes wrong that nobody planned.

    A robot's process that dies or loses its connection, or that does not answer within
    ``patience_s`` of wall time, is lost: the others go on without it, or the run ends.
    """

    on_unscheduled_loss: Literal["continue", "abort"] = "continue"
    patience_s: Annotated[float, Field(ge=0.5, le=3600.0)] = 10.0


class Vehicle(Table):
    """What one robot is and what its controller believes: ``[robot_defaults]``.

    The middle of the wheel axle is the robot's reference point; the centre of
    mass lies ``com_offset_m`` ahead of it; ``inertia_kgm2`` is about the centre
    of mass. The estimates are what the law knows; they default to the truth.
    ``damping`` is μ_j; ``robust_bound`` is ρ_j, by default ‖a − ā‖.
    """

    mass_kg: Positive = 1.0
    inertia_kgm2: Positive = 1.0
    com_offset_m: float = 0.0
    mass_estimate_kg: Positive | None = None
    inertia_estimate_kgm2: Positive | None = None
    com_offset_estimate_m: float | None = None
    robust_bound: NonNegative | None = None
    half_axle_m: Positive = 0.5
    wheel_radius_m: Positive = 0.2
    wheel_torque_limit_nm: Positive | None = None
    linear_friction_nspm: NonNegative = 0.0
    angular_friction_nmsprad: NonNegative = 0.0
    disturbance_force_n: float = 0.0
    disturbance_torque_nm: float = 0.0
    damping: NonNegative = 0.0

    def estimate(self) -> tuple[float, float, float]:
        """(mass, inertia about the centre of mass, centre-of-mass offset) as the law believes."""
        return (
            self.mass_kg if self.mass_estimate_kg is None else self.mass_estimate_kg,
            self.inertia_kgm2 if self.inertia_estimate_kgm2 is None else self.inertia_estimate_kgm2,
            self.com_offset_m if self.com_offset_estimate_m is None else self.com_offset_estimate_m,
        )

    def truth(self) -> tuple[float, float, float]:
        """The same three as they are."""
        return self.mass_kg, self.inertia_kgm2, self.com_offset_m


class Start(Table):
    """``robots[].start``: the initial pose; robots start at rest."""

    x_m: float
    y_m: float
    heading_rad: float = 0.0


class Robot(Table):
    """``[[robots]]``: id, place in the pattern, start, and what differs from the defaults.

    The fields of :class:`Vehicle` may be given here too; see :func:`_robot_model`.
    """

    id: RobotId
    offset_m: Annotated[tuple[float, float], Field(strict=False)]
    start: Start

    def vehicle(self, defaults: Vehicle) -> Vehicle:
        """This robot's own values over the defaults."""
        own = {
            name: value
            for name, value in self
            if name in Vehicle.model_fields and value is not None
        }
        return defaults.model_copy(update=own)


def _robot_model() -> type[Robot]:
    """:class:`Robot` with every field of :class:`Vehicle` as an optional override."""
    overrides: dict[str, Any] = {
        name: (info.rebuild_annotation() | None, None)
        for name, info in Vehicle.model_fields.items()
    }
    return create_model("RobotTable", __base__=Robot, __doc__=Robot.__doc__, **overrides)


if TYPE_CHECKING:
    RobotTable = Robot
else:
    RobotTable = _robot_model()


class Expect(Table):
    """``[expect]``: which of Eqs. 3-5 shall hold over the last ``window_s`` of the run.

    ``false`` is a claim too: the run fails if the equation does hold. ``lyapunov`` claims
    that V (Eq. 22, 34, 40 or 43) never rises beyond its budget, over the whole run.
    ``window_s`` defaults to a tenth of the run, at least one broadcast period.
    """

    formation: bool | None = None
    heading: bool | None = None
    centroid: bool | None = None
    lyapunov: bool | None = None
    formation_tolerance_m: Positive = 0.05
    heading_tolerance_rad: Positive = 0.02
    centroid_tolerance_m: Positive = 0.2
    window_s: Positive | None = None


class Scenario(Table):
    """One run, from a TOML file."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", max_length=80)]
    description: str = ""
    seed: Annotated[int, Field(ge=0)] = 1
    duration_s: Positive
    clock: Clock = Clock()
    formation: Formation
    law: LawSettings = LawSettings()
    network: Network = Network()
    neighbours: Neighbours = Neighbours()
    plant: Plant = Plant()
    run: Run = Run()
    robot_defaults: Vehicle = Vehicle()
    timeline: list[TimelineAction] = []
    robots: Annotated[list[RobotTable], Field(min_length=1)]
    expect: Expect | None = None
    hosts: Hosts | None = None

    @property
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

    @property
    def directed_links(self) -> list[tuple[int, int]]:
        """Every (source, destination) that carries broadcasts, ascending."""
        return sorted((i, j) for j, others in self.neighbours_of.items() for i in others)

    def link_settings(self, source: int, destination: int) -> LinkSettings:
        """One directed link's settings at the beginning."""
        settings = self.network.settings(source, destination)
        playout_s = self.neighbours.playout_s
        if self.neighbours.playout == "fixed" and playout_s is not None and not settings.playout_s:
            settings = settings.model_copy(update={"playout_s": playout_s})
        return settings

    def link(self, source: int, destination: int, life: int = 0) -> Link:
        """One directed link as it is at the beginning.

        It stands at the receiver, so one that was restarted ``life`` times has new ones.
        """
        name = f"{destination}, life {life}" if life else f"{destination}"
        return self.link_settings(source, destination).link(
            seed=self.seed, source=source, destination=name
        )

    def roster(self) -> Roster:
        """Who is down when, as planned. Raises FaultError."""
        return Roster(
            spans_of(enumerate(self.timeline), self.ids, self.seed, self.clock.control_period_ns)
        )

    def timeline_of(self, source: int, destination: int, link: Link | None = None) -> Timeline:
        """What happens to one directed link; it keeps ``link`` to it, if there is one."""
        settings = self.link_settings(source, destination)
        return Timeline(settings, effects(self.timeline, source, destination, self.ids), link)

    @property
    def plan(self) -> list[PlanEntry]:
        """What happens in the run, and when."""
        happenings = self.roster().happenings()
        period_ns = self.clock.control_period_ns
        return plan_of(self.timeline, self.directed_links, self.ids, happenings, period_ns)

    @property
    def offsets_m(self) -> NDArray[np.float64]:
        """The pattern (p_x, p_y), shape (n_robots, 2)."""
        return np.array([robot.offset_m for robot in self.robots])

    def start_state(self, robot: int) -> State:
        """Pose at t = 0, at rest."""
        start = next(r.start for r in self.robots if r.id == robot)
        return State(start.x_m, start.y_m, start.heading_rad, 0.0, 0.0)
