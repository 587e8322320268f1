"""``lyapunov``: V along a run (Eq. 22, 34, 40 or 43), V*, and every rise beyond their budgets."""

from typing import TYPE_CHECKING, Any

from pydantic import Field

from formnet.lab.verdict.section import Listed, Section, finite

if TYPE_CHECKING:
    from formnet.lab.judge.lyapunov import Curve
    from formnet.lab.runs.recording import Collected


class RiseOfV(Section):
    """A stretch in which V gained more than its budget."""

    begin_s: float = Field(description="From when.")
    end_s: float = Field(description="To when.")
    gain: float | None = Field(description="What V gained beyond its budget.")
    relative_gain: float | None = Field(description="That, by V at the beginning.")
    causes: Listed[str] = Field(description="What may have made it rise.")


class Falling(Section):
    """A function that never rises if the theory holds, from when all neighbours had been heard."""

    from_s: float | None = Field(
        description="The first instant at which it is the theorem's; null if there is none."
    )
    initial: float | None = Field(description="Its value at that instant.")
    final: float | None = Field(description="Its value at the end.")
    budget: float | None = Field(
        description="What sampling, rounding and the robust term may have added to it in the whole "
        "run."
    )
    may_rise_by: Listed[str] = Field(
        description="What in the scenario lets it rise at any time, against the theorems."
    )
    rises: Listed[RiseOfV] = Field(description="Every rise, in the order of time.")

    @property
    def discriminates(self) -> bool:
        """Whether a rise would show: what it may gain unnoticed is less than it had."""
        if self.initial is None or self.budget is None:
            return False
        return self.budget < self.initial

    @property
    def falls(self) -> bool:
        """Whether it never rises, though a rise would show."""
        return self.discriminates and not self.rises


class Stability(Falling):
    """V along a run, counted from the instant at which all neighbours had been heard."""

    equation: int = Field(description="The equation of the paper that V is of.")
    star: Falling | None = Field(
        default=None,
        description="V* = V + ζ2ᵀN⁻¹ζ2/(2β), which never rises with the printed cross term; null "
        "unless w1 is constant and not 0, the cross term printed, and nothing delayed.",
    )

    @property
    def largest_gain(self) -> float | None:
        """The largest relative gain; 0 without a rise, None where one is not known."""
        gains = [rise.relative_gain for rise in self.rises]
        known = [gain for gain in gains if gain is not None]
        return max(known, default=0.0) if len(known) == len(gains) else None

    def in_words(self, *, diverged: bool) -> str | None:
        """When V rose first and, in a run that diverged, last, and why; None if it did not."""
        if not self.rises:
            return None
        told = {"first": self.rises[0]}
        if diverged and len(self.rises) > 1:
            told["last"] = self.rises[-1]
        words = [
            f"{which} from {rise.begin_s:.2f} to {rise.end_s:.2f} s: {'; '.join(rise.causes)}"
            for which, rise in told.items()
        ]
        often = "once" if len(self.rises) == 1 else f"{len(self.rises)} times"
        beside = "; V* never rises" if self.star is not None and self.star.falls else ""
        return f"V (Eq. {self.equation}) rises {often}, {', and '.join(words)}{beside}"


def stability(recording: "Collected") -> Stability | None:
    """The section ``lyapunov``; None where V is not defined, or without samples."""
    from formnet.lab.judge import lyapunov  # loads NumPy
    from formnet.lab.judge.rises import rises, standing_causes

    found = lyapunov.curves(recording)
    if found is None:
        return None

    def falling(curve: "Curve", causes: list[str]) -> dict[str, Any]:
        first = int(curve.whole.argmax()) if curve.whole.any() else None
        return {
            "from_s": None if first is None else float(curve.t_s[first]),
            "initial": None if first is None else finite(curve.v[first]),
            "final": finite(curve.v[-1]),
            "budget": None if first is None else finite(curve.budget[first + 1 :].sum()),
            "may_rise_by": causes,
            "rises": [
                RiseOfV(
                    begin_s=rise.begin_s,
                    end_s=rise.end_s,
                    gain=finite(rise.gain),
                    relative_gain=finite(rise.relative_gain),
                    causes=rise.causes,
                )
                for rise in rises(recording, curve, causes)
            ],
        }

    scenario, star = recording.scenario, found.star
    return Stability(
        equation=lyapunov.equation(scenario),
        **falling(found.v, standing_causes(scenario)),
        star=None
        if star is None
        else Falling(**falling(star, standing_causes(scenario, star=True))),
    )
