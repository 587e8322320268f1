"""Runs side by side: what tells them apart, as tables and as a figure."""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from formnet.formation.scenario.expect import CRITERIA, Expect
from formnet.lab.figures.canvas import COLOURS, as_label, blank, colours, dashes, save
from formnet.lab.figures.plotting import Figure
from formnet.lab.judge import claim_words
from formnet.lab.judge.errors import by_claim, error_series
from formnet.lab.runs import files
from formnet.lab.runs.difference import differences
from formnet.lab.runs.files import as_text
from formnet.lab.runs.keypaths import by_path, shown
from formnet.lab.text.markdown import as_cell
from formnet.lab.text.side_by_side import MOST_COLUMNS, Rows, turned
from formnet.lab.verdict.claims import Judgement
from formnet.lab.verdict.model import Verdict
from formnet.lab.verdict.recorded import Recorded
from formnet.netem.files.printable import printable

MOST_RUNS = 2 * len(COLOURS)
"""How many runs can be told apart in the figure: by colour, and by dashes."""
_NO_DIFFERENCE = ("name", "description", "expect")
"""What of a scenario does not decide what happens in the run."""


class Comparison(NamedTuple):
    """Rows of (title, a cell per run), and whether bits differ that should be the same."""

    names: list[str]
    results: list[tuple[str, list[str]]]
    scenario: list[tuple[str, list[str]]]
    differs: bool


def comparison(found: Sequence[Recorded]) -> Comparison:
    """What tells whole runs apart."""
    names = _names([run.folder for run in found])
    verdicts = [run.verdict for run in found if run.verdict is not None]
    scenarios = [run.scenario for run in found]
    titles = claim_words.titles(*scenarios)
    results: list[tuple[str, list[str]]] = [
        ("verdict", [v.standing for v in verdicts]),
        ("outcome", [v.outcome.kind for v in verdicts]),
        *(
            (title, [_claim(CRITERIA[claim].unit, v.claims[claim]) for v in verdicts])
            for claim, title in titles.items()
            if any(claim in v.told for v in verdicts)
        ),
        ("settled after", [v.settled for v in verdicts]),
        *(
            (f"at the end: {label}", [_number(v.error(claim)) for v in verdicts])
            for claim, label in claim_words.labels(*scenarios).items()
        ),
        *_motions(verdicts),
        ("messages lost", [_lost(v) for v in verdicts]),
        ("robots lost unplanned", [str(len(v.robots.lost)) for v in verdicts]),
        ("simulated (s)", [_number(v.simulated_s, "g") for v in verdicts]),
        ("took (s)", [_number(v.wall_s, ".2f") for v in verdicts]),
        (
            "mode",
            [
                f"{v.mode}, {run.scenario.clock.mode}"
                for v, run in zip(verdicts, found, strict=True)
            ],
        ),
        ("sha256", [v.trajectory_sha256[:12] for v in verdicts]),
    ]
    beside = [_beside(found[0], run) for run in found[1:]]
    results.append((f"beside {names[0]}", ["–", *(words for words, _ in beside)]))
    differs = any(bad for _, bad in beside)
    return Comparison(names, _lines(results), _lines(_scenarios(found)), differs)


def figure(found: Sequence[Recorded], names: Sequence[str]) -> Figure:
    """The errors of all runs over each other, each in a panel.

    Each run's are those of the robots that were up at its end, as in its verdict.
    """
    drawn = blank(9.0, 8.8 + 0.22 * -(-len(names) // 3))
    panels = drawn.subplots(3, 1, sharex=True)
    labels, count = claim_words.labels(*(run.scenario for run in found)), len(found)
    looks = zip(colours(count), dashes(count), strict=True)
    for number, (run, name, (colour, dash)) in enumerate(zip(found, names, looks, strict=True)):
        trajectories = run.trajectories
        if not len(trajectories.t_s):
            continue
        up = run.up_at(int(trajectories.t_ns[-1]))
        series = by_claim(error_series(run.scenario, trajectories, up))
        tolerances = (run.scenario.expect or Expect()).tolerances
        width = 1.2 + 1.8 * (1 - (number + 1) / count)  # what is the same still shows
        for axes, (claim, errors) in zip(panels, series.items(), strict=True):
            axes.semilogy(
                trajectories.t_s,
                np.maximum(errors, 1e-16),
                color=colour,
                ls=dash,
                lw=width,
                label=as_label(name),
            )
            axes.axhline(tolerances[claim], color="0.45", ls=":", lw=1.0)
            axes.set_ylabel(labels[claim])
    panels[-1].set_xlabel("t (s)    (dotted: tolerances)")
    panels[-1].set_xlim(left=0.0)
    handles, labels = panels[0].get_legend_handles_labels()
    if handles:
        drawn.legend(handles, labels, loc="outside upper left", fontsize=8.5, ncols=3)
    return drawn


def _beside(first: Recorded, other: Recorded) -> tuple[str, bool]:
    """Whether a run has the bits of the first, and whether it should but has not."""
    if _deciding(first) != _deciding(other):
        return "another scenario", False
    found = differences(first, other)
    if found.identical:
        return "identical", False
    repeatable = first.scenario.clock.mode == "lockstep" and all(
        run.verdict is not None and run.verdict.unplanned_s is None for run in (first, other)
    )
    return f"differs, {found.in_words[0]}", repeatable


def _deciding(run: Recorded) -> dict[str, Any]:
    return {
        place: value
        for place, value in by_path(run.scenario).items()
        if not place.startswith(_NO_DIFFERENCE)
    }


def _scenarios(found: Sequence[Recorded]) -> list[tuple[str, list[str]]]:
    """The keys in which the scenarios differ."""
    flat = [by_path(run.scenario) for run in found]
    places = dict.fromkeys(place for one in flat for place in one)
    rows = (
        (place, [shown(one[place]) if place in one else "–" for one in flat]) for place in places
    )
    return [(place, cells) for place, cells in rows if len(set(cells)) > 1]


def _lines(rows: Iterable[tuple[str, list[str]]]) -> list[tuple[str, list[str]]]:
    """Rows with nothing in their cells that would act, hide or begin another line."""
    return [(printable(title), [*map(printable, cells)]) for title, cells in rows]


def _names(folders: Sequence[Path]) -> list[str]:
    """What to call each run: its folder's name, or the whole path where names coincide."""
    short = [as_text(folder.resolve()) for folder in folders]
    names = short if len(set(short)) == len(short) else [str(folder) for folder in folders]
    return [*map(printable, names)]


def _claim(unit: str, claim: Judgement) -> str:
    unjudged = "not claimed" if claim.expected is None else "not judged"
    holds = {True: "holds", False: "FAILS", None: unjudged}[claim.holds]
    holds += " (claimed: false)" if claim.expected is False else ""
    largest = claim.largest_in_window
    return holds if largest is None else f"{holds}, {largest:.1e} {unit}".strip()


def _motions(verdicts: Sequence[Verdict]) -> Iterator[tuple[str, list[str]]]:
    """A row for each extreme of the motion that any run has."""
    told: list[dict[str, str]] = [{} if v.motion is None else v.motion.told for v in verdicts]
    for title in dict.fromkeys(title for one in told for title in one):
        yield title, [one.get(title, "–") for one in told]


def _lost(judged: Verdict) -> str:
    return f"{judged.messages.lost} of {judged.messages.sent}"


def _number(value: float | None, form: str = ".2e") -> str:
    return "–" if value is None else format(value, form)


def parts(compared: Comparison) -> Iterator[tuple[str, Rows]]:
    """The tables: a title, and the rows."""
    yield "results", compared.results
    nothing = [("(nothing)", [""] * len(compared.names))]
    yield "what differs in the scenarios", compared.scenario or nothing


def write(folder: Path, compared: Comparison, drawn: Figure) -> None:
    """``comparison.md`` and ``comparison.csv``, the tables, and ``errors.png``, the figure.

    Raises:
        OSError: a file cannot be written.
    """
    lines = []
    for title, rows in parts(compared):
        lines += [f"## {title.capitalize()}", ""]
        if len(compared.names) <= MOST_COLUMNS:
            lines += _markdown([["", *compared.names], *([place, *cells] for place, cells in rows)])
            continue
        grid, alike = turned(compared.names, rows)
        if len(grid[0]) > 1:
            lines += _markdown(grid)
        if alike:
            same = [[place, cell] for place, cell in alike]
            lines += ["The same in all:", "", *_markdown([["", ""], *same])]
    lines.append("![The errors of all runs](errors.png)")
    files.replace(folder / "comparison.md", "\n".join(lines) + "\n")
    text = io.StringIO(newline="")
    table = csv.writer(text)
    table.writerow(["", *compared.names])
    table.writerows([place, *cells] for _, rows in parts(compared) for place, cells in rows)
    files.write_new(folder / "comparison.csv", text.getvalue())
    save(drawn, folder, "errors")


def _markdown(grid: Sequence[Sequence[str]]) -> list[str]:
    """A table, its first row the head, and an empty line."""
    lines = ["| " + " | ".join(map(as_cell, row)) + " |" for row in grid]
    return [lines[0], "|---" * len(grid[0]) + "|", *lines[1:], ""]
