"""A link's settings as they stand in a file, and the link they describe."""

import pkgutil
from collections.abc import Iterable, Mapping
from copy import deepcopy
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import (
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    Tag,
    ValidationError,
    create_model,
    field_validator,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError

from formnet.netem import impairments
from formnet.netem.core.duplicate import Duplicate
from formnet.netem.core.link import Impairment, Link
from formnet.netem.files.overrides import OverrideError, Values, assign
from formnet.netem.files.problems import Problem, problems
from formnet.netem.files.tables import (
    Part,
    Probability,
    Seconds,
    Table,
    members,
    nanoseconds,
    optional,
    part_of,
)
from formnet.netem.impairments.corrupt import CorruptSettings
from formnet.netem.impairments.order import KeepOrder
from formnet.netem.impairments.playout import Playout
from formnet.netem.impairments.queue import QueueSettings
from formnet.netem.impairments.rate import RateSettings
from formnet.netem.impairments.reorder import ReorderSettings
from formnet.netem.impairments.slots import SlotsSettings
from formnet.netem.impairments.stage import Stages, StageTable
from formnet.netem.settings.delays import ConstantDelaySettings, DelaySettings
from formnet.netem.settings.losses import LossSettings, RandomLossSettings
from formnet.netem.settings.presets import PRESETS

_ORDER = {
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


def _added() -> dict[str, type[StageTable]]:
    """By key, the tables of impairments that are not named in this module."""
    for module in pkgutil.iter_modules(impairments.__path__):
        import_module(f"{impairments.__name__}.{module.name}")
    return {table.key: table for table in StageTable.__subclasses__() if table.key}


def _pipeline(added: Mapping[str, type[StageTable]]) -> dict[str, str]:
    names = list(_ORDER)
    for table in added.values():
        names.insert(names.index(table.after) + 1, table.key)
    return {name: _ORDER.get(name, name) for name in names}


_ADDED = _added()
PIPELINE = _pipeline(_ADDED)
"""The impairments of a link in tc-netem's order, and the key that each is made from.

Duplicates are made before all of them; ``playout`` is at the receiver. Impairments that bring
their own table (:mod:`formnet.netem.impairments.stage`) have their places in it."""

_KINDS = {"delay": "distribution", "loss": "model"}
"""The tables that come in kinds, and the key that says which."""


def _values(named: Mapping[str, Any]) -> dict[str, Any]:
    """What a table of settings names, by key path: key by key in a table that names no kind."""
    found: dict[str, Any] = {}
    for key, value in named.items():
        part = isinstance(value, Mapping) and _KINDS.get(key) not in value
        if part and isinstance(_ideal().get(key), dict):
            found |= {f"{key}.{inner}": item for inner, item in value.items()}
        else:
            found[key] = value
    return found


class SettingError(ValueError):
    """A change that a link's settings do not admit; ``problem`` says where and why.

    ``cause`` is the action of a timeline that asked for it, if one did.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.cause: object = None
        super().__init__(str(problem))


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
        expanded, values = deepcopy((_ideal(), _values(PRESETS[name]) | _values(rest)))
        for path, value in values.items():
            try:
                assign(expanded, path, value)
            except OverrideError:  # a key with a dot in it, which validation will refuse
                key, _, _ = path.partition(".")
                expanded[key] = rest[key]
        return expanded

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


class DuplicateSettings(Table):
    """``duplicate = { probability = 0.01 }``"""

    probability: Probability = Field(
        default=0.0, description="Share of messages that are sent twice."
    )

    def duplicate(self) -> Duplicate | None:
        """What makes duplicates, if anything does."""
        return Duplicate(self.probability) if self.probability else None


if TYPE_CHECKING:
    _WithAdded = _Preset
else:
    _WithAdded = create_model(
        "_WithAdded", __base__=_Preset, **{key: (table, table()) for key, table in _ADDED.items()}
    )


class LinkSettings(_WithAdded):
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
        default=False, description="No message arrives before one that was sent earlier."
    )
    playout_s: Seconds = Field(
        default=0.0,
        description=(
            "Deliver messages this long after their stamp, and lose later ones; 0: on arrival."
        ),
    )

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        schema = super().__get_pydantic_json_schema__(core, handler)
        keys = schema["properties"]
        alone = {"delay": {"required": ["distribution"]}, "loss": dict(keys["loss"])}
        for key, part in _PARTS.items():  # what changes a preset
            keys[key]["anyOf"] = [
                {"anyOf": keys[key].pop("anyOf")},
                handler(part.__pydantic_core_schema__),
            ]
        return schema | {"if": {"required": ["preset"]}, "else": {"properties": alone}}

    @field_validator("loss", mode="before")
    @classmethod
    def _random_by_default(cls, loss: Any) -> Any:
        return {"model": "random"} | loss if isinstance(loss, dict) else loss

    def changed(self, values: Values) -> "LinkSettings":
        """These settings with ``values`` put in place.

        Raises:
            SettingError: a key that these settings do not have (the mean of a
                uniform delay), or a value that does not go with the others.
        """
        keys = {path.partition(".")[0] for path in values}
        data = self.model_dump(include=keys - values.keys(), exclude_none=True)
        try:
            for path, value in values.items():
                assign(data, path, value)
            found = LinkSettings.model_validate(data)
        except OverrideError as error:
            raise SettingError(Problem(error.place, None, error.rule)) from None
        except ValidationError as error:
            raise SettingError(problems(LinkSettings, data, error)[0]) from None
        return self.model_copy(update={key: getattr(found, key) for key in keys})

    @property
    def constant_ns(self) -> int | None:
        """The delay if every message that arrives has the same one."""
        shortest, longest = self.delay.range_ns
        if any(table.delays for table in self._tables()):
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
        return self.loss.never and in_time and not any(table.loses for table in self._tables())

    def impairments(
        self, before: "LinkSettings | None" = None, held: Iterable[Impairment] = ()
    ) -> list[Impairment]:
        """What is on, in the order of :data:`PIPELINE`.

        Of ``held``, which ``before`` described, those whose key is the same here are kept.
        """
        same = {
            impairment.name: impairment
            for impairment in held
            if before is not None
            and getattr(before, key := PIPELINE[impairment.name]) == getattr(self, key)
        }
        stages = self._stages()
        return [same.get(name) or stages[name]() for name in PIPELINE if name in stages]

    def _tables(self) -> list[StageTable]:
        return [table for _, table in self if isinstance(table, StageTable)]

    def _stages(self) -> Stages:
        found: dict[str, Any] = {}
        for table in self._tables():
            found |= table.stages()
        if not self.loss.never:
            found["loss"] = self.loss.impairment
        if self.delay.range_ns != (0, 0):
            found["delay"] = self.delay.impairment
        if self.keep_order:
            found["order"] = KeepOrder
        if self.playout_s:
            found["playout"] = lambda: Playout(nanoseconds(self.playout_s))
        return found

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
        return self.duplicate.duplicate()


@cache
def _ideal() -> dict[str, Any]:
    return LinkSettings().model_dump(exclude_none=True)


# --- what a rule or a change names ----------------------------------------------------

_PARTS: dict[str, type[Part]] = {
    "delay": part_of(*members(DelaySettings), leave_out=_KINDS["delay"]),
    "loss": part_of(*members(LossSettings), leave_out=_KINDS["loss"]),
}


def _whole_or_part(kind: str) -> Discriminator:
    def which(value: object) -> str:
        if isinstance(value, Mapping):
            return "whole" if kind in value else "part"
        return "part" if isinstance(value, Part) else "whole"

    return Discriminator(which)


if TYPE_CHECKING:
    _AnyOf = _Preset
else:

    def _optional(key):
        """A field of LinkSettings that need not be named: if a table, any key of it."""
        info = LinkSettings.model_fields[key]
        if key in _KINDS:
            kinds = Field(discriminator=_KINDS[key])
            whole = Annotated[info.annotation, kinds, Tag("whole")]
            part = Annotated[_PARTS[key], Tag("part")]
            either = Annotated[whole | part, _whole_or_part(_KINDS[key])] | None
            return either, Field(default=None, description=info.description)
        if isinstance(info.annotation, type) and issubclass(info.annotation, Table):
            return part_of(info.annotation) | None, None
        return optional(info)

    _AnyOf = create_model(
        "_AnyOf", __base__=_Preset, **{key: _optional(key) for key in LinkSettings.model_fields}
    )


class LinkOverrides(_AnyOf):
    """What a rule names of a link's settings; what it does not name stays.

    A ``delay`` or ``loss`` of a named kind replaces the table; every other table
    changes key by key.
    """

    def named(self) -> dict[str, Any]:
        """The tables and values that are named, by key."""
        values = {key: getattr(self, key) for key in LinkSettings.model_fields}
        return {key: value for key, value in values.items() if value is not None}

    def values(self, *, plain: bool = True) -> dict[str, Any]:
        """The same by key path, as :meth:`LinkSettings.changed` takes them.

        Unless ``plain``, a ``delay`` or ``loss`` of a named kind stays the table that it is, which
        is not checked again.
        """
        return _values(
            {
                key: value.model_dump(exclude_none=True)
                if isinstance(value, Table) and (plain or isinstance(value, Part))
                else value
                for key, value in self.named().items()
            }
        )
