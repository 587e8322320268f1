"""The extremes of a motion, each with whose it is and when it was (see :mod:`plant.extremes`)."""

from dataclasses import dataclass

from formnet.formation.records.checked import RobotId


@dataclass(frozen=True)
class Closest:
    """The smallest distance between two robots, and when it was."""

    distance_m: float
    robots: tuple[RobotId, RobotId]
    t_s: float

    @property
    def words(self) -> str:
        """Value, whose and when."""
        one, other = self.robots
        return _extreme(self.distance_m, "m", f"robots {one} and {other}", self.t_s)


@dataclass(frozen=True)
class TopSpeed:
    """The largest speed, or commanded speed, either way."""

    speed_mps: float
    robot: RobotId
    t_s: float

    @property
    def words(self) -> str:
        """Value, whose and when."""
        return _extreme(self.speed_mps, "m/s", f"robot {self.robot}", self.t_s)


@dataclass(frozen=True)
class TopTurnRate:
    """The largest turn rate, either way."""

    turn_rate_radps: float
    robot: RobotId
    t_s: float

    @property
    def words(self) -> str:
        """Value, whose and when."""
        return _extreme(self.turn_rate_radps, "rad/s", f"robot {self.robot}", self.t_s)


@dataclass(frozen=True)
class TopTorque:
    """The largest commanded torque of a wheel, either way."""

    torque_nm: float
    robot: RobotId
    t_s: float

    @property
    def words(self) -> str:
        """Value, whose and when."""
        return _extreme(self.torque_nm, "N m", f"robot {self.robot}", self.t_s)


def _extreme(value: float, unit: str, whose: str, t_s: float) -> str:
    size = f"{value:.0f}" if 1e3 <= value < 1e6 else f"{value:.3g}"
    return f"{size} {unit} ({whose}, at {t_s:.3f} s)"
