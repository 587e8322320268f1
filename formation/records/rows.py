"""Rows of the two tables of a run: samples of the motion, and fates of messages."""

from typing import NamedTuple


class Sample(NamedTuple):
    """One robot at one recorded instant, with what it applies from there on.

    The torques are those that reach the wheels (after the limit); None at the
    kinematic level, which has no torques.
    """

    t_ns: int
    robot: int
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    turn_rate_radps: float
    torque_right_nm: float | None
    torque_left_nm: float | None


class LinkRow(NamedTuple):
    """What became of one message on one directed link.

    ``t_usable_ns`` is from when on the receiver could use it, None if it is lost or was
    still in flight at the receiver's last tick.
    """

    t_sent_ns: int
    t_usable_ns: int | None
    source: int
    destination: int
    sequence: int
    fate: str


class Samples(NamedTuple):
    """Consecutive samples, whole ticks only."""

    rows: list[Sample]


class LinkRows(NamedTuple):
    """Fates of messages, in no order."""

    rows: list[LinkRow]
