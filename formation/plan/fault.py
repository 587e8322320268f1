"""``kill``, ``restart``, ``pause`` and ``resume``: what happens to robots."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from formnet.formation.plan.roster import Span, Verb
from formnet.formation.plan.selectors import RobotId, named
from formnet.netem.core.streams import stream
from formnet.netem.files.tables import PositiveSeconds, Seconds, Table, nanoseconds
from formnet.netem.settings.timeline import NEVER


class RandomRobots(Table):
    """``robots = { random = 2 }``: so many of those it can happen to, drawn by the seed."""

    random: Annotated[int, Field(ge=1)] = Field(
        description="How many, drawn with the seed from the robots to which the action can apply."
    )


def _kind_of_selector(value: object) -> str:
    if isinstance(value, str):
        return "all"
    if isinstance(value, int):
        return "one"
    return "list" if isinstance(value, list) else "random"


FaultyRobots = Annotated[
    Annotated[Literal["*"], Tag("all")]
    | Annotated[RobotId, Tag("one")]
    | Annotated[list[RobotId], Field(min_length=1), Tag("list")]
    | Annotated[RandomRobots, Tag("random")],
    Discriminator(_kind_of_selector),
]
"""Robots by one id, a list of ids, ``"*"`` for all, or a random choice."""


class _FaultAction(Table):
    """What an action on robots begins with: when (the first tick from then on), and which."""

    at_s: Seconds = Field(description="Time; applies at the first control tick from then on.")
    robots: FaultyRobots = Field(
        description='An id, a list of ids, "*" for all, or `{ random = 2 }`.'
    )

    def named_robots(self) -> list[int]:
        """The robots that are spelt out."""
        return [] if isinstance(self.robots, RandomRobots) else named(self.robots)


class KillAction(_FaultAction):
    """``action = "kill"``: the robot's process gets SIGKILL before it senses that tick."""

    action: Literal["kill"] = Field(description="The process gets SIGKILL.")
    restart_after_s: PositiveSeconds | None = Field(
        default=None, description="Restarts the same robots after this time."
    )


class RestartAction(_FaultAction):
    """``action = "restart"``: a new process that remembers nothing takes part from that tick on."""

    action: Literal["restart"] = Field(description="Starts a new process without memory.")


class PauseAction(_FaultAction):
    """``action = "pause"``: the process gets SIGSTOP and misses ticks from that one on."""

    action: Literal["pause"] = Field(description="The process gets SIGSTOP and misses ticks.")
    resume_after_s: PositiveSeconds | None = Field(
        default=None, description="Resumes the same robots after this time."
    )


class ResumeAction(_FaultAction):
    """``action = "resume"``: SIGCONT; the robot takes part again, with what came meanwhile."""

    action: Literal["resume"] = Field(
        description="The process gets SIGCONT and continues, with the messages received meanwhile."
    )


FaultAction = KillAction | RestartAction | PauseAction | ResumeAction


class FaultError(ValueError):
    """Actions of the timeline cannot happen; the text says to whom and why.

    ``problems`` holds that by the number of the action.
    """

    def __init__(self, problems: Mapping[int, str]) -> None:
        self.problems = problems
        super().__init__("; ".join(problems.values()))


class _Impossible(Exception):
    """Why an action cannot happen."""


_NEEDS: dict[Verb, tuple[str, ...]] = {
    "kill": ("up", "paused"),
    "pause": ("up",),
    "restart": ("killed",),
    "resume": ("paused",),
}
_WORDS = {"up": "is up", "paused": "is paused", "killed": "is dead"}
_DONE: dict[Verb, str] = {
    "kill": "killed",
    "pause": "paused",
    "restart": "restarted",
    "resume": "resumed",
}
_FOR_A_TICK: dict[Verb, str] = {"kill": "down", "pause": "stopped", "restart": "up"}
"""What a robot must be for one tick at least after a verb; what is resumed may fail at once."""


@dataclass
class _State:
    now: str = "up"
    since: int = 0
    last: Verb | None = None
    spans: list[Span] = field(default_factory=list)

    def undergo(self, verb: Verb, tick: int) -> None:
        self.end_span(tick)
        self.now, self.since, self.last = _BECOMES[verb], tick, verb

    def end_span(self, tick: int) -> None:
        if self.now != "up":
            self.spans.append(Span(self.since, tick, self.now == "killed"))


_BECOMES: dict[Verb, str] = {"kill": "killed", "pause": "paused", "restart": "up", "resume": "up"}


def spans_of(
    actions: Iterable[tuple[int, object]], robots: Sequence[int], seed: int, period_ns: int
) -> dict[int, list[Span]]:
    """When each robot is down, by the fault actions among ``actions`` (with their indices).

    Actions of one tick happen in the order of the file; one at an instant between ticks
    happens at the next.

    Raises:
        FaultError: actions that cannot happen, such as the restart of a robot that lives.
    """
    ahead: list[tuple[int, int, int, Verb, FaultyRobots | None]] = []
    for index, action in actions:
        if not isinstance(action, FaultAction):
            continue
        at_ns = nanoseconds(action.at_s)
        ahead.append((-(-at_ns // period_ns), index, 0, action.action, action.robots))
        after_s, verb = None, action.action
        if isinstance(action, KillAction):
            after_s, verb = action.restart_after_s, "restart"
        elif isinstance(action, PauseAction):
            after_s, verb = action.resume_after_s, "resume"
        if after_s is not None:
            end_ns = at_ns + nanoseconds(after_s)
            ahead.append((-(-end_ns // period_ns), index, 1, verb, None))
    states = {robot: _State() for robot in robots}
    chosen: dict[int, list[int]] = {}
    problems: dict[int, str] = {}
    for tick, index, _, verb, whom in sorted(ahead, key=lambda item: item[:3]):
        if index in problems:
            continue
        try:
            if whom is not None:
                chosen[index] = _chosen(whom, verb, states, seed, index)
            for robot in chosen[index]:
                _happen(verb, robot, states[robot], tick)
        except _Impossible as error:
            problems[index] = str(error)
    if problems:
        raise FaultError(problems)
    for state in states.values():
        state.end_span(NEVER)
    return {robot: state.spans for robot, state in states.items() if state.spans}


def _happen(verb: Verb, robot: int, state: _State, tick: int) -> None:
    just = state.last if state.since == tick else None  # what else befell it at this tick
    if state.now not in _NEEDS[verb]:
        since = f"{_WORDS[state.now]} then" if just is None else f"is {_DONE[just]} at that tick"
        raise _Impossible(f"cannot {verb} robot {robot}: it {since}")
    if just in _FOR_A_TICK:
        raise _Impossible(
            f"cannot {verb} robot {robot}: it is {_DONE[just]} at that tick, and must be "
            f"{_FOR_A_TICK[just]} for at least one tick before it is {_DONE[verb]}"
        )
    state.undergo(verb, tick)


def _chosen(
    whom: FaultyRobots, verb: Verb, states: dict[int, _State], seed: int, index: int
) -> list[int]:
    if not isinstance(whom, RandomRobots):
        return list(states) if whom == "*" else list(dict.fromkeys(named(whom)))
    candidates = [robot for robot, state in states.items() if state.now in _NEEDS[verb]]
    if len(candidates) < whom.random:
        raise _Impossible(f"random = {whom.random}: {verb} is possible for {len(candidates)}")
    random = stream(seed, "timeline", index, "robots")
    drawn = sorted((random.random(), robot) for robot in candidates)[: whom.random]
    return [robot for _, robot in sorted(drawn, key=lambda item: candidates.index(item[1]))]
