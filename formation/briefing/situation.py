"""What a control law may know beside its inputs; the true body stays in the plant."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt

from formnet.formation.scenario.law import LawSettings
from formnet.formation.scenario.robots import Vehicle


@dataclass(frozen=True, slots=True)
class BodyEstimate:
    """What a robot believes of its own body; the true parameters stay in the plant.

    ``robust_bound`` is ρ_j, a bound on ‖a − ā‖ in the law's own units (lengths
    in ``length_scale_m``); ``com_uncertain`` says whether the third parameter,
    m d, is in play at all (it is not for a robot built with its centre of mass
    on the axle).
    """

    mass_kg: float
    inertia_kgm2: float
    com_offset_m: float
    com_uncertain: bool
    robust_bound: float
    half_axle_m: float
    wheel_radius_m: float


@dataclass(frozen=True, slots=True)
class Situation:
    """All that a law may know beside its inputs, fixed for the run.

    ``offsets_m`` is the desired pattern (public); ``coupling`` holds b_ji for
    each neighbour i; ``damping`` is μ_j.
    """

    robot: int
    settings: LawSettings
    control_period_s: float
    offsets_m: Mapping[int, tuple[float, float]]
    coupling: Mapping[int, float]
    damping: float
    body: BodyEstimate


def parameters(
    mass_kg: float, inertia_kgm2: float, com_offset_m: float, scale_m: float
) -> tuple[float, float, float]:
    """a = (m ℓ², I + m d², m d ℓ): the inertia parameters with lengths in units of ℓ metres."""
    return (
        mass_kg * scale_m * scale_m,
        inertia_kgm2 + mass_kg * com_offset_m * com_offset_m,
        mass_kg * com_offset_m * scale_m,
    )


def body_estimate(vehicle: Vehicle, scale_m: float) -> BodyEstimate:
    """The estimate of a vehicle; ρ = ‖a − ā‖ is computed here, once, unless it was given."""
    mass, inertia, offset = vehicle.estimate()
    believed = parameters(mass, inertia, offset, scale_m)
    true = parameters(*vehicle.truth(), scale_m)
    bound = vehicle.robust_bound
    if bound is None:
        first, second, third = (a - b for a, b in zip(true, believed, strict=True))
        bound = sqrt(first * first + second * second + third * third)
    return BodyEstimate(
        mass_kg=mass,
        inertia_kgm2=inertia,
        com_offset_m=offset,
        com_uncertain=vehicle.com_offset_m != 0.0 or offset != 0.0,
        robust_bound=bound,
        half_axle_m=vehicle.half_axle_m,
        wheel_radius_m=vehicle.wheel_radius_m,
    )
