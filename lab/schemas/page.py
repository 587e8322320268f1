"""Tables of keys for the reference pages, from a JSON Schema."""

import json
import re
from collections.abc import Iterator

from formnet.lab.schemas.common import Schema


class Tables:
    """Writes the tables of one schema as Markdown."""

    def __init__(self, schema: Schema) -> None:
        self.schema = schema

    def table(self, keys: Schema, table: Schema) -> Iterator[str]:
        """The rows of some ``keys`` of a ``table``."""
        required = table.get("required", [])
        unless_file = {key for way in table.get("anyOf", []) for key in way["required"]}
        yield "| key | type | default | unit | what |"
        yield "|---|---|---|---|---|"
        for key, entry in keys.items():
            default = "**required**" if key in required else _default(entry)
            if key in unless_file - {"file", *required}:
                default = "**required**, or `file`"
            cells = (
                f"`{key}`",
                self.type_of(entry),
                default,
                entry.get("unit", ""),
                self.what(entry),
            )
            yield self.row(*cells)
        yield ""

    def row(self, *cells: str) -> str:
        """A row of a table."""
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    def what(self, entry: Schema) -> str:
        """What a key is for: its own description, or that of what it holds."""
        text = words(entry) or words(self.resolved(entry)) or words(entry.get("items", {}))
        return text.split("\n\n")[0]

    def type_of(self, entry: Schema) -> str:
        """A value's type and bounds, in words."""
        if "$ref" in entry:
            return self.type_of(self.resolved(entry) | {"description": ""})
        if "anyOf" in entry and "type" not in entry:
            return " or ".join(dict.fromkeys(self.type_of(one) for one in entry["anyOf"]))
        if "enum" in entry or "const" in entry:
            return ", ".join(
                f"`{json.dumps(value)}`" for value in entry.get("enum", [entry.get("const")])
            )
        kind = entry.get("type")
        if kind == "array":
            inner = self.type_of(entry["items"])
            most = entry.get("maxItems")
            if most == 2:
                return f"pair of {inner}"
            return f"list of {inner}" if most is None else f"list of at most {most}: {inner}"
        names = {
            "number": "number",
            "integer": "whole number",
            "string": "string",
            "boolean": "true, false",
            "object": "table",
            "null": "null",
        }
        return names[kind] + _bounds(entry) if kind else "any"

    def resolved(self, entry: Schema) -> Schema:
        """``entry``, or what it refers to."""
        reference = entry.get("$ref")
        if reference is None:
            return entry
        found: Schema = self.schema["$defs"][reference.rpartition("/")[2]]
        return found


def _bounds(entry: Schema) -> str:
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    bounds = [
        f"{sign} {entry[key]:g}"
        for key, sign in signs.items()
        if key in entry and entry[key] <= 1e9  # above, as good as none
    ]
    return " " + ", ".join(bounds) if bounds else ""


def _default(entry: Schema) -> str:
    if "default" not in entry:
        return ""
    value = entry["default"]
    return f"`{json.dumps(value, ensure_ascii=False)}`" if value not in ("", []) else ""


def words(entry: Schema) -> str:
    """A description without the key that it begins with, if anything follows."""
    text = re.sub(r"^`[^`]*`(?: in `[^`]*`)?: (?=.)", "", entry.get("description", ""))
    return text[0].upper() + text[1:] if text[:1].isascii() and text else text
