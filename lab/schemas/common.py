"""What the JSON Schemas have in common: draft 2020-12, units, descriptions as Markdown."""

import json
import re
from typing import Any, cast

from pydantic.json_schema import GenerateJsonSchema

Schema = dict[str, Any]

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


def finished(title: str, schema: Schema) -> Schema:
    """A schema that pydantic made, as it is published; the same bytes everywhere once dumped."""
    dialect = {"$schema": GenerateJsonSchema.schema_dialect, "title": title}
    return dialect | cast(Schema, _polished(schema))


def dumped(schema: Schema) -> str:
    """A schema as it stands in a file."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


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
