"""``[law]``: which control law, and its parameters."""

import re
from collections.abc import Iterator
from math import isfinite
from typing import Any, Literal

from pydantic import Field, field_validator

from formnet.netem.files.problems import shown
from formnet.netem.files.tables import NonNegative, Positive, Table

BY_FILE = re.compile(r"(?:\w[\w.-]*/)*\w[\w.-]*\.py:[^\W\d]\w*", re.ASCII)
"""Neither an absolute path nor one with ``..`` in it."""


class W1(Table):
    """``law.w1``: the excitation w1(t) = bias + amplitude · sin(frequency · t)."""

    bias: float = Field(
        default=0.5, description="Constant part.", json_schema_extra={"unit": "rad/s"}
    )
    amplitude: float = Field(
        default=0.0, description="Amplitude of the sine.", json_schema_extra={"unit": "rad/s"}
    )
    frequency_radps: NonNegative = Field(default=0.0, description="Frequency of the sine.")

    @property
    def constant(self) -> bool:
        """Whether w1 is ``bias`` at all times."""
        return self.amplitude == 0.0 or self.frequency_radps == 0.0


class LawSettings(Table):
    """``[law]``: the control law and its parameters, named as in the paper."""

    kind: str = Field(
        default="cooperative",
        description=(
            '"cooperative", "leader_follower", the name of an installed plug-in (`formnet laws`), '
            "or `FILE.py:NAME`, code in a file below the folder of the scenario, which is executed "
            "only if its user allows it."
        ),
    )
    level: Literal["kinematic", "dynamic"] = Field(
        default="dynamic",
        description="Commands are velocities (Theorems 1, 2, 5) or torques (3, 4, 6).",
    )
    beta: Positive = Field(
        default=10.0,
        description="β: couples lateral errors into the turn rate.",
        json_schema_extra={"unit": "s"},
    )
    w1: W1 = Field(
        default=W1(),
        description=(
            "The excitation; the headings keep turning with it. Zero violates Assumption 2."
        ),
    )
    feedback_gain: Positive = Field(
        default=10.0,
        description="K: gain with which velocities follow the desired ones.",
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
        default=True,
        description="Whether the robust term of Eq. 31 (against wrong estimates) is on.",
    )
    gamma: Positive = Field(
        default=0.1,
        description="γ: the boundary layer shrinks as exp(−γ t).",
        json_schema_extra={"unit": "1/s"},
    )
    boundary_layer: Positive = Field(
        default=1.0,
        description="ε: boundary layer of the robust term in Eq. 31, in the law's units.",
    )
    length_scale_m: Positive = Field(
        default=1.0,
        description=(
            "ℓ: the law's unit of length in metres; about the initial distance of the robots "
            "from their places."
        ),
    )
    delta: Literal["corrected", "printed"] = Field(
        default="corrected",
        description=(
            "The sign of Δ in Eq. 19: as the proofs require, or as printed (which diverges)."
        ),
    )
    cross_term: Literal["printed", "compensated"] = Field(
        default="printed",
        description=(
            "Keep w1 z2 z3, as printed, or cancel it: then V never rises, but the centroid also "
            "converges in Theorems 1 and 3."
        ),
    )
    parameters: dict[str, Any] = Field(
        default={}, description="Parameters of a law other than the cooperative one."
    )

    @property
    def file(self) -> tuple[str, str] | None:
        """The file, relative to the scenario's folder, and the name in it that ``kind`` says.

        None if ``kind`` is the name of an installed law.
        """
        file, colon, name = self.kind.rpartition(":")
        return (file, name) if colon else None

    @field_validator("kind")
    @classmethod
    def _installed_or_below(cls, kind: str) -> str:
        if ":" in kind and not BY_FILE.fullmatch(kind):
            raise ValueError(
                "must be the name of an installed law, or FILE.py:NAME with a file below the "
                "scenario's folder (in its path letters, digits, . _ - and / alone)"
            )
        return kind

    @field_validator("parameters")
    @classmethod
    def _plain(cls, parameters: dict[str, Any]) -> dict[str, Any]:
        """Only what every robot can be told: a date or an infinite number is refused."""
        for place, value in _leaves(parameters, ""):
            number = isinstance(value, int | float)
            if not (isinstance(value, str) or (number and isfinite(value))):
                raise ValueError(
                    f"{place} = {shown(value)}: must be text, a finite number, true or false, a "
                    "list or a table"
                )
        return parameters


def _leaves(value: Any, place: str) -> Iterator[tuple[str, Any]]:
    """Every value in nested tables and lists, with its place."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _leaves(item, f"{place}.{key}" if place else key)
    elif isinstance(value, list):
        for number, item in enumerate(value):
            yield from _leaves(item, f"{place}[{number}]")
    else:
        yield place, value
