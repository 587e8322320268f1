"""A link's settings as they stand in a file, and the link they describe."""

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from pydantic import (
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    Tag,
    ValidationError,
    field_validator,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError

from formnet.netem.core.duplicate import Duplicate
from formnet.netem.core.link import Impairment, Link
from formnet.netem.files.problems import Problem, problems
from formnet.netem.files.tables import (
    Count,
    Part,
    Probability,
    Seconds,
    Table,
    members,
    nanoseconds,
    part_of,
)
from formnet.netem.impairments.corrupt import Corrupt
from formnet.netem.impairments.order import KeepOrder
from formnet.netem.impairments.playout import Playout
from formnet.netem.impairments.queue import QueueEntry, QueueExit, QueueLimit
from formnet.netem.impairments.rate import Rate
from formnet.netem.impairments.reorder import Reorder
from formnet.netem.impairments.slots import Slots
from formnet.netem.settings.delays import ConstantDelaySettings, DelaySettings
from formnet.netem.settings.losses import LossSettings, RandomLossSettings
from formnet.netem.settings.presets import PRESETS


class DuplicateSettings(Table):
    """``duplicate = { probability = 0.01 }``"""

    probability: Probability = Field(
        default=0.0, description="Share of messages of which a second copy is sent."
    )


class CorruptSettings(Table):
    """``corrupt = { probability = 0.001 }``"""

    probability: Probability = Field(
        default=0.0, description="Share of messages in which one bit is flipped."
    )


class ReorderSettings(Table):
    """``reorder = { probability = 0.25, gap = 5 }``"""

    probability: Probability = Field(
        default=0.0, description="Share of messages that skip delay and rate."
    )
    gap: Annotated[int, Field(ge=1)] = Field(
        default=1, description="Only every so many messages may."
    )


class RateSettings(Table):
    """``rate = { bits_per_s = 1_000_000, overhead_bytes = 38 }``; 0 bits_per_s: no limit."""

    bits_per_s: Count = Field(default=0, description="Never exceeded; 0: no limit.")
    overhead_bytes: Count = Field(default=0, description="Added to every message.")
    cell_bytes: Count = Field(
        default=0, description="Messages fill whole cells of this size; 0: no cells."
    )
    cell_overhead_bytes: Count = Field(default=0, description="Added to every cell.")


class QueueSettings(Table):
    """``queue = { messages = 1000, bytes = 64_000 }``; 0: no limit."""

    messages: Count = Field(
        default=0, description="What finds so many under way is lost; 0: no limit."
    )
    bytes: Count = Field(default=0, description="Likewise for bytes.")


class SlotsSettings(Table):
    """``slots = { min_s = 0.001, max_s = 0.002, messages = 8, bytes = 1500 }``; max_s = 0: none."""

    min_s: Seconds = Field(default=0.0, description="Shortest time between two slots.")
    max_s: Seconds = Field(default=0.0, description="Longest time between two slots; 0: no slots.")
    messages: Count = Field(default=0, description="At most so many leave in a slot; 0: no limit.")
    bytes: Count = Field(
        default=0, description="At most so many bytes leave in a slot; 0: no limit."
    )

    @model_validator(mode="after")
    def _ordered(self) -> "SlotsSettings":
        if self.max_s and not 1e-9 <= self.min_s <= self.max_s:
            raise ValueError(f"need 1e-9 <= min_s <= max_s, got {self.min_s} and {self.max_s}")
        return self


_KINDS = {"delay": "distribution", "loss": "model"}
"""The tables that come in kinds, and the key that says which."""


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """``base`` with what ``over`` names replaced: key by key in a table that names no kind."""
    merged = dict(base)
    for name, value in over.items():
        old = merged.get(name, {})
        part = isinstance(value, Mapping) and isinstance(old, Mapping)
        merged[name] = {**old, **value} if part and _KINDS.get(name) not in value else value
    return merged


class _Preset(Table):
    """A table that may begin with ``preset = "wifi"``; what it names beside that wins."""

    @model_validator(mode="before")
    @classmethod
    def _expand(cls, data: Any) -> Any:
        if not isinstance(data, Mapping) or "preset" not in data:
            return data
        name = data["preset"]
        if not isinstance(name, str) or name not in PRESETS:
            found = {"key": "preset", "expected": ", ".join(map(repr, PRESETS))}
            raise PydanticCustomError("unknown_preset", "must be one of {expected}", found)
        rest = {key: value for key, value in data.items() if key != "preset"}
        return _merged(_merged(PRESETS["ideal"], PRESETS[name]), rest)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        schema = handler.resolve_ref_schema(handler(core))
        preset = {
            "enum": list(PRESETS),
            "description": "Begin with a named link; what is named beside it wins.",
        }
        schema["properties"] = {"preset": preset} | schema["properties"]
        return schema


if TYPE_CHECKING:
    DelayPart: TypeAlias = Part
    LossPart: TypeAlias = Part
    DuplicatePart: TypeAlias = Part
    CorruptPart: TypeAlias = Part
    ReorderPart: TypeAlias = Part
    RatePart: TypeAlias = Part
    QueuePart: TypeAlias = Part
    SlotsPart: TypeAlias = Part
else:
    DelayPart = part_of(*members(DelaySettings), leave_out="distribution")
    LossPart = part_of(*members(LossSettings), leave_out="model")
    DuplicatePart = part_of(DuplicateSettings)
    CorruptPart = part_of(CorruptSettings)
    ReorderPart = part_of(ReorderSettings)
    RatePart = part_of(RateSettings)
    QueuePart = part_of(QueueSettings)
    SlotsPart = part_of(SlotsSettings)


def _whole_or_part(kind: str) -> Discriminator:
    def which(value: object) -> str:
        if isinstance(value, Mapping):
            return "whole" if kind in value else "part"
        return "part" if isinstance(value, Part) else "whole"

    return Discriminator(which)


class LinkOverrides(_Preset):
    """What a rule names of a link's settings; what it does not name stays.

    A ``delay`` or ``loss`` of a named kind replaces the table; every other table
    changes key by key.
    """

    delay: (
        Annotated[
            Annotated[DelaySettings, Tag("whole")] | Annotated[DelayPart, Tag("part")],
            _whole_or_part("distribution"),
        ]
        | None
    ) = Field(default=None, description="The delay of messages.")
    loss: (
        Annotated[
            Annotated[LossSettings, Tag("whole")] | Annotated[LossPart, Tag("part")],
            _whole_or_part("model"),
        ]
        | None
    ) = Field(default=None, description="Which messages are lost.")
    duplicate: DuplicatePart | None = None
    corrupt: CorruptPart | None = None
    reorder: ReorderPart | None = None
    rate: RatePart | None = None
    queue: QueuePart | None = None
    slots: SlotsPart | None = None
    keep_order: bool | None = Field(
        default=None, description="Whether nothing arrives before what was sent earlier."
    )
    playout_s: Seconds | None = Field(
        default=None,
        description=(
            "Deliver everything this long after its stamp, and lose what comes later; 0: as it "
            "comes."
        ),
    )

    def named(self) -> dict[str, Any]:
        """The tables and values that are named, by key."""
        values = {key: getattr(self, key) for key in LinkSettings.model_fields}
        return {key: value for key, value in values.items() if value is not None}


class SettingError(ValueError):
    """A change that a link's settings do not admit; ``problem`` says where and why.

    ``cause`` is the action of a timeline that asked for it, if one did.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.cause: object = None
        super().__init__(str(problem))


class LinkSettings(_Preset):
    """All settings of one direction of a link; the default is an ideal link."""

    delay: DelaySettings = Field(
        default=ConstantDelaySettings(), description="The delay of messages."
    )
    loss: LossSettings = Field(default=RandomLossSettings(), description="Which messages are lost.")
    duplicate: DuplicateSettings = DuplicateSettings()
    corrupt: CorruptSettings = CorruptSettings()
    reorder: ReorderSettings = ReorderSettings()
    rate: RateSettings = RateSettings()
    queue: QueueSettings = QueueSettings()
    slots: SlotsSettings = SlotsSettings()
    keep_order: bool = Field(
        default=False, description="Whether nothing arrives before what was sent earlier."
    )
    playout_s: Seconds = Field(
        default=0.0,
        description=(
            "Deliver everything this long after its stamp, and lose what comes later; 0: as it "
            "comes."
        ),
    )

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        schema = super().__get_pydantic_json_schema__(core, handler)
        keys = schema["properties"]
        alone = {"delay": {"required": ["distribution"]}, "loss": dict(keys["loss"])}
        for key, part in (("delay", DelayPart), ("loss", LossPart)):  # what changes a preset
            keys[key]["anyOf"] = [
                {"anyOf": keys[key].pop("anyOf")},
                handler(part.__pydantic_core_schema__),
            ]
        return schema | {"if": {"required": ["preset"]}, "else": {"properties": alone}}

    @field_validator("loss", mode="before")
    @classmethod
    def _random_by_default(cls, loss: Any) -> Any:
        return {"model": "random"} | loss if isinstance(loss, dict) else loss

    def changed(self, overrides: LinkOverrides) -> "LinkSettings":
        """These settings with exactly what ``overrides`` names replaced.

        Raises:
            SettingError: a key that these settings do not have (the mean of a
                uniform delay), or a value that does not go with the others.
        """
        named = overrides.named()
        for key, value in named.items():
            if isinstance(value, Part):
                part = value.model_dump(exclude_none=True)
                named[key] = _applied(key, part, getattr(self, key))
        return self.model_copy(update=named)

    def with_number(self, parameter: str, number: float) -> "LinkSettings":
        """These settings with one number replaced, such as that of ``delay.mean_s``.

        Raises:
            SettingError: as for :meth:`changed`.
        """
        key, _, inner = parameter.partition(".")
        if inner:
            return self.model_copy(update={key: _applied(key, {inner: number}, getattr(self, key))})
        try:
            return self.changed(LinkOverrides.model_validate({key: number}))
        except ValidationError as error:
            raise SettingError(problems(LinkOverrides, {key: number}, error)[0]) from None

    @property
    def constant_ns(self) -> int | None:
        """The delay if every message that arrives has the same one."""
        shortest, longest = self.delay.range_ns
        if self.rate.bits_per_s or self.slots.max_s:
            return None
        if self.playout_s:
            return nanoseconds(self.playout_s)
        return shortest if shortest == longest and not self.reorder.probability else None

    @property
    def lossless(self) -> bool:
        """Whether every message arrives, undamaged."""
        longest = self.delay.range_ns[1]
        in_time = not self.playout_s or (
            longest is not None and longest <= nanoseconds(self.playout_s)
        )
        queued = self.queue.messages or self.queue.bytes
        return self.loss.never and in_time and not queued and not self.corrupt.probability

    def impairments(
        self, before: "LinkSettings | None" = None, held: Iterable[Impairment] = ()
    ) -> list[Impairment]:
        """What is on, in the order of tc-netem's pipeline.

        Loss, corrupt, queue; then reorder, delay, rate, slots, order; then
        playout, at the receiver. (Duplicates are made before all of them.)
        Of ``held``, which ``before`` described, those whose table is the same here are kept.
        """
        limit = QueueLimit(self.queue.messages, self.queue.bytes)
        limited = self.queue.messages > 0 or self.queue.bytes > 0
        stages: list[tuple[str, bool, Callable[[], Impairment]]] = [
            ("loss", not self.loss.never, self.loss.impairment),
            ("corrupt", self.corrupt.probability > 0, lambda: Corrupt(self.corrupt.probability)),
            ("queue", limited, lambda: QueueEntry(limit)),
            ("reorder", self.reorder.probability > 0, lambda: Reorder(**dict(self.reorder))),
            ("delay", self.delay.range_ns != (0, 0), self.delay.impairment),
            ("rate", self.rate.bits_per_s > 0, lambda: Rate(**dict(self.rate))),
            ("slots", self.slots.max_s > 0, self._slots),
            ("order", self.keep_order, KeepOrder),
            ("queue exit", limited, lambda: QueueExit(limit)),
            ("playout", self.playout_s > 0, lambda: Playout(nanoseconds(self.playout_s))),
        ]
        same = {impairment.name: impairment for impairment in held}
        for name, key in _TABLE_OF.items():
            if before is None or getattr(before, key) != getattr(self, key):
                same.pop(name, None)
        return [same.get(name) or make() for name, is_on, make in stages if is_on]

    def _slots(self) -> Slots:
        slots = self.slots
        return Slots(
            nanoseconds(slots.min_s), nanoseconds(slots.max_s), slots.messages, slots.bytes
        )

    def link(self, *, seed: int, source: object, destination: object) -> Link:
        """The link that these settings describe."""
        return Link(
            self.impairments(),
            seed=seed,
            source=source,
            destination=destination,
            duplicate=self.duplicates(),
        )

    def duplicates(self) -> Duplicate | None:
        """What makes duplicates, if anything does."""
        share = self.duplicate.probability
        return Duplicate(share) if share else None


_TABLE_OF = {
    "loss": "loss",
    "corrupt": "corrupt",
    "queue": "queue",
    "reorder": "reorder",
    "delay": "delay",
    "rate": "rate",
    "slots": "slots",
    "order": "keep_order",
    "queue exit": "queue",
    "playout": "playout_s",
}
"""The key from which each impairment is made."""


def _applied(key: str, named: Mapping[str, Any], table: Table) -> Table:
    """``table``, which stands at ``key``, with what is named replaced."""
    data = table.model_dump(exclude_none=True) | dict(named)
    try:
        return type(table).model_validate(data)
    except ValidationError as error:
        first = problems(type(table), data, error)[0]
        place = f"{key}.{first.place}" if first.place else key
        raise SettingError(first._replace(place=place)) from None
