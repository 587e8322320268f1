"""The reference of verdict.json, docs/verdict.md, from the JSON Schema: ``make reference``."""

import sys
from collections.abc import Iterator
from pathlib import Path

from formnet.lab.runs import files
from formnet.lab.runs.files import MOST_BYTES
from formnet.lab.schemas.common import Schema
from formnet.lab.schemas.page import Tables, words
from formnet.lab.schemas.verdict import verdict_schema
from formnet.lab.verdict.model import FORMAT

HEAD = f"""\
<!-- Written by `make reference` from the models of lab/verdict/; edit those. -->
# Verdicts: every key

Every run leaves a `verdict.json` in its folder: how it ended, what was claimed and observed, and
numbers about it. This page and the [JSON Schema](verdict.schema.json) (`formnet schema --of
verdict` prints it) are made from the same models that write the file and read it.

**Format.** The first key is `format`; this is format {FORMAT}. Files without it are of format 1.
They are read if they have all that is here, `warnings`, `motion` and `messages.refused` excepted,
which came later; no file has to have `messages.disconnected`, the latest. A file of another
format, or with keys that are missing, unknown or of another kind, is refused with the version of
formnet that wrote it; what else is in the folder is shown.

**Size.** A file longer than {MOST_BYTES >> 20} MiB is not read. A link takes some 600 bytes: that
is about 100,000 links, such as those of 300 robots of which each hears all others.

**Numbers.** Those that are not finite are null. Keys that end in a unit are in it.
"""


def reference() -> str:
    """The whole page, as Markdown."""
    return "\n".join(_Page(verdict_schema()).lines())


class _Page(Tables):
    def lines(self) -> Iterator[str]:
        yield HEAD
        yield "## At the top\n"
        yield from self._keys(self.schema["properties"])
        places: dict[str, list[str]] = {}
        self._gather(self.schema["properties"], "", places)
        for reference, where in places.items():
            table = self.resolved({"$ref": reference})
            yield f"## {', '.join(f'`{place}`' for place in where)}\n"
            yield words(table) + "\n"
            yield from self._keys(table["properties"])

    def _gather(self, keys: Schema, place: str, places: dict[str, list[str]]) -> None:
        """Note where in the file each table stands, by what ``keys`` refer to it with."""
        for key, entry in keys.items():
            for reference, where in self._tables(entry, f"{place}{key}"):
                places.setdefault(reference, []).append(where)
                inner = self.resolved({"$ref": reference})
                self._gather(inner["properties"], f"{where}.", places)

    def _tables(self, entry: Schema, where: str) -> Iterator[tuple[str, str]]:
        """The tables in a value, and where they stand: ``[]`` in a list, ``.*`` under any key."""
        if "$ref" in entry:
            yield entry["$ref"], where
        for one in entry.get("anyOf", ()):
            yield from self._tables(one, where)
        if "items" in entry:
            yield from self._tables(entry["items"], f"{where}[]")
        if isinstance(entry.get("additionalProperties"), dict):
            yield from self._tables(entry["additionalProperties"], f"{where}.*")

    def _keys(self, keys: Schema) -> Iterator[str]:
        yield "| key | type | unit | what |"
        yield "|---|---|---|---|"
        for key, entry in keys.items():
            yield self.row(f"`{key}`", self.type_of(entry), entry.get("unit", ""), self.what(entry))
        yield ""


if __name__ == "__main__":
    files.replace(Path(sys.argv[1]), reference())
