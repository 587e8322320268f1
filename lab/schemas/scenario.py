"""The JSON Schema of the scenario format, for editors.

Generated from the models of :mod:`formation.scenario`, whose words it takes over. It knows
each value by itself; what must fit together (ids, periods, ends of a range) only the loader does.
"""

from contextlib import suppress
from pathlib import Path
from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from formnet.formation.scenario.model import Scenario
from formnet.lab.runs import files
from formnet.lab.schemas.common import Schema, dumped, finished

FILE = "scenario.schema.json"
"""What a copy is called, wherever it lies."""


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


def scenario_schema() -> Schema:
    """The schema."""
    schema = Scenario.model_json_schema(schema_generator=_Generator)
    return finished("formnet scenario", schema)


def text() -> str:
    """The schema as it stands in a file."""
    return dumped(scenario_schema())


def write_beside(folder: Path) -> None:
    """Put the schema into ``folder``, unless a file of its name is there; raises OSError."""
    with suppress(FileExistsError):
        files.write_new(folder / FILE, text())
