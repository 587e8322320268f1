"""The outcome of a benchmark: rows with one value per round, as a table and as JSON."""

import json
import os
import platform
import statistics
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal

from rich.console import Console
from rich.markup import escape
from rich.table import Table


class BenchmarkError(RuntimeError):
    """A measurement could not be made; the text says which one and why."""


@dataclass(frozen=True)
class Target:
    """A bound that the median over the rounds should keep."""

    relation: Literal["<=", ">="]
    bound: float

    def kept(self, value: float) -> bool:
        """Whether ``value`` keeps the bound."""
        return value <= self.bound if self.relation == "<=" else value >= self.bound

    def __str__(self) -> str:
        return f"{self.relation} {self.bound:g}"


@dataclass(frozen=True)
class Row:
    """One measured quantity: ``values`` holds one number per round, in ``unit``.

    Without values the row tells in ``note`` why there are none.
    """

    group: str
    what: str
    values: list[float]
    unit: str = "×"
    target: Target | None = None
    note: str = ""

    @property
    def median(self) -> float | None:
        """The median over the rounds."""
        return statistics.median(self.values) if self.values else None

    def verdict(self) -> str:
        """``met`` or ``missed`` by the median, and whether single rounds disagree."""
        if self.target is None or self.median is None:
            return ""
        verdict = "met" if self.target.kept(self.median) else "missed"
        agree = len({self.target.kept(value) for value in self.values}) == 1
        return verdict if agree else f"{verdict}, rounds differ"

    def as_json(self) -> dict[str, Any]:
        """Everything known of the row."""
        return {
            "group": self.group,
            "what": self.what,
            "unit": self.unit,
            "median": self.median,
            "rounds": self.values,
            "target": None if self.target is None else str(self.target),
            "verdict": self.verdict() or None,
            "note": self.note or None,
        }


@dataclass
class Report:
    """All rows of one run, and how it was made."""

    settings: dict[str, Any]
    rows: list[Row] = field(default_factory=list)

    def show(self, console: Console) -> None:
        """Print the table."""
        table = Table(title=f"formnet benchmarks ({self._machine()})", title_justify="left")
        table.add_column("")
        table.add_column("measurement")
        table.add_column("median", justify="right")
        table.add_column("least to greatest round", justify="right")
        table.add_column("target", justify="right")
        table.add_column("verdict")
        table.add_column("note", style="dim")
        for last, row in zip([None, *self.rows], self.rows, strict=False):
            if last is not None and last.group != row.group:
                table.add_section()
            table.add_row(*map(escape, _cells(row)))
        console.print(table)

    def save(self, path: Path) -> None:
        """Write settings, machine and rows as JSON."""
        content = {
            "settings": self.settings,
            "machine": self._machine(),
            "versions": {name: _version(name) for name in ("eclipse-zenoh", "helics", "numpy")},
            "rows": [row.as_json() for row in self.rows],
        }
        text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
        path.write_text(text + "\n", encoding="utf-8")

    @staticmethod
    def _machine() -> str:
        return f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"


def _cells(row: Row) -> list[str]:
    target = "" if row.target is None else str(row.target)
    if row.median is None:
        return [row.group, row.what, "-", "", target, "", row.note]
    spread = f"{min(row.values):.3g} to {max(row.values):.3g}"
    median = f"{row.median:.3g} {row.unit}"
    return [row.group, row.what, median, spread, target, row.verdict(), row.note]


def _version(distribution: str) -> str | None:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return None
