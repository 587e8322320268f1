"""Leader-follower control along a spanning tree, the baseline that Remark 9 compares with.

Separation-bearing (l-ψ) control after J. P. Desai, J. P. Ostrowski and V. Kumar, *Modeling
and Control of Formations of Nonholonomic Mobile Robots*, IEEE Transactions on Robotics and
Automation 17(6), 2001: a follower keeps a point ``reach_m`` ahead of its axle at a distance
l and a bearing ψ from its leader, both linearised by feedback. The control is the one of that
paper's Eqs. 3-5, written with vectors, which has no division by cos γ. The robot that follows
nobody tracks a point that leaves its own place in the pattern along +x.

The velocities so decided go through the same dynamic layer as the cooperative law's
(Eq. 29 here). A follower that has no leader to hear stands still: nothing tells it where to go.
"""

from math import pi
from typing import Annotated

from pydantic import Field, ValidationError

from formnet.agent.dynamics import DynamicLayer
from formnet.agent.law import Command
from formnet.exact.trigonometry import atan2, hypot, sin_cos
from formnet.formation.briefing.situation import Situation
from formnet.formation.wire.state import Stamped, State
from formnet.netem.files.problems import problems
from formnet.netem.files.tables import Positive, Table

NEAREST_M = 1e-6
"""A distance to the leader below this counts as this, where bearings lose their meaning."""


class Parameters(Table):
    """``law.parameters``. ``follows`` says who follows whom: ``{ "2" = 1, "3" = 2 }``."""

    follows: dict[str, Annotated[int, Field(ge=0)]]
    separation_gain: Positive = 1.0
    bearing_gain: Positive = 1.0
    reach_m: Positive = 0.5
    speed_mps: Annotated[float, Field(ge=0.0)] = 1.0


class LeaderFollowerLaw:
    """One robot of the tree.

    Raises:
        ValueError: bad parameters, a leader who is no neighbour, or no way up to one leader.
    """

    def __init__(self, situation: Situation) -> None:
        given = situation.settings.parameters
        try:
            settings = Parameters.model_validate(given)
        except ValidationError as error:
            raise ValueError(f"law.parameters: {problems(Parameters, given, error)[0]}") from None
        self._settings = settings
        self._leader = _leader_of(situation, settings.follows)
        self._scale = situation.settings.length_scale_m
        self._layer = DynamicLayer(situation) if situation.settings.level == "dynamic" else None
        own_x, own_y = situation.offsets_m[situation.robot]
        self._home = own_x, own_y
        # Where the point ahead of the axle belongs, seen from the leader: its heading is +x.
        x, y = situation.offsets_m.get(self._leader, (own_x, own_y))
        across, along = own_y - y, own_x - x + settings.reach_m
        self._separation_m, self._bearing_rad = hypot(along, across), atan2(across, along)

    def command(self, now_ns: int, own: State, heard: tuple[Stamped, ...]) -> Command:
        """See :meth:`agent.law.Law.command`."""
        t_s = now_ns * 1e-9
        leader = self._whom_to_follow(t_s, heard)
        v = omega = v_dot = omega_dot = 0.0
        if leader is not None:
            v, omega, v_dot, omega_dot = self._velocities(own, leader)
        if self._layer is None:
            return Command(v, omega)
        scale = self._scale
        return self._layer.torques(
            t_s,
            0.0,
            0.0,
            -own.turn_rate_radps,
            own.speed_mps / scale,
            -omega,
            v / scale,
            -omega_dot,
            v_dot / scale,
            0.0,
            0.0,
        )

    def _whom_to_follow(self, t_s: float, heard: tuple[Stamped, ...]) -> State | None:
        """The leader as last heard; for the first of all, the point that it tracks."""
        if self._leader < 0:
            speed = self._settings.speed_mps
            x, y = self._home
            return State(x + speed * t_s, y, 0.0, speed, 0.0)
        return next((state for robot, _, state in heard if robot == self._leader), None)

    def _velocities(self, own: State, leader: State) -> tuple[float, float, float, float]:
        """(v, ω) that close separation and bearing exponentially, and their rates.

        The rates are those for a leader that keeps its velocities.
        """
        settings, reach = self._settings, self._settings.reach_m
        s2, c2 = sin_cos(own.heading_rad)
        s1, c1 = sin_cos(leader.heading_rad)
        v1, w1, v2, w2 = (
            leader.speed_mps,
            leader.turn_rate_radps,
            own.speed_mps,
            own.turn_rate_radps,
        )
        # The point ahead of the own axle, seen from the leader: r = l (cos φ, sin φ).
        rx, ry = own.x_m + reach * c2 - leader.x_m, own.y_m + reach * s2 - leader.y_m
        distance = max(hypot(rx, ry), NEAREST_M)
        ex, ey = (rx / distance, ry / distance) if distance > NEAREST_M else (c1, s1)
        bearing = atan2(ey, ex) - leader.heading_rad
        gap = (self._bearing_rad - bearing + pi) % (2.0 * pi) - pi
        closing = settings.separation_gain * (self._separation_m - distance)
        swing = w1 + settings.bearing_gain * gap  # φ̇ wanted
        # The velocity wanted of that point, and how it changes as things are.
        wx = v1 * c1 + closing * ex - distance * swing * ey
        wy = v1 * s1 + closing * ey + distance * swing * ex
        rx_dot = v2 * c2 - reach * w2 * s2 - v1 * c1
        ry_dot = v2 * s2 + reach * w2 * c2 - v1 * s1
        distance_dot = rx_dot * ex + ry_dot * ey
        phi_dot = (ry_dot * ex - rx_dot * ey) / distance
        along = -settings.separation_gain * distance_dot - distance * swing * phi_dot
        across = (
            closing * phi_dot
            + distance_dot * swing
            - distance * settings.bearing_gain * (phi_dot - w1)
        )
        wx_dot = -v1 * w1 * s1 + along * ex - across * ey
        wy_dot = v1 * w1 * c1 + along * ey + across * ex
        v, sideways = wx * c2 + wy * s2, wy * c2 - wx * s2
        v_dot = wx_dot * c2 + wy_dot * s2 + w2 * sideways
        sideways_dot = wy_dot * c2 - wx_dot * s2 - w2 * v
        return v, sideways / reach, v_dot, sideways_dot / reach


def _leader_of(situation: Situation, follows: dict[str, int]) -> int:
    """Whom the robot follows; -1: nobody, it is the first."""
    robots = sorted(situation.offsets_m)
    ids = {str(robot): robot for robot in robots}  # "03" and Arabic digits are no robot's
    named = {ids.get(robot, -1): leader for robot, leader in follows.items()}
    strangers = [robot for robot in [*named, *named.values()] if robot not in robots]
    if strangers:
        raise ValueError(f"law.parameters.follows names {strangers[0]}, which is no robot")
    first = [robot for robot in robots if robot not in named]
    if len(first) != 1:
        raise ValueError(
            "law.parameters.follows must name every robot but one as a follower "
            f"(not named: {', '.join(map(str, first)) or 'none'})"
        )
    seen, robot = set(), situation.robot
    while robot != first[0]:
        if robot in seen:
            raise ValueError(f"law.parameters.follows goes round in a circle at robot {robot}")
        seen.add(robot)
        robot = named[robot]
    if situation.robot == first[0]:
        return -1
    leader = named[situation.robot]
    if leader not in situation.coupling:
        raise ValueError(
            f"law.parameters.follows: robot {situation.robot} follows robot {leader}, "
            "which is not its neighbour in formation.edges"
        )
    return leader
