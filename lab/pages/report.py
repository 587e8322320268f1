"""``report.html``, a page about one run, and ``index.html``, one about all in a folder.

Everything comes from the files of the run's folder; templates/ has how it looks. Whatever
stands in a scenario or an event is text from elsewhere (:mod:`formnet.lab.pages.template`).
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from jinja2 import Environment

from formnet.formation.paper.theory import of_the_paper
from formnet.formation.records.events import Event, Severity, named
from formnet.formation.records.outcome import Outcome
from formnet.formation.scenario.expect import CRITERIA, ERRORS, LYAPUNOV, references
from formnet.formation.scenario.loading import ScenarioError, dumps
from formnet.lab.judge import claim_words
from formnet.lab.pages import listing as runs
from formnet.lab.pages.pictures import pictures
from formnet.lab.pages.template import environment
from formnet.lab.runs import files
from formnet.lab.runs.keypaths import by_path, shown
from formnet.lab.runs.words import times
from formnet.lab.text.assessment import describe
from formnet.lab.verdict.files import Unreadable
from formnet.lab.verdict.model import FAILS, HOLDS, NOT_JUDGED, OBSERVED, Verdict
from formnet.lab.verdict.recorded import Recorded, read_run

FIRST_EVENTS, LAST_EVENTS = 200, 40
"""How many events the page tells, from either end; all are in events.jsonl."""
MOST_LINKS = 100
"""How many links the page tells of; all are in verdict.json."""
MOST_RUNS = 300
"""How many runs the index shows, the newest."""
_MOST_LETTERS = 400
"""How much of what an event tells is shown."""
_MARK = '<meta name="generator" content="formnet">'
_ENDED = {
    "diverged": "diverged",
    "interrupted": "was interrupted",
    "lost": "ended",
    "failed": "failed",
    "broken": "broke",
}


class Moment(NamedTuple):
    """Something that happened at ``t_s``; ``tone`` is ``bad``, ``good`` or empty."""

    t_s: float
    kind: str
    told: str
    tone: str


def leave(folder: Path) -> str | None:
    """The pages that a run leaves, its own and, in ``runs/``, the index; what went wrong, if so.

    Raises:
        OSError: the disk takes no page.
    """
    try:
        write_report(folder)
    except (Unreadable, ScenarioError) as error:
        return f"report.html: {error}"
    parent = folder.resolve().parent
    try:
        return write_index(parent, runs.look_into(parent)[0]) if _in_runs(folder) else None
    except OSError as error:  # a run that was deleted meanwhile
        return f"index.html: {error}"


def write_report(folder: Path, *, draw_missing: bool = False) -> Path:
    """Write ``report.html`` from what is in ``folder``; draw figures first, if there are none.

    Raises:
        Unreadable, ScenarioError: there is no run.
        OSError: the page cannot be written.
    """
    run = read_run(folder, tables=draw_missing and not os.path.lexists(folder / "figures"))
    if run.samples or run.link_rows:
        from formnet.lab.figures import run_figures as figures

        figures.draw(run, files.subfolder(folder, "figures", made=True))
    files.replace(folder / "report.html", page(run))
    return folder / "report.html"


def write_index(folder: Path, entries: Sequence[runs.Entry]) -> str | None:
    """Write ``index.html`` into a folder of runs; why it cannot be, if so."""
    file = folder / "index.html"
    try:
        if os.path.lexists(file) and not _is_ours(file):
            return f"{file} is there already and not formnet's; it is left as it is"
        files.replace(file, index(entries))
    except OSError as error:
        return str(error)
    return None


def _is_ours(index: Path) -> bool:
    """Whether a page was written here: a regular file that says so."""
    try:
        with files.reading(index) as stream:
            return _MARK.encode() in stream.read(500)
    except OSError:
        return False


def page(run: Recorded) -> str:
    """The page about a run as HTML."""
    judged, scenario = run.verdict, run.scenario
    standing = runs.standing(judged, run.outcome, running=run.running)
    moments = _happened(run)
    hidden = max(0, len(moments) - FIRST_EVENTS - LAST_EVENTS)
    cut = FIRST_EVENTS if hidden else len(moments)
    drawn = list(pictures(run))
    return (
        _environment()
        .get_template("report.html.j2")
        .render(
            run=run,
            scenario=scenario,
            judged=judged,
            standing=standing,
            is_bad=standing in runs.BAD,
            headline=_headline(run, standing),
            notes=list(_notes(run)),
            titles=claim_words.titles(scenario),
            criteria=CRITERIA,
            equations=references(),
            settled=None if judged is None else judged.settled,
            began=run.walls[0] if run.walls else None,
            in_runs=_in_runs(run.folder),
            sections=_sections(run, [item.name for item in drawn]),
            pictures=drawn,
            first=list(map(_moment, moments[:cut])),
            hidden=hidden,
            last=list(map(_moment, moments[cut + hidden :])),
            window_s=None if judged is None else _window_s(judged),
            lost_share=_lost_share(judged),
            most_links=MOST_LINKS,
            motion={} if judged is None or judged.motion is None else judged.motion.told,
            in_flight=0 if judged is None else sum(link.in_flight for link in judged.links),
            of_the_paper=of_the_paper(scenario),
            claims={} if judged is None else judged.told,
            theory=[line.strip() for line in describe(scenario)],
            changed=_changed(run),
            robots=_robots(run),
            toml=dumps(scenario),
            shown=shown,
            plan=scenario.plan[:FIRST_EVENTS],
            more_planned=max(0, len(scenario.plan) - FIRST_EVENTS),
        )
    )


def index(entries: Sequence[runs.Entry]) -> str:
    """The page about a folder of runs as HTML, links relative to it."""
    shown_entries = [
        (entry, _there(entry.folder, "report.html"), _there(entry.folder, "figures/thumbnail.png"))
        for entry in entries[:MOST_RUNS]
    ]
    return (
        _environment()
        .get_template("index.html.j2")
        .render(
            entries=shown_entries, more=max(0, len(entries) - MOST_RUNS), in_words=runs.in_words
        )
    )


def _environment() -> Environment:
    made = environment()
    made.filters |= {
        "small": lambda value: "–" if value is None else f"{value:.2e}",
        "ms": lambda value: "–" if value is None else f"{round(value * 1e3, 3):.3g}",
        "seconds": lambda value: "–" if value is None else f"{value:.2f} s",
        "times": times,
        "percent": lambda value: f"{value:.2%}" if 0 < value < 0.1 else f"{value:.0%}",
    }
    return made


def _sections(run: Recorded, pictures: Sequence[str]) -> dict[str, str]:
    """What the page has, by anchor, in order."""
    judged = run.verdict
    found = {
        "claims": "Claims" if judged is not None else "",
        "errors": "Errors" if "errors" in pictures else "",
        "events": "What happened",
        "paths": "Paths" if "paths" in pictures else "",
        "links": "Links" if judged is not None else "",
        "timing": "Real time" if judged is not None and judged.realtime else "",
        "scenario": "Scenario",
        "repeat": "Repeat it",
    }
    return {anchor: title for anchor, title in found.items() if title}


def _headline(run: Recorded, standing: str) -> str:
    """Did it hold, and if not, what did not: in one sentence."""
    judged = run.verdict
    if judged is None:
        if run.running:
            return "It is still running; formnet report updates this page."
        if run.outcome is None:
            return "It was ended from outside, for an unknown reason; nothing was judged."
        return f"It was not judged. {run.outcome.reason}".strip()
    outcome, titles = judged.outcome, claim_words.titles(run.scenario)
    if standing == HOLDS:
        held = [titles[name] for name, c in judged.claims.items() if c.holds]
        also = ", and it diverged as expected" if outcome.kind == "diverged" else ""
        return f"Every claim holds: {', '.join(held)}{also}."
    if standing in (FAILS, NOT_JUDGED):
        said = "; ".join(_failing(judged, titles))
        return f"{claim_words.capital(said)}."
    if standing == OBSERVED:
        seen = [titles[name] for name, c in judged.claims.items() if c.observed]
        return f"Nothing was claimed. Observed: {', '.join(seen) or claim_words.nothing()}."
    if standing == "lost" and outcome.kind == "completed":
        who = named([item.robot for item in judged.robots.lost])
        return f"Nothing was claimed, and not every robot survived: it lost {who}."
    who = "" if outcome.robot is None else f", robot {outcome.robot}"
    reason = outcome.reason.rstrip(".") or "no reason is known"
    return f"The run {_ENDED[outcome.kind]} at t = {outcome.t_s:.3f} s{who}: {reason}."


def _failing(judged: Verdict, titles: Mapping[str, str]) -> Iterator[str]:
    for name, claim in judged.claims.items():
        if claim.expected is None or claim.holds:
            continue
        title, unit = titles[name], CRITERIA[name].unit
        if claim.holds is None:
            yield f"{title} could not be judged"
        elif not claim.expected:
            yield f"{title} holds, and should not"
        elif claim.largest_in_window is None:
            yield f"{title} does not hold"
        else:
            largest, tolerance = claim.largest_in_window, claim.tolerance
            when = "" if name == LYAPUNOV.name else f" in the last {_window_s(judged):g} s"
            yield (
                f"{title} does not hold: {largest:.2g} {unit}{when}, tolerance {tolerance:g} {unit}"
            )


def _notes(run: Recorded) -> Iterator[str]:
    """What a reader should know beside the verdict."""
    yield from run.problems
    judged = run.verdict
    if judged is None:
        return
    if not judged.robots.judged:
        yield "Nothing is judged: every robot was down at the end."
    elif down := judged.robots.down_at_the_end:
        yield f"Not judged: {named(down)}, down at the end."
    for lost in judged.robots.lost:
        yield f"Robot {lost.robot} was lost at t = {lost.t_s:.3f} s: {lost.reason}"
    if (rises := judged.rises_in_words) is not None:
        yield rises
    refused = sum(item.times for item in judged.messages.rejected)
    if refused:
        yield f"Messages rejected: {refused}; see below."
    for item in judged.messages.refused:
        yield f"The holder of {item.who}'s certificate was denied {item.key}"
    for closed in judged.messages.disconnected:
        yield f"The holder of {closed.who}'s certificate was disconnected: {closed.reason}"
    if _falling(judged):
        yield (
            "The errors that fail were still decreasing at the end: a longer run may help "
            "(--set duration_s=…)."
        )
    yield from judged.warnings


def _window_s(judged: Verdict) -> float:
    """The stretch that was judged: a run may have been shorter."""
    return min(judged.window_s, judged.simulated_s)


def _falling(judged: Verdict) -> bool:
    """Whether all errors that should have been small were well below their largest at the end."""
    failing = [
        (judged.error(name), claim.largest_in_window)
        for name, claim in judged.claims.items()
        if claim.expected and claim.holds is False and name in ERRORS
    ]
    return bool(failing) and all(
        last is not None and largest is not None and last < 0.9 * largest
        for last, largest in failing
    )


def _happened(run: Recorded) -> list[Event | Outcome | float]:
    """The events in order of time, and when the errors settled among them."""
    found: list[Event | Outcome | float] = [
        event for event in run.told if event.severity is not Severity.DEBUG
    ]
    settled = None if run.verdict is None else run.verdict.settling_time_s
    if settled is not None:
        found.append(settled)
    return sorted(found, key=lambda one: one if isinstance(one, float) else one.t_ns / 1e9)


def _moment(event: Event | Outcome | float) -> Moment:
    if isinstance(event, float):
        settled = "errors stay within their tolerances from here on"
        return Moment(event, "settled", settled, "good")
    bad = event.severity in (Severity.WARNING, Severity.ERROR)
    words = event.words
    words = words if len(words) <= _MOST_LETTERS else words[:_MOST_LETTERS] + "…"
    return Moment(event.t_ns / 1e9, event.name, words, "bad" if bad else "")


def _lost_share(judged: Verdict | None) -> float | None:
    """The share of all copies of messages that were lost; None without messages."""
    if judged is None or not judged.messages.fates:
        return None
    return judged.messages.lost / judged.messages.copies


def _changed(run: Recorded) -> dict[str, Any]:
    """The values of a scenario that are no defaults, without what the page shows elsewhere."""
    elsewhere = ("name", "description", "robots", "timeline", "formation.edges")
    return {
        place: value
        for place, value in by_path(run.scenario, changed_only=True).items()
        if not place.startswith(elsewhere)
    }


def _robots(run: Recorded) -> list[dict[str, Any]]:
    """A row per robot: its place, start, neighbours and damping."""
    scenario = run.scenario
    return [
        {
            "id": robot.id,
            "offset_m": robot.offset_m,
            "start": robot.start,
            "neighbours": scenario.neighbours_of[robot.id],
            "damping": scenario.vehicles[robot.id].damping,
            "mass_kg": scenario.vehicles[robot.id].mass_kg,
        }
        for robot in scenario.robots
    ]


def _in_runs(folder: Path) -> bool:
    """Whether a run lies where an index is kept."""
    return folder.resolve().parent.name == "runs"


def _there(folder: Path, name: str) -> str | None:
    """The address of a file in a run's folder, relative to the index, if it is there."""
    return quote(os.fsencode(f"{folder.name}/{name}")) if _is_there(folder, name) else None


def _is_there(folder: Path, name: str) -> bool:
    place, _, _ = name.rpartition("/")
    return (not place or files.is_folder(folder / place)) and files.is_file(folder, name)
