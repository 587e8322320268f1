"""``messages`` and ``links``: what became of the messages, of all links and of each one."""

from collections.abc import Sequence
from typing import Any, Literal

from pydantic import Field

from formnet.formation.records import events as kinds
from formnet.formation.records.events import Event
from formnet.formation.records.rows import LinkRow
from formnet.lab.verdict.section import Count, Listed, PositiveCount, RobotId, Section

Process = RobotId | Literal["plant"]


class Rejected(Section):
    """Messages that a process refused: damaged, not of this run, or not what they claim to be."""

    robot: Process = Field(description="Who refused them.")
    source: Process = Field(description="From whom they were.")
    reason: str = Field(description="What was wrong with them.")
    times: Count = Field(description="How many.")


class Refused(Section):
    """Something that the hub's access control denied."""

    who: str = Field(description="The name on the certificate.")
    key: str = Field(description="The key on the bus.")
    times: Count = Field(description="How often, at least.")


class Disconnected(Section):
    """A party with a certificate whose connection the hub closed."""

    who: str = Field(description="The name on the certificate.")
    reason: str = Field(description="Why.")
    times: Count = Field(description="How often, at least.")


class Messages(Section):
    """The messages of all links together."""

    sent: Count = Field(description="Messages sent, one for each receiver.")
    fates: dict[str, PositiveCount] = Field(
        description="How many copies were delivered, in flight at the end, or lost, by cause."
    )
    rejected: Listed[Rejected] = Field(description="What receivers refused.")
    refused: Listed[Refused] = Field(description="What the hub's access control denied.")
    disconnected: Listed[Disconnected] = Field(
        default=[], description="Whose connections the hub closed; older files lack it."
    )

    @property
    def lost(self) -> int:
        """Copies lost, of whatever cause."""
        return sum(count for fate, count in self.fates.items() if fate.startswith("lost"))

    @property
    def copies(self) -> int:
        """All copies, duplicates included."""
        return sum(self.fates.values())


class Delays(Section):
    """The delays of one link's messages."""

    min: float = Field(description="The shortest.")
    mean: float = Field(description="The mean.")
    p50: float = Field(description="The median.")
    p95: float = Field(description="The 95th percentile.")
    p99: float = Field(description="The 99th percentile.")
    max: float = Field(description="The longest.")


class LinkTraffic(Section):
    """One direction of one link that carried something."""

    source: RobotId = Field(description="The robot that sends.")
    destination: RobotId = Field(description="The robot that receives.")
    sent: PositiveCount = Field(description="Messages sent.")
    delivered: Count = Field(description="Copies that arrived, duplicates and damaged included.")
    duplicated: Count = Field(description="Copies beyond the first that arrived.")
    corrupted: Count = Field(description="Copies that arrived damaged.")
    in_flight: Count = Field(description="Copies still on their way at the end.")
    lost: dict[str, PositiveCount] = Field(description="Copies lost, by cause.")
    delay_s: Delays | None = Field(description="From sending to arrival; null if nothing arrived.")
    jitter_s: float = Field(description="Interarrival jitter (RFC 3550, 6.4.1) at the end.")
    longest_silence_s: float = Field(description="The longest stretch without an arrival.")


def messages(events: Sequence[Event], rows: Sequence[LinkRow]) -> Messages:
    """The section ``messages``."""
    fates: dict[str, int] = {}
    for row in rows:
        fates[row.fate] = fates.get(row.fate, 0) + 1
    return Messages(
        sent=len({(row.source, row.destination, row.sequence) for row in rows}),
        fates=dict(sorted(fates.items())),
        rejected=[
            Rejected(robot=robot, source=source, reason=reason, times=times)
            for (robot, source, reason), times in rejections(events).items()
        ],
        refused=_refused(events),
        disconnected=_disconnected(events),
    )


def rejections(events: Sequence[Event]) -> dict[tuple[Any, Any, str], int]:
    """How many messages each receiver refused, by receiver, source and reason."""
    found: dict[tuple[Any, Any, str], int] = {}
    for event in events:
        if isinstance(event, kinds.Rejected):
            found[event.robot, event.source, event.reason] = event.times
    return found


def _refused(events: Sequence[Event]) -> list[Refused]:
    """The latest count of every denial."""
    times = {
        (event.who, event.key): event.times for event in events if isinstance(event, kinds.Refused)
    }
    return [Refused(who=who, key=key, times=count) for (who, key), count in times.items()]


def _disconnected(events: Sequence[Event]) -> list[Disconnected]:
    """The latest count of every party and reason."""
    times = {
        (event.who, event.reason): event.times
        for event in events
        if isinstance(event, kinds.Disconnected)
    }
    return [
        Disconnected(who=who, reason=reason, times=count) for (who, reason), count in times.items()
    ]


def links(rows: Sequence[LinkRow], end_ns: int) -> list[LinkTraffic]:
    """The section ``links``: every directed link that carried something, ascending."""
    from formnet.netem.core.statistics import Fate, summarise  # loads NumPy

    fates: dict[tuple[int, int], list[Fate]] = {}
    for row in rows:
        fate = Fate(row.sequence, row.t_sent_ns, row.t_usable_ns, row.fate)
        fates.setdefault((row.source, row.destination), []).append(fate)
    return [
        LinkTraffic.model_validate(
            {"source": source, "destination": destination, **summarise(own, end_ns)._asdict()}
        )
        for (source, destination), own in sorted(fates.items())
    ]
