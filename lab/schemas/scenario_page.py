"""The scenario reference, docs/scenario.md, from the JSON Schema: ``make reference``."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

from formnet.lab.runs import files
from formnet.lab.schemas.common import Schema
from formnet.lab.schemas.page import Tables, words
from formnet.lab.schemas.scenario import scenario_schema

HEAD = """\
<!-- Written by `make reference` from the models of formation/ and netem/; edit those. -->
# Scenarios: every key

A scenario is a TOML file: single values first, then tables. `formnet new NAME` writes one to start
from; `formnet check FILE` reports every mistake with its place, value and rule. Keys that are not
listed here are errors.

**In an editor.** Taplo and Even Better TOML (VS Code) complete and check a scenario whose first
line names the [JSON Schema](../configs/scenario.schema.json), as those in `configs/` do:

```toml
#:schema ./scenario.schema.json
```

`formnet new` puts a copy beside the scenario; `formnet schema --out scenario.schema.json` writes
one anywhere. The schema checks single values. Only `formnet check` checks relations between values
(robots that exist, a broadcast period that is a multiple of the control period, bounds in order).

**Times.** Keys that end in `_s` are in seconds, rounded to whole nanoseconds. Periods, delays and
times of the timeline are at most 3600; the lengths of a run, a window and a trace at most 1e9.
`duration_s` and `clock.broadcast_period_s` must be multiples of `clock.control_period_s` to the
nanosecond: 1/60 s is 16666667 ns, and 0.1 s is not a multiple of that.

**Bounds.** A file is a regular one of at most 2 MiB. Tables and lists are at most 32 deep, a dotted
key has at most 32 parts, keys and numbers have at most 100 characters, whole numbers 64 bits. There
are at most 1000 robots, 100,000 edges, 1000 entries each of the timeline and of
`[[network.links]]`, and 2,000,000 of these entries times directed links. Links differ in at most
20,000 ways, counted rule by rule. A CSV file has at most 32 MiB and 1,000,000 rows, and so many
rows have all tables together that name files. Of many problems the first 20 are told, and the
others counted. The same holds for `--set` and for what comes over the bus.

**Files.** A `file` of numbers must lie below the folder of the scenario, symbolic links resolved;
`--allow-outside` (in Python, `allow_outside=True`) reads others, too. Errors name its line and
column, never what stands there.

**Gains and periods.** `formnet check` and `formnet run` simulate the start of the run, linearise
the closed loop repeatedly, and warn if commands are held for longer than 2/|λ|, where λ is its
fastest eigenvalue: such a run chatters or diverges. The warning suggests a period or a `law.beta`.
It ignores lost messages and changes of the network in the timeline.
"""

SECTIONS = (
    ("formation", "[formation]"),
    ("robots", "[[robots]]"),
    ("robot_defaults", "[robot_defaults]"),
    ("clock", "[clock]"),
    ("law", "[law]"),
    ("network", "[network]"),
    ("neighbours", "[neighbours]"),
    ("timeline", "[[timeline]]"),
    ("plant", "[plant]"),
    ("run", "[run]"),
    ("expect", "[expect]"),
    ("hosts", "[hosts]"),
)
"""Keys of the top level that are tables, in the order in which one meets them."""


def reference() -> str:
    """The whole page, as Markdown."""
    return "\n".join(_Page(scenario_schema()).lines())


class _Page(Tables):
    def __init__(self, schema: Schema) -> None:
        super().__init__(schema)
        self._vehicle = set(self.resolved(schema["properties"]["robot_defaults"])["properties"])

    def lines(self) -> Iterator[str]:
        yield HEAD
        sections = dict(SECTIONS)
        yield "## At the top\n"
        top = self.schema["properties"]
        single = {name: entry for name, entry in top.items() if name not in sections}
        yield from self.table(single, self.schema)
        for name, title in SECTIONS:
            yield f"## `{title}`\n"
            entry = self.resolved(top[name])
            if name == "network":
                yield from self._network(entry)
            elif name == "timeline":
                yield from self._timeline(entry)
            else:
                yield from self._section(self.resolved(entry.get("items", entry)), name)

    def _section(self, table: Schema, name: str) -> Iterator[str]:
        yield words(table) + "\n"
        keys = dict(table["properties"])
        if name == "robots":
            keys = {key: entry for key, entry in keys.items() if key not in self._vehicle}
        yield from self.table(keys, table)
        if name == "robots":
            yield "And every key of [`[robot_defaults]`](#robot_defaults), for this robot alone.\n"
        for key, entry in keys.items():
            inner = self.resolved(entry)
            if "properties" in inner:
                yield f"### `{key}`\n"
                yield from self._section(inner, key)

    def _network(self, network: Schema) -> Iterator[str]:
        yield words(network) + "\n"
        yield from self.table(network["properties"], network)
        settings = self.resolved(network["properties"]["default"])
        rule = self.resolved(network["properties"]["links"]["items"])
        yield "### `[network.default]`\n"
        yield words(settings) + "\n"
        yield from self.table(settings["properties"], settings)
        yield "### `[[network.links]]`\n"
        yield words(rule) + "\n"
        own = {key: rule["properties"][key] for key in ("from", "to", "both_ways")}
        yield from self.table(own, rule)
        yield "And every key of `[network.default]`.\n"
        for key, kind in (("delay", "distribution"), ("loss", "model")):
            whole = settings["properties"][key]["anyOf"][0]["anyOf"]
            yield f"### `{key}`\n"
            yield from self._kinds(whole, kind, "####")
        for key, entry in settings["properties"].items():
            table = self.resolved(entry)
            if "properties" in table:
                yield f"### `{key}`\n"
                yield from self._section(table, key)

    def _timeline(self, timeline: Schema) -> Iterator[str]:
        yield words(timeline) + "\n"
        yield from self._kinds(timeline["items"]["anyOf"], "action", "###")

    def _kinds(self, kinds: list[Schema], tag: str, level: str) -> Iterator[str]:
        """Tables of a union, each under the word that says which it is."""
        link = self.schema["$defs"]["LinkSettings"]["properties"]
        for entry in kinds:
            table = self.resolved(entry)
            keys = dict(table["properties"])
            word = keys.pop(tag)
            yield f"{level} `{tag} = {json.dumps(word['const'])}`\n"
            yield word["description"] + "\n"
            if level == "###":
                yield from (f"{more}\n" for more in table["description"].split("\n\n")[1:])
            changes_links = set(link) <= set(keys)
            if changes_links:
                keys = {key: entry for key, entry in keys.items() if key not in link}
            yield from self.table(keys, table)
            if changes_links:
                yield "And every key of [`[network.default]`](#networkdefault).\n"


if __name__ == "__main__":
    files.write_to(Path(sys.argv[1]), reference())
