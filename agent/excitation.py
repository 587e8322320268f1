"""The design variable w1 of Section 3, with its integral and derivatives in closed form."""

from formnet.exact.trigonometry import sin_cos
from formnet.formation.scenario.law import W1

Excitation = tuple[float, float, float, float]
"""∫₀ᵗ w1, w1, ẇ1, ẅ1 at one instant."""


class W1Signal:
    """w1(t) = bias + amplitude · sin(ω t) and what the law needs of it."""

    __slots__ = ("_amplitude", "_bias", "_constant", "_omega")

    def __init__(self, w1: W1) -> None:
        self._bias = float(w1.bias)
        self._amplitude = float(w1.amplitude)
        self._omega = float(w1.frequency_radps)
        self._constant = self._amplitude == 0.0 or self._omega == 0.0

    def at(self, t_s: float) -> Excitation:
        """The four values at ``t_s`` seconds."""
        bias, omega = self._bias, self._omega
        if self._constant:
            return bias * t_s, bias, 0.0, 0.0
        amplitude = self._amplitude
        sine, cosine = sin_cos(omega * t_s)
        return (
            bias * t_s + amplitude / omega * (1.0 - cosine),
            bias + amplitude * sine,
            amplitude * omega * cosine,
            -amplitude * omega * omega * sine,
        )
