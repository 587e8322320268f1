"""Consensus with bounded speed: a formation law that asks no robot for more than it can do.

With q = x - p, where a robot is less its place in the pattern, each robot is pulled by

    e_j = sum_i b_ji (q_i - q_j) - mu_j q_j

and drives with v = sat(k e.h) and turns with w = c e.n / (|e| + near), where h is its heading and
n the normal to the left: |v| and |w| have bounds however far away the others are. Without delays,
W = 1/2 sum over edges of b |q_i - q_j|^2 + 1/2 sum of mu |q|^2 never rises, for dW/dt = - sum of
v e.h <= 0. It rests only where every e vanishes, since a robot that is pulled sideways turns.
Headings need not agree, so Eq. 4 is not claimed.
"""

from formnet import Command, Situation, Stamped, State
from formnet.exact.trigonometry import hypot, sin_cos  # the same bits on every processor

DEFAULTS = {"gain": 1.0, "speed_limit_mps": 1.5, "turn_limit_radps": 1.0, "near_m": 0.01}


class SaturatedLaw:
    """One robot. Raises ValueError for parameters that it cannot work with."""

    def __init__(self, situation: Situation) -> None:
        given = situation.settings.parameters
        for name, value in given.items():
            if name not in DEFAULTS or not isinstance(value, int | float) or value <= 0:
                raise ValueError(
                    f"law.parameters.{name} = {value!r}: must be one of {', '.join(DEFAULTS)}, "
                    "and greater than 0"
                )
        if situation.settings.level != "kinematic":
            raise ValueError('needs law.level = "kinematic"')
        values = DEFAULTS | given
        self.gain, self.near = values["gain"], values["near_m"]
        self.speed_limit, self.turn_limit = values["speed_limit_mps"], values["turn_limit_radps"]
        self.robot, self.damping = situation.robot, situation.damping
        self.offsets, self.coupling = situation.offsets_m, situation.coupling

    def command(self, now_ns: int, own: State, heard: tuple[Stamped, ...]) -> Command:
        """Forward speed (m/s) and turn rate (rad/s)."""
        x, y = self.displacement(self.robot, own)
        pull_x, pull_y = -self.damping * x, -self.damping * y
        for robot, _, state in heard:
            other_x, other_y = self.displacement(robot, state)
            pull_x += self.coupling[robot] * (other_x - x)
            pull_y += self.coupling[robot] * (other_y - y)
        sine, cosine = sin_cos(own.heading_rad)
        ahead, left = pull_x * cosine + pull_y * sine, pull_y * cosine - pull_x * sine
        return Command(
            max(-self.speed_limit, min(self.speed_limit, self.gain * ahead)),
            self.turn_limit * left / (hypot(ahead, left) + self.near),
        )

    def displacement(self, robot: int, state: State) -> tuple[float, float]:
        """q: where the robot is, less its place in the pattern (m)."""
        offset_x, offset_y = self.offsets[robot]
        return state.x_m - offset_x, state.y_m - offset_y
