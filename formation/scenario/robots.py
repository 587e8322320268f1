"""``[robot_defaults]`` and ``[[robots]]``: bodies, places in the pattern, and starts."""

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, create_model

from formnet.formation.plan.selectors import RobotId
from formnet.netem.files.tables import NonNegative, Positive, Table, optional


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
            "Distance of the centre of mass ahead of the middle of the axle, the reference point."
        ),
    )
    mass_estimate_kg: Positive | None = Field(
        default=None, description="Estimate that the law uses; by default the true value."
    )
    inertia_estimate_kgm2: Positive | None = Field(
        default=None, description="Estimate that the law uses; by default the true value."
    )
    com_offset_estimate_m: float | None = Field(
        default=None, description="Estimate that the law uses; by default the true value."
    )
    robust_bound: NonNegative | None = Field(
        default=None,
        description=(
            "ρ: bound of the error of the estimates, in the law's units; by default ‖a − ā‖."
        ),
    )
    half_axle_m: Positive = Field(default=0.5, description="Half the distance between the wheels.")
    wheel_radius_m: Positive = Field(default=0.2, description="Radius of the wheels.")
    wheel_torque_limit_nm: Positive | None = Field(
        default=None, description="Wheel torques are limited to this; no limit by default."
    )
    linear_friction_nspm: NonNegative = Field(default=0.0, description="Friction force per speed.")
    angular_friction_nmsprad: NonNegative = Field(
        default=0.0, description="Friction torque per turn rate."
    )
    disturbance_force_n: float = Field(
        default=0.0, description="Constant force in the direction of the heading."
    )
    disturbance_torque_nm: float = Field(
        default=0.0, description="Constant torque, positive to the left."
    )
    damping: NonNegative = Field(
        default=0.0,
        description="μ: pulls the robot to its own place; with some μ > 0 the centroid converges.",
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

    id: RobotId = Field(description="Id of the robot in edges, links and the timeline.")
    offset_m: Annotated[tuple[float, float], Field(strict=False)] = Field(
        description="Place (p_x, p_y) in the pattern."
    )
    start: Start = Field(description="Initial pose, at rest.")

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
