"""(a) The cost of a lockstep tick against the bare exchange and against HELICS.

Five robots on the ring of Section 5, control every 1 ms, broadcasts every
10 ms. The three take turns in every round; a ratio is taken within its round.
"""

from pathlib import Path

from benchmarks import bare, formnet_run, helics_fed
from benchmarks.plan import Plan
from benchmarks.scenarios import section5
from benchmarks.table import BenchmarkError, Row, Target

OVER_BARE = Target("<=", 1.3)
HELICS_OVER = Target(">=", 4.0)
NOT_INSTALLED = "not installed: pip install -e .[benchmark]"

_FORMNET, _BARE, _HELICS = "formnet tick, n = 5", "bare Zenoh exchange", "HELICS exchange"


def measure(plan: Plan, folder: Path) -> list[Row]:
    """All rounds.

    Raises:
        BenchmarkError: formnet or the bare exchange failed; HELICS failing is only noted.
    """
    scenario = section5(plan.ticks)
    robots = len(scenario.ids)
    formnet, plain, helics, over = [], [], [], []
    note = "" if helics_fed.installed() else NOT_INSTALLED
    if plan.skip_helics:
        note = "skipped"
    for number in range(1, plan.rounds + 1):
        place = folder / f"a-{number}"
        plan.say(f"a: round {number} of {plan.rounds}")
        formnet.append(formnet_run.tick_ms(scenario, place / "formnet"))
        plain.append(bare.tick_ms(robots, plan.ticks, place / "bare"))
        if plan.skip_helics or not helics_fed.installed():
            continue
        try:
            helics.append(
                helics_fed.tick_ms(
                    robots, plan.helics_ticks, place / "helics", core=plan.helics_core
                )
            )
            over.append(helics[-1] / formnet[-1])
        except BenchmarkError as error:
            note = f"round {number}: {error}"
    return [
        Row("a", _FORMNET, formnet, "ms"),
        Row("a", _BARE, plain, "ms"),
        Row("a", "formnet / bare", _ratios(formnet, plain), target=OVER_BARE),
        Row("a", f"{_HELICS} ({plan.helics_core})", helics, "ms", note=note),
        Row("a", "HELICS / formnet", over, target=HELICS_OVER, note=note),
    ]


def _ratios(over: list[float], under: list[float]) -> list[float]:
    return [a / b for a, b in zip(over, under, strict=True)]
