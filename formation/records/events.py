"""What happens in a run: a class for each event.

An event's class has all there is to say of it: its name in ``events.jsonl``, its fields there
(in this order, after the time), how severe it is for whoever watches, and how it reads. A class
that names itself is known to every reader::

    @dataclass(frozen=True)
    class Stuck(Event, name="stuck", severity=Severity.WARNING):
        \"\"\"A robot's wheels turn and it does not.\"\"\"

        robot: RobotId

Whoever acts on some events asks for their classes (``match``, ``isinstance``).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, ClassVar, Literal

from formnet.formation.records.checked import (
    KEY,
    Count,
    Malformed,
    Nanoseconds,
    RobotId,
    Robots,
    plain,
    read,
)
from formnet.formation.records.motion import Closest, TopSpeed, TopTorque, TopTurnRate


class Severity(Enum):
    """How much a reader should care."""

    DEBUG = "for who asks for it"
    INFO = "as it should be"
    WARNING = "worth a look"
    ERROR = "something went wrong that nobody planned"


def named(robots: Sequence[object]) -> str:
    """``robot 3``, or ``robots 3, 4``."""
    return f"robot{'s' * (len(robots) != 1)} {', '.join(map(str, robots))}"


@dataclass(frozen=True)
class Event:
    """Something that happened at ``t_ns`` of the run's time."""

    name: ClassVar[str]
    severity: ClassVar[Severity] = Severity.INFO

    t_ns: Nanoseconds

    def __init_subclass__(
        cls, *, name: str | None = None, severity: Severity | None = None, **others: Any
    ) -> None:
        super().__init_subclass__(**others)
        if name is not None:
            assert name not in EVENTS, name
            cls.name = name
            EVENTS[name] = cls
        if severity is not None:
            cls.severity = severity

    @property
    def details(self) -> dict[str, Any]:
        """All but the time, as it stands in ``events.jsonl``."""
        found: dict[str, Any] = plain(self)
        del found["t_ns"]
        return found

    @property
    def words(self) -> str:
        """The details for people; empty where the name says it all."""
        return "; ".join(
            _in_words(key, value) for key, value in self.details.items() if value not in ("", None)
        )


EVENTS: dict[str, type[Event]] = {}
"""Every event by its name; each class enters itself."""


def event(name: object, t_ns: int, details: object, robots: Robots = None) -> Event:
    """The event of this name with these details (:attr:`Event.details`).

    Raises:
        Malformed: there is no such event, or it has other details.
    """
    kind = EVENTS.get(name) if isinstance(name, str) else None
    if kind is None:
        raise Malformed.at("event", name, f"is none of {', '.join(EVENTS)}")
    return read(kind, details, robots, kind.name, t_ns=t_ns)


def _in_words(key: str, value: object) -> str:
    if key in ("what", "reason"):
        return str(value)
    if not isinstance(value, list):
        return f"{key} {value}"
    return named(value) if key == "robots" else f"{key} {', '.join(map(str, value))}"


# --- of the run -----------------------------------------------------------------------


@dataclass(frozen=True)
class Started(Event, name="started"):
    """All robots have met their neighbours, before the first tick."""

    robots: tuple[RobotId, ...]


@dataclass(frozen=True)
class LastTick(Event, name="last tick"):
    """The run has come to its end, and robots are about to hand in their last reports."""


@dataclass(frozen=True)
class Waiting(Event, name="waiting", severity=Severity.WARNING):
    """The run waits for ``robots`` to do ``what``; again and again while it does."""

    what: str = field(metadata={KEY: "for"})
    robots: tuple[RobotId, ...]


@dataclass(frozen=True)
class Network(Event, name="network"):
    """A planned change of the network takes effect: ``what`` the plan says."""

    what: str


# --- of robots ------------------------------------------------------------------------


@dataclass(frozen=True)
class Planned(Event):
    """What a scenario's timeline plans for ``robots``, as it is done."""

    robots: tuple[RobotId, ...]


@dataclass(frozen=True)
class Kill(Planned, name="kill", severity=Severity.WARNING):
    """Processes are killed."""


@dataclass(frozen=True)
class Restart(Planned, name="restart"):
    """Processes that were killed are started anew."""


@dataclass(frozen=True)
class Pause(Planned, name="pause", severity=Severity.WARNING):
    """Processes are stopped."""


@dataclass(frozen=True)
class Resume(Planned, name="resume"):
    """Processes that were stopped go on."""


def planned(verb: str, t_ns: int, robots: Iterable[int]) -> Planned:
    """The event of what a roster calls ``verb``."""
    kind = EVENTS[verb]
    assert issubclass(kind, Planned)
    return kind(t_ns, tuple(robots))


@dataclass(frozen=True)
class Lost(Event, name="lost", severity=Severity.ERROR):
    """A robot is lost, which nobody planned; the run goes on without it from ``tick`` on."""

    robot: RobotId
    reason: str
    tick: Count


@dataclass(frozen=True)
class HostLost(Event, name="host lost", severity=Severity.ERROR):
    """The connection to a machine has ended, and with it the processes of ``robots``.

    ``host`` is its number in the file of hosts (``host 2``), not its name.
    """

    host: str
    robots: tuple[RobotId, ...]
    reason: str


@dataclass(frozen=True)
class SilentAtTheEnd(Event, name="silent at the end", severity=Severity.WARNING):
    """``robots`` did not hand in their last reports."""

    robots: tuple[RobotId, ...]


@dataclass(frozen=True)
class ClockUncertain(Event, name="clock uncertain", severity=Severity.WARNING):
    """In real time: a robot knows the plant's clock worse than ``clock.sync_bound_s`` for once."""

    robot: RobotId
    uncertainty_s: float
    bound_s: float


# --- of messages ----------------------------------------------------------------------

Party = RobotId | Literal["plant"]


@dataclass(frozen=True)
class Rejected(Event, name="rejected", severity=Severity.WARNING):
    """``robot`` refused messages of ``source``: ``times`` so far for this reason.

    It is reported at the first and then at every doubling.
    """

    robot: Party
    source: Party
    reason: str
    times: Count


@dataclass(frozen=True)
class Refused(Event, name="refused", severity=Severity.WARNING):
    """The hub denied ``key`` to ``who``: ``times`` so far, at least.

    That is a party, or the common name of a certificate that does not count. One without any
    rights was denied ``formnet/**``, once for every connection.
    """

    who: str
    key: str
    times: Count


@dataclass(frozen=True)
class Disconnected(Event, name="disconnected", severity=Severity.WARNING):
    """The hub closed a connection, from ``address``, under the certificate's name ``who``.

    It has done so ``times`` so far for this reason; reported at the first and at every doubling.
    """

    who: str
    address: str
    reason: str
    times: Count


# --- at the end -----------------------------------------------------------------------


@dataclass(frozen=True)
class Quantiles:
    """Of durations in seconds."""

    p50: float
    p99: float
    max: float

    @classmethod
    def of(cls, summary: Sequence[float]) -> "Quantiles | None":
        """From those three, or from nothing."""
        return cls(*summary) if summary else None


@dataclass(frozen=True)
class RobotTiming:
    """How a robot kept time: of ``periods`` control periods it missed some.

    ``transit_s``: how long neighbours' messages were on the real network.
    ``clock_uncertainty_s``: the most by which its estimate of the plant's clock may have been off.
    """

    periods: int
    missed: int
    sense_to_drive_s: Quantiles | None
    woke_late_s: Quantiles | None
    transit_s: Quantiles | None
    clock_offset_s: float
    clock_uncertainty_s: float


@dataclass(frozen=True)
class PlantTiming:
    """How the plant kept time."""

    woke_late_s: Quantiles | None


@dataclass(frozen=True)
class Timing(Event, name="timing", severity=Severity.DEBUG):
    """At the end of a run in real time: how well it was kept, by robot."""

    plant: PlantTiming
    robots: dict[RobotId, RobotTiming]

    @property
    def words(self) -> str:
        """The sum; the page of a run and the terminal have a table."""
        missed = sum(own.missed for own in self.robots.values())
        periods = sum(own.periods for own in self.robots.values())
        return f"{missed} of {periods} periods missed (all are in verdict.json)"


@dataclass(frozen=True)
class Extremes(Event, name="extremes"):
    """The extremes of the motion over the ticks of a run, at its end; None what there is not.

    ``top_command`` is a torque at the dynamic level and a speed at the kinematic one.
    """

    closest: Closest | None
    top_speed: TopSpeed | None
    top_turn_rate: TopTurnRate | None
    top_command: TopTorque | TopSpeed | None

    @property
    def titled(self) -> dict[str, str]:
        """Those there are, each in words, by a title."""
        command = "top torque" if isinstance(self.top_command, TopTorque) else "top command"
        found = {
            "closest": self.closest,
            "top speed": self.top_speed,
            "top turn rate": self.top_turn_rate,
            command: self.top_command,
        }
        return {title: some.words for title, some in found.items() if some is not None}

    @property
    def words(self) -> str:
        """All in a line."""
        return "; ".join(f"{title} {words}" for title, words in self.titled.items())
