"""``formnet schema``: the JSON Schema (draft 2020-12) of the scenario format, for editors.

Generated from the models of :mod:`formation.scenario`, whose words it takes over. It knows
each value by itself; what must fit together (ids, periods, ends of a range) only the loader does.
"""

import json
import re
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from formnet.formation.scenario.model import Scenario
from formnet.lab.runs import files

FILE = "scenario.schema.json"
"""What a copy is called, wherever it lies."""

UNITS = {
    "bits_per_s": "bit/s",
    "bytes": "bytes",
    "_kgm2": "kg m²",
    "_nmsprad": "N m s/rad",
    "_nspm": "N s/m",
    "_radps": "rad/s",
    "_mps": "m/s",
    "_rad": "rad",
    "_kg": "kg",
    "_nm": "N m",
    "_n": "N",
    "_m": "m",
    "_s": "s",
}
"""Units by the ends of keys, longer ones first."""


class _Generator(GenerateJsonSchema):
    """As TOML has it: no null, pairs as lists; any member of a union that fits will do."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        if schema.get("default", 0) is None:
            return self.generate_inner(schema["schema"])
        return super().default_schema(schema)

    def tuple_schema(self, schema: core_schema.TupleSchema) -> JsonSchemaValue:
        found = super().tuple_schema(schema)
        items = found.pop("prefixItems")  # every tuple of the format is a pair of equals
        return found | {"items": items[0]}

    def tagged_union_schema(self, schema: core_schema.TaggedUnionSchema) -> JsonSchemaValue:
        found = super().tagged_union_schema(schema)
        return {"anyOf": found["oneOf"]}


def scenario_schema() -> dict[str, Any]:
    """The schema; the same bytes everywhere once dumped by :func:`text`."""
    schema = Scenario.model_json_schema(schema_generator=_Generator)
    dialect = {"$schema": _Generator.schema_dialect, "title": "formnet scenario"}
    return dialect | cast(dict[str, Any], _polished(schema))


def text() -> str:
    """The schema as it stands in a file."""
    return json.dumps(scenario_schema(), indent=2, ensure_ascii=False) + "\n"


def write_beside(folder: Path) -> None:
    """Put the schema into ``folder``, unless a file of its name is there; raises OSError."""
    with suppress(FileExistsError):
        files.write_new(folder / FILE, text())


def _polished(node: Any) -> Any:
    """Without titles of models, null and whole tables as defaults; docstrings as Markdown."""
    if isinstance(node, list):
        return [_polished(item) for item in node]
    if not isinstance(node, dict):
        return node
    found: dict[str, Any] = {}
    for key, value in node.items():
        if key == "properties":
            found[key] = {name: _key(name, entry) for name, entry in value.items()}
        elif key == "description":
            found[key] = markdown(value)
        elif key != "title" and not (key == "default" and isinstance(value, dict)):
            found[key] = _polished(value)
    return found


def _key(name: str, entry: dict[str, Any]) -> dict[str, Any]:
    """The schema of one key, with its unit if it has one."""
    found = cast(dict[str, Any], _polished(entry))
    unit = next((unit for end, unit in UNITS.items() if name.endswith(end)), None)
    return {"unit": unit} | found if unit else found


def markdown(docstring: str) -> str:
    """A docstring's markup as Markdown: one line a paragraph or an item of a list."""
    text = re.sub(r"(?m)^(\S+)\n +", r"- `\1`: ", docstring.replace("``", "`"))
    return re.sub(r"(?<!\n)\n *(?![\n-])", " ", text)
