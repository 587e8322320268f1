"""Links chosen by key expression, for traffic between two networks. No session, clock or thread.

The file: ``seed``, ``[network.default]`` and ``[[network.links]]`` with ``key``,
``direction`` and what differs from the default. Each entry is a link, one way or
both; a message goes over the link of the last entry that matches its key, or over
the default one. Messages on one link contend for its rate.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import zenoh
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from formnet.netem.core.statistics import LinkStatistics, Tally
from formnet.netem.core.transit import Transit
from formnet.netem.files.from_file import Reading
from formnet.netem.files.problems import Problem, problems
from formnet.netem.files.tables import STRICT, Table
from formnet.netem.files.toml import read_toml
from formnet.netem.settings.actions import Change, Cut, Heal
from formnet.netem.settings.links import LinkOverrides, LinkSettings, SettingError
from formnet.netem.settings.timeline import Timeline

Direction = Literal["forward", "backward"]
DIRECTIONS: tuple[Direction, ...] = ("forward", "backward")
DEFAULT = "default"
"""The name of the link of what no entry matches."""
_WINDOW = 100_000  # arrivals by which quantiles go
_MOST_KEYS = 100_000  # whose lane is remembered
_MOST_STREAMS = 10_000  # keys of a lane that draw from random streams of their own


def checked_keys(text: str) -> str:
    """``text`` if it is a key expression.

    Raises:
        ValueError: it is none.
    """
    try:
        zenoh.KeyExpr(text)
    except zenoh.ZError:
        raise ValueError(f"{text!r} is not a key expression, such as robot/** or */pose") from None
    return text


def _checked_name(text: str) -> str:
    if text == DEFAULT:
        raise ValueError(f"{DEFAULT!r} is the name of the link of all other keys; write {text}/**")
    return checked_keys(text)


class LaneRule(LinkOverrides):
    """``[[network.links]]``: what differs for keys that match ``key``, one way or both.

    ``forward`` is from the network of --from to that of --to.
    """

    key: Annotated[str, AfterValidator(_checked_name)]
    direction: Literal["forward", "backward", "both"] = "both"

    def covers(self, direction: Direction, key: str) -> bool:
        """Whether the rule is about messages of ``key`` in ``direction``."""
        if self.direction not in ("both", direction):
            return False
        return zenoh.KeyExpr(self.key).intersects(key)


class LaneTables(Table):
    """``[network]``."""

    default: LinkSettings = LinkSettings()
    links: list[LaneRule] = []


class LaneFile(Table):
    """A network file; ``[network]`` reads as in a scenario, but for the selectors."""

    seed: Annotated[int, Field(ge=0)] = 1
    network: LaneTables = LaneTables()


class NetworkFileError(ValueError):
    """A network file that cannot be used; ``problems`` holds everything found."""

    def __init__(self, file: str, found: list[Problem]) -> None:
        self.problems = found
        super().__init__("\n".join(f"{file}: {problem}" for problem in found))


def load(path: Path) -> LaneFile:
    """Read and validate a network file.

    Raises:
        NetworkFileError: with every problem, or the one that stopped the reading.
    """
    try:
        data = read_toml(path)
    except ValueError as error:
        raise NetworkFileError(str(path), [Problem("", None, str(error))]) from None
    try:
        file = LaneFile.model_validate(data, context={"folder": path.parent, "reading": Reading()})
    except ValidationError as error:
        raise NetworkFileError(str(path), problems(LaneFile, data, error)) from None
    for index, rule in enumerate(file.network.links):
        try:
            file.network.default.changed(rule.values())
        except SettingError as error:
            place = f"network.links[{index}].{error.problem.place}"
            raise NetworkFileError(str(path), [error.problem._replace(place=place)]) from None
    return file


class Lane:
    """One link in use: its settings over time, and what became of its messages.

    ``name`` is ``default`` or the key of its entry.
    """

    def __init__(self, seed: int, direction: Direction, name: str, settings: LinkSettings) -> None:
        self.direction = direction
        self.name = name
        self.link = settings.link(seed=seed, source=direction, destination=name)
        self.timeline = Timeline(settings, link=self.link)
        self.sequence = 0
        self._kinds: set[str] = set()
        self._tally = Tally(_WINDOW)

    def kind_of(self, key: str) -> str:
        """The kind of message that one of ``key`` is: the first 10,000 keys each have their own."""
        if key not in self._kinds:
            if len(self._kinds) >= _MOST_STREAMS:
                return ""
            self._kinds.add(key)
        return key

    def note_sent(self, copies: list[Transit]) -> None:
        """Count a message."""
        self._tally.sent(copies[0].sent_ns, len(copies))
        self.note_lost([copy for copy in copies if copy.lost])

    def note_lost(self, copies: list[Transit]) -> None:
        """Count copies that were lost."""
        for copy in copies:
            self._tally.lost(copy.fate)

    def note_arrived(self, copy: Transit, now_ns: int) -> None:
        """Count a copy that has arrived now."""
        self._tally.arrived(copy.sent_ns, now_ns, copy.fate)

    def statistics(self, now_ns: int) -> LinkStatistics:
        """What became of the messages up to now."""
        return self._tally.at(now_ns)


class Request(BaseModel):
    """What a change of links in use begins with: which; by default all of them, both ways."""

    model_config = ConfigDict(**STRICT)
    link: str | None = None
    direction: Literal["forward", "backward", "both"] = "both"

    def covers(self, lane: Lane) -> bool:
        """Whether ``lane`` is meant."""
        return self.link in (None, lane.name) and self.direction in ("both", lane.direction)

    def action(self) -> Change | Cut | Heal:
        """What to do to the lanes."""
        raise TypeError(type(self))


class ChangeRequest(Request, LinkOverrides):
    """Replace exactly the settings that are named."""

    def action(self) -> Change | Cut | Heal:
        return Change(self.values())


class CutRequest(Request):
    """Lose everything from now on, and what is in flight if asked to."""

    in_flight: Literal["kept", "lost"] = "kept"

    def action(self) -> Change | Cut | Heal:
        return Cut(lose_in_flight=self.in_flight == "lost")


class HealRequest(Request):
    """Carry messages again."""

    def action(self) -> Change | Cut | Heal:
        return Heal()


class Lanes:
    """All links between two networks: in each direction the default one, and one an entry."""

    def __init__(self, file: LaneFile) -> None:
        self._rules = file.network.links
        self._lanes: dict[tuple[Direction, str], Lane] = {}
        self._by_key: dict[tuple[Direction, str], Lane] = {}
        default = file.network.default
        for direction in DIRECTIONS:
            made = {DEFAULT: default} | {
                rule.key: default.changed(rule.values())
                for rule in self._rules
                if rule.direction in ("both", direction)
            }
            for name, settings in made.items():
                self._lanes[direction, name] = Lane(file.seed, direction, name, settings)

    def __iter__(self) -> Iterator[Lane]:
        return iter(self._lanes.values())

    def of(self, direction: Direction, key: str) -> Lane:
        """The lane of messages of ``key`` in ``direction``."""
        lane = self._by_key.get((direction, key))
        if lane is None:
            matching = [rule.key for rule in self._rules if rule.covers(direction, key)]
            lane = self._lanes[direction, matching[-1] if matching else DEFAULT]
            if len(self._by_key) >= _MOST_KEYS:
                self._by_key.clear()
            self._by_key[direction, key] = lane
        return lane

    def do(self, request: Request, now_ns: int) -> list[Lane]:
        """Do what is asked to the lanes that are meant.

        Raises:
            SettingError: a lane does not admit it; nothing has changed.
            LookupError: no lane is meant; the text names those there are.
        """
        meant = [lane for lane in self._lanes.values() if request.covers(lane)]
        if not meant:
            names = ", ".join(sorted({lane.name for lane in self._lanes.values()}))
            raise LookupError(f"there is no link {request.link!r} (links: {names})")
        action = request.action()
        if isinstance(action, Change):
            for lane in meant:
                lane.timeline.settings.changed(action.values)
        for lane in meant:
            lane.note_lost(lane.timeline.do(now_ns, action))
        return meant

    def described(self) -> list[dict[str, Any]]:
        """Every lane's settings as they are."""
        return [
            {
                "link": lane.name,
                "direction": lane.direction,
                "cut": lane.timeline.is_cut,
                **lane.timeline.settings.model_dump(exclude_none=True),
            }
            for lane in self
        ]
