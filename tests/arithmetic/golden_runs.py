"""Short runs that together have every law, distribution, impairment and action, each as one hash.

The hash is over every bit of the states, every message's fate and every event. Nothing but the
base install without Zenoh and NumPy is needed: ``python golden_runs.py [NAME...]`` prints the
hashes as JSON, also on another processor.
"""

import hashlib
import json
import struct
import sys
from collections.abc import Iterator
from typing import Any

from complete_links import COMPLETE

from formnet.agent.cooperative import CooperativeLaw
from formnet.agent.law import LawFactory
from formnet.agent.leader_follower import LeaderFollowerLaw
from formnet.formation.briefing.resolving import resolve
from formnet.formation.records.checked import plain
from formnet.formation.records.events import Event
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.rows import LinkRow, LinkRows, Samples
from formnet.formation.records.stream import Record
from formnet.formation.scenario.loading import load
from formnet.lab.launch.inline import Inline
from formnet.lab.scenarios.packaged import CONFIGS

LAWS: dict[str, LawFactory] = {"cooperative": CooperativeLaw, "leader_follower": LeaderFollowerLaw}
"""By name, for where formnet is not installed and has no entry points."""
SECTION5 = "paper/section5-delay"
SHORT = "duration_s=1.0"
COARSE = "clock.control_period_s=0.002"
BODIES = (
    "robot_defaults.com_offset_m=0.05",
    "robot_defaults.linear_friction_nspm=0.4",
    "robot_defaults.angular_friction_nmsprad=0.05",
    "robot_defaults.disturbance_force_n=0.1",
    "robot_defaults.wheel_torque_limit_nm=3.0",
    "law.w1={bias=0.5, amplitude=0.3, frequency_radps=1.0}",
)


def _text(table: dict[str, Any]) -> str:
    """A table of a link's settings as TOML has it inline."""
    pairs = [f"{key}={json.dumps(value)}" for key, value in table.items()]
    return "{" + ", ".join(pairs) + "}"


def _delays() -> Iterator[tuple[str, tuple[str, tuple[str, ...]]]]:
    """One run for every distribution of delays, each with another loss and more."""
    extras = [key for key in COMPLETE if key not in ("delay", "loss")]
    for number, delay in enumerate(COMPLETE["delay"]):
        name = delay["distribution"]
        loss = COMPLETE["loss"][number % len(COMPLETE["loss"])]
        more = extras[number % len(extras)]
        table = COMPLETE[more][0]
        if more == "rate":
            table = table | {"bits_per_s": 50000}
        links = (
            f"network.default.delay={_text(delay)}",
            f"network.default.loss={_text(loss)}",
            f"network.default.{more}={_text(table)}",
        )
        yield f"delay-{name}", (SECTION5, (SHORT, *links))


RUNS: dict[str, tuple[str, tuple[str, ...]]] = {
    "section5": ("paper/section5", (SHORT,)),
    "section5-delay": (SECTION5, ("duration_s=3.0",)),
    "theorem1": ("paper/theorem1", (SHORT,)),
    "theorem4-bodies": ("paper/theorem4", (SHORT, *BODIES)),
    "leader-follower": ("faults/leader-follower", ("duration_s=2.0",)),
    "leader-follower-dynamic": ("faults/leader-follower", (SHORT, "law.level=dynamic")),
    "every-action": ("network/every-action", ("clock.control_period_s=0.01",)),
    "every-fault": ("faults/every-fault", (COARSE, "duration_s=11.0")),
    "coast": ("faults/every-fault", (COARSE, "duration_s=3.0", "plant.body_on_failure=coast")),
    "freeze": ("faults/every-fault", (COARSE, "duration_s=3.0", "plant.body_on_failure=freeze")),
    "wifi": (SECTION5, (SHORT, 'network.default={preset="wifi-congested"}')),
    **dict(_delays()),
}


def golden(name: str) -> str:
    """The hash of a run."""
    file, overrides = RUNS[name]
    digest = hashlib.sha256()
    links: list[LinkRow] = []
    events: list[Any] = []

    def take(record: Record) -> None:
        match record:
            case Samples():
                for sample in record.rows:
                    numbers = [float("nan") if x is None else x for x in sample[2:]]
                    digest.update(struct.pack(f"<qq{len(numbers)}d", *sample[:2], *numbers))
            case LinkRows():
                links.extend(record.rows)
            case Event() | Outcome():
                events.append([type(record).__name__, plain(record)])

    scenario = load(CONFIGS / f"{file}.toml", overrides)
    outcome = Inline(law=LAWS[scenario.law.kind]).run(resolve(scenario), take)
    assert outcome.kind == "completed", outcome
    rows = sorted(links, key=lambda row: (row.source, row.destination, row.sequence, str(row)))
    digest.update(json.dumps([list(row) for row in rows]).encode())
    digest.update(json.dumps(events).encode())
    return digest.hexdigest()[:24]


if __name__ == "__main__":
    print(json.dumps({name: golden(name) for name in sys.argv[1:] or RUNS}, indent=1))
