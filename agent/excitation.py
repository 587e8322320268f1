"""The design variable w1 of Section 3, with its integral and derivatives in closed form."""

import math
from typing import NamedTuple

from formation.scenario import W1


class Excitation(NamedTuple):
    """w1 at one instant: ∫₀ᵗ w1, w1, ẇ1, ẅ1."""

    integral: float
    value: float
    rate: float
    acceleration: float


def excitation(w1: W1, t_s: float) -> Excitation:
    """w1(t) = bias + amplitude · sin(ω t) and what the law needs of it."""
    bias, amplitude, omega = w1.bias, w1.amplitude, w1.frequency_radps
    if amplitude == 0.0 or omega == 0.0:
        return Excitation(bias * t_s, bias, 0.0, 0.0)
    sine, cosine = math.sin(omega * t_s), math.cos(omega * t_s)
    return Excitation(
        bias * t_s + amplitude / omega * (1.0 - cosine),
        bias + amplitude * sine,
        amplitude * omega * cosine,
        -amplitude * omega * omega * sine,
    )
