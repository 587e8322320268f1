"""The scenario: everything that defines a run, typed, validated and immutable.

This module is the format's schema. Reading files, reporting errors and
resolving overrides is :mod:`formation.scenario.loading`'s; what the theory says of a
scenario is :mod:`formation.paper.theory`'s.
"""

from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Discriminator, Field, Tag, create_model, model_validator

from formnet.formation.plan.fault import spans_of
from formnet.formation.plan.roster import Roster
from formnet.formation.plan.selectors import RobotId, Robots, pair_covers
from formnet.formation.plan.timeline import PlanEntry, TimelineAction, effects, plan_of
from formnet.formation.scenario.clock import Clock
from formnet.formation.scenario.hosts import Hosts
from formnet.formation.wire.messages import State
from formnet.netem.core.link import Link
from formnet.netem.files.tables import (
    STRICT,
    LongSeconds,
    Positive,
    PositiveSeconds,
    Table,
    nanoseconds,
    optional,
)
from formnet.netem.settings.links import LinkOverrides, LinkSettings
from formnet.netem.settings.timeline import Timeline

NonNegative = Annotated[float, Field(ge=0.0)]


class Formation(Table):
    """``[formation]``: who hears whom (undirected) and the weights b_ji = b_ij."""

    edges: list[Annotated[tuple[RobotId, RobotId], Field(strict=False)]] = Field(
        description="Who hears whom, as pairs of robot ids; edges have no direction."
    )
    coupling: Annotated[
        Annotated[Positive, Tag("number")] | Annotated[dict[str, Positive], Tag("table")],
        Discriminator(lambda value: "table" if isinstance(value, dict) else "number"),
    ] = Field(
        default=1.0,
        description=(
            'The weight b of every edge, or a table with one entry per edge: `{ "1-2" = 2.0, "2-3" '
            "= 0.5 }`."
        ),
        json_schema_extra={"unit": "1/s"},
    )

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
    """``law.w1``: the excitation w1(t) = bias + amplitude · sin(frequency · t)."""

    bias: float = Field(
        default=0.5, description="The constant part.", json_schema_extra={"unit": "rad/s"}
    )
    amplitude: float = Field(
        default=0.0, description="Of the sine.", json_schema_extra={"unit": "rad/s"}
    )
    frequency_radps: NonNegative = Field(default=0.0, description="Of the sine.")


class LawSettings(Table):
    """``[law]``: the control law and its parameters, named as in the paper."""

    kind: str = Field(
        default="cooperative",
        description=(
            '"cooperative", "leader_follower", or the name of an installed plug-in (`formnet '
            "laws`)."
        ),
    )
    level: Literal["kinematic", "dynamic"] = Field(
        default="dynamic",
        description="Robots that take velocities (Theorems 1, 2, 5) or torques (3, 4, 6).",
    )
    beta: Positive = Field(
        default=10.0,
        description="β: couples sideways errors into the turning.",
        json_schema_extra={"unit": "s"},
    )
    w1: W1 = Field(
        default=W1(),
        description=(
            "The excitation, by which the headings turn for ever; zero breaks Assumption 2."
        ),
    )
    feedback_gain: Positive = Field(
        default=10.0,
        description="K: how fast velocities follow what the law wants.",
        json_schema_extra={"unit": "1/s"},
    )
    feedback_shape: Literal["identity", "inertia"] = Field(
        default="inertia",
        description=(
            "K as the printed identity, or shaped by the estimated inertia: then feedback_gain is "
            "a rate."
        ),
    )
    robust: bool = Field(
        default=True, description="Whether Eq. 31's term against wrong estimates is on."
    )
    gamma: Positive = Field(
        default=0.1,
        description="γ: the boundary layer shrinks as exp(−γ t).",
        json_schema_extra={"unit": "1/s"},
    )
    boundary_layer: Positive = Field(
        default=1.0,
        description="ε: where Eq. 31's robust term stops being a switch; in the law's own units.",
    )
    length_scale_m: Positive = Field(
        default=1.0,
        description=(
            "ℓ: positions are measured in units of so many metres; about how far the robots start "
            "from their places."
        ),
    )
    delta: Literal["corrected", "printed"] = Field(
        default="corrected",
        description=(
            "The sign of Δ in Eq. 19: as the proofs need it, or as it is printed (and diverges)."
        ),
    )
    cross_term: Literal["printed", "compensated"] = Field(
        default="printed",
        description=(
            "Leave w1 z2 z3 in, as printed, or cancel it: then V never rises, but centroids come "
            "home in Theorems 1 and 3, too."
        ),
    )
    parameters: dict[str, Any] = Field(
        default={}, description="The settings of a law that is not the built-in one."
    )


class LinkRule(LinkOverrides):
    """``[[network.links]]``: settings for the links from any of ``from`` to any of ``to``.

    What is not named stays as it is; a ``delay`` or ``loss`` that names its kind is a new one.
    """

    model_config = ConfigDict(**STRICT, validate_by_name=True)
    sources: Robots = Field(
        alias="from", description='The senders: an id, a list of ids, or "*" for all.'
    )
    destinations: Robots = Field(alias="to", description="The receivers, likewise.")
    both_ways: bool = Field(default=False, description="Whether the links back are meant, too.")

    def covers(self, source: int, destination: int) -> bool:
        """Whether the rule is about the link from ``source`` to ``destination``."""
        pair = (self.sources, self.destinations)
        return pair_covers(pair, source, destination, both_ways=self.both_ways)


class Network(Table):
    """``[network]``: the default of every directed link, and overrides; later ones win."""

    default: LinkSettings = Field(
        default=LinkSettings(), description="What every directed link begins with."
    )
    links: list[LinkRule] = Field(default=[], description="Changes for some links; later ones win.")

    def settings(self, source: int, destination: int) -> LinkSettings:
        """The settings of the link from ``source`` to ``destination``."""
        settings = self.default
        for rule in self.links:
            if rule.covers(source, destination):
                settings = settings.changed(rule)
        return settings


class Neighbours(Table):
    """``[neighbours]``: what a robot does with what it hears."""

    on_silence: Literal["hold", "drop"] = Field(
        default="drop",
        description=(
            "Hold the last state of a neighbour who says nothing, or drop it from the law's sums "
            "until it is heard again."
        ),
    )
    silence_s: PositiveSeconds = Field(
        default=0.5,
        description=(
            "Silent is from whom nothing usable came for longer than this, by the own clock."
        ),
    )
    playout: Literal["latest", "fixed"] = Field(
        default="latest",
        description="Use a message as it comes, or hold each until playout_s after its stamp.",
    )
    playout_s: PositiveSeconds | None = Field(
        default=None,
        description=(
            'For "fixed": random delay becomes this constant one, and what comes later is lost.'
        ),
    )

    @model_validator(mode="after")
    def _needs_a_time(self) -> "Neighbours":
        if self.playout == "fixed" and self.playout_s is None:
            raise ValueError('playout = "fixed" needs playout_s')
        return self


class Plant(Table):
    """``[plant]``: what the body of a robot does whose process is gone, stopped or too slow."""

    body_on_failure: Literal["brake", "coast", "freeze"] = Field(
        default="brake",
        description=(
            "brake: velocities decay; coast: no torque on the wheels (kinematic: the velocities "
            "stay); freeze: the body stands still at once."
        ),
    )
    brake_time_s: PositiveSeconds = Field(default=0.1, description='Time constant of "brake".')
    drive_timeout_s: PositiveSeconds = Field(
        default=0.25, description="In real time, a robot whose newest drive is older brakes."
    )


class Run(Table):
    """``[run]``: what happens when something goes wrong that nobody planned."""

    on_unscheduled_loss: Literal["continue", "abort"] = Field(
        default="continue",
        description="Go on without a robot that dies or hangs unplanned, or end the run.",
    )
    patience_s: Annotated[float, Field(ge=0.5, le=3600.0)] = Field(
        default=10.0, description="A robot that does not answer within this wall time is lost."
    )


class Vehicle(Table):
    """``[robot_defaults]``: what each robot is, and what its controller believes it to be.

    The middle of the wheel axle is the robot's reference point.
    """

    mass_kg: Positive = Field(default=1.0, description="Mass.")
    inertia_kgm2: Positive = Field(
        default=1.0, description="Moment of inertia about the centre of mass."
    )
    com_offset_m: float = Field(
        default=0.0,
        description=(
            "How far the centre of mass lies ahead of the axle's middle, the reference point."
        ),
    )
    mass_estimate_kg: Positive | None = Field(
        default=None, description="What the law believes; by default the truth."
    )
    inertia_estimate_kgm2: Positive | None = Field(
        default=None, description="What the law believes; by default the truth."
    )
    com_offset_estimate_m: float | None = Field(
        default=None, description="What the law believes; by default the truth."
    )
    robust_bound: NonNegative | None = Field(
        default=None,
        description=(
            "ρ: how wrong the estimates may be, in the law's own units; by default ‖a − ā‖."
        ),
    )
    half_axle_m: Positive = Field(default=0.5, description="Half the distance between the wheels.")
    wheel_radius_m: Positive = Field(default=0.2, description="Radius of the wheels.")
    wheel_torque_limit_nm: Positive | None = Field(
        default=None, description="Torques beyond it are cut off; by default there is no limit."
    )
    linear_friction_nspm: NonNegative = Field(default=0.0, description="Friction force per speed.")
    angular_friction_nmsprad: NonNegative = Field(
        default=0.0, description="Friction torque per turn rate."
    )
    disturbance_force_n: float = Field(default=0.0, description="A constant force ahead.")
    disturbance_torque_nm: float = Field(
        default=0.0, description="A constant torque that turns left."
    )
    damping: NonNegative = Field(
        default=0.0,
        description="μ: pulls the robot to its own place; some μ > 0 brings the centroid home.",
        json_schema_extra={"unit": "1/s"},
    )

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
    """``start`` in ``[[robots]]``: the initial pose; robots start at rest."""

    x_m: float = Field(description="East of the origin.")
    y_m: float = Field(description="North of the origin.")
    heading_rad: float = Field(default=0.0, description="From +x, counterclockwise.")


class Robot(Table):
    """``[[robots]]``: id, place in the pattern, start, and own values of ``[robot_defaults]``."""

    id: RobotId = Field(description="How edges, links and the timeline name the robot.")
    offset_m: Annotated[tuple[float, float], Field(strict=False)] = Field(
        description="Its place (p_x, p_y) in the pattern."
    )
    start: Start = Field(description="Where it starts, at rest.")

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
        name: optional(info) for name, info in Vehicle.model_fields.items()
    }
    return create_model("RobotTable", __base__=Robot, __doc__=Robot.__doc__, **overrides)


if TYPE_CHECKING:
    RobotTable = Robot
else:
    RobotTable = _robot_model()


class Expect(Table):
    """``[expect]``: which of Eqs. 3-5 shall hold over the last ``window_s`` of the run.

    ``false`` is a claim too: the run fails if the equation does hold.
    """

    formation: bool | None = Field(
        default=None, description="Eq. 3: the pattern, wherever it stands and however it is turned."
    )
    heading: bool | None = Field(default=None, description="Eq. 4: headings agree.")
    centroid: bool | None = Field(
        default=None, description="Eq. 5: the centroid is that of the pattern."
    )
    lyapunov: bool | None = Field(
        default=None,
        description="V (Eq. 22, 34, 40 or 43) never rises beyond its budget, over the whole run.",
    )
    formation_tolerance_m: Positive = Field(
        default=0.05, description="Of the largest error between two robots."
    )
    heading_tolerance_rad: Positive = Field(
        default=0.02, description="Of the largest gap between two headings."
    )
    centroid_tolerance_m: Positive = Field(
        default=0.2, description="Of ‖Σx − Σp‖, n times the centroid's distance."
    )
    window_s: LongSeconds | None = Field(
        default=None,
        description=(
            "Claims are judged over so much of the end; by default a tenth of the run, at least "
            "one broadcast period."
        ),
    )


class Scenario(Table):
    """One run, from a TOML file."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", max_length=80)] = Field(
        description="What the run and its folder are called."
    )
    description: str = Field(default="", description="For people.")
    seed: Annotated[int, Field(ge=0)] = Field(
        default=1, description="All that is random is drawn by it."
    )
    duration_s: LongSeconds = Field(
        description="How long the run is; a multiple of clock.control_period_s."
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
        default=[], description="What happens in the run, and when."
    )
    robots: Annotated[list[RobotTable], Field(min_length=1)] = Field(description="Who takes part.")
    expect: Expect | None = None
    hosts: Hosts | None = None

    @property
    def without_hosts(self) -> "Scenario":
        """The experiment alone, as others get it: machines are no part of it."""
        return self.model_copy(update={"hosts": None})

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
