"""``[law]``: which control law, and its parameters."""

from typing import Any, Literal

from pydantic import Field

from formnet.netem.files.tables import NonNegative, Positive, Table


class W1(Table):
    """``law.w1``: the excitation w1(t) = bias + amplitude · sin(frequency · t)."""

    bias: float = Field(
        default=0.5, description="Constant part.", json_schema_extra={"unit": "rad/s"}
    )
    amplitude: float = Field(
        default=0.0, description="Amplitude of the sine.", json_schema_extra={"unit": "rad/s"}
    )
    frequency_radps: NonNegative = Field(default=0.0, description="Frequency of the sine.")


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
