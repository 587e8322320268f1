"""``report.html``, a page about one run, and ``index.html``, one about all in a folder.

Everything comes from the files of the run's folder; templates/ has how it looks. Whatever
stands in a scenario or an event is text from elsewhere and is escaped (Jinja's autoescape).
"""

import base64
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined, UndefinedError
from rich.console import Console
from rich.markup import escape

from formation.loading import ScenarioError, dumps
from formation.record import Event
from formation.theory import assess
from lab import runs, verdict
from lab.check import describe
from lab.keypaths import by_path, shown
from lab.recorded import Recorded, Unreadable, read_run
from lab.run import ALL_HOLD, BAD_INPUT, CLAIM_TITLES, report_problems, times
from lab.telling import motion_told, named, told

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
    "diverged": "diverged", "interrupted": "was interrupted", "lost": "ended", "failed": "failed",
    "broken": "broke",
}  # fmt: skip
_ERRORS = {
    "formation": "formation_error_m", "heading": "heading_error_rad",
    "centroid": "centroid_error_m",
}  # fmt: skip

FIGURES = {
    "errors": "Errors of Eqs. 3–5",
    "paths": "Paths and final pattern",
    "deliveries": "Every message of every link",
    "headings": "Headings",
    "lyapunov": "V along the run",
    "delays": "Delays against what was configured",
    "graph": "Communication graph",
}


class Picture(NamedTuple):
    """A figure in the page: a data URI, and words for who cannot see it."""

    name: str
    title: str
    source: str
    alt: str


class Moment(NamedTuple):
    """Something that happened at ``t_s``; ``tone`` is ``bad``, ``good`` or empty."""

    t_s: float
    kind: str
    told: str
    tone: str


def report_runs(folders: Sequence[Path]) -> int:
    """Make the pages of runs again; the exit code of ``formnet report``."""
    console = Console(stderr=True, highlight=False)
    code = ALL_HOLD
    for folder in folders:
        try:
            file = write_report(folder, draw_missing=True)
            console.print(escape(str(file)), soft_wrap=True)
            continue
        except ScenarioError as error:
            report_problems(console, error)
        except (Unreadable, OSError) as error:
            console.print(f"[red]{escape(str(folder))}:[/] {escape(str(error))}", soft_wrap=True)
        code = BAD_INPUT
    return code


def leave(folder: Path) -> str | None:
    """The pages that a run leaves, its own and, in ``runs/``, the index; what went wrong, if so."""
    try:
        write_report(folder)
    except (Unreadable, ScenarioError, OSError) as error:
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
    run = read_run(folder, tables=draw_missing and not (folder / "figures").is_dir())
    if run.samples or run.link_rows:
        from lab import figures

        figures.draw(run, folder / "figures")
    try:
        text = page(run)
    except (KeyError, TypeError, ValueError, AttributeError, UndefinedError) as error:
        if run.verdict is None:
            raise
        run.verdict = None
        run.problems.append(f"verdict.json is of another version: {error!r}")
        text = page(run)
    _replace(folder / "report.html", text)
    return folder / "report.html"


def write_index(folder: Path, entries: Sequence[runs.Entry]) -> str | None:
    """Write ``index.html`` into a folder of runs; why it cannot be, if so."""
    file = folder / "index.html"
    try:
        if file.exists() and _MARK not in file.read_text(encoding="utf-8", errors="replace")[:500]:
            return f"{file} is there already and not formnet's; it is left as it is"
        _replace(file, index(entries))
    except OSError as error:
        return str(error)
    return None


def page(run: Recorded) -> str:
    """The page about a run as HTML."""
    judged, scenario = run.verdict, run.scenario
    standing = runs.standing(judged, run.outcome, running=run.running)
    moments = list(_moments(run))
    hidden = max(0, len(moments) - FIRST_EVENTS - LAST_EVENTS)
    cut = FIRST_EVENTS if hidden else len(moments)
    pictures = list(_pictures(run))
    return _environment().get_template("report.html.j2").render(
        run=run, scenario=scenario, judged=judged, standing=standing, is_bad=standing in runs.BAD,
        headline=_headline(run, standing), notes=list(_notes(run)), titles=CLAIM_TITLES,
        began=run.walls[0] if run.walls else None, in_runs=_in_runs(run.folder),
        sections=_sections(run, [item.name for item in pictures]), pictures=pictures,
        first=moments[:cut], hidden=hidden, last=moments[cut + hidden :],
        window_s=None if judged is None else _window_s(judged),
        lost_share=_lost_share(judged), most_links=MOST_LINKS, motion=motion_told(judged),
        in_flight=sum(link["in_flight"] for link in (judged or {}).get("links", ())),
        theory=[line.strip() for line in describe(assess(scenario))],
        changed=_changed(run), robots=_robots(run), toml=dumps(scenario), shown=shown,
        plan=scenario.plan[:FIRST_EVENTS], more_planned=max(0, len(scenario.plan) - FIRST_EVENTS),
    )  # fmt: skip


def index(entries: Sequence[runs.Entry]) -> str:
    """The page about a folder of runs as HTML, links relative to it."""
    shown_entries = [
        (entry, _there(entry.folder, "report.html"), _there(entry.folder, "figures/thumbnail.png"))
        for entry in entries[:MOST_RUNS]
    ]
    return _environment().get_template("index.html.j2").render(
        entries=shown_entries, more=max(0, len(entries) - MOST_RUNS), in_words=runs.in_words
    )  # fmt: skip


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("lab"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {
        "small": lambda value: "–" if value is None else f"{value:.2e}",
        "ms": lambda value: "–" if value is None else f"{round(value * 1e3, 3):.3g}",
        "seconds": lambda value: "–" if value is None else f"{value:.2f} s",
        "times": times,
        "percent": lambda value: f"{value:.2%}" if 0 < value < 0.1 else f"{value:.0%}",
    }
    return environment


def _sections(run: Recorded, pictures: Sequence[str]) -> dict[str, str]:
    """What the page has, by anchor, in order."""
    judged = run.verdict
    found = {
        "claims": "Claims" if judged is not None else "",
        "errors": "Errors" if "errors" in pictures else "",
        "events": "What happened",
        "paths": "Paths" if "paths" in pictures else "",
        "links": "Links" if judged is not None else "",
        "timing": "Real time" if judged is not None and judged["realtime"] else "",
        "scenario": "Scenario",
        "repeat": "Repeat it",
    }
    return {anchor: title for anchor, title in found.items() if title}


def _headline(run: Recorded, standing: str) -> str:
    """Did it hold, and if not, what did not: in one sentence."""
    judged = run.verdict
    if judged is None:
        if run.running:
            return "It is still running; formnet report makes this page again."
        if run.outcome is None:
            return "It was ended from outside: nothing says how, and nothing was judged."
        return f"It was not judged. {run.outcome.reason}".strip()
    outcome = judged["outcome"]
    if standing == verdict.HOLDS:
        held = [CLAIM_TITLES[name][0] for name, c in judged["claims"].items() if c["holds"]]
        also = ", and it diverged as expected" if outcome["kind"] == "diverged" else ""
        return f"Every claim holds: {', '.join(held)}{also}."
    if standing in (verdict.FAILS, verdict.NOT_JUDGED):
        said = "; ".join(_failing(judged))
        return f"{said[0].upper()}{said[1:]}."
    if standing == verdict.OBSERVED:
        seen = [CLAIM_TITLES[name][0] for name, c in judged["claims"].items() if c["observed"]]
        return f"Nothing was claimed. Observed: {', '.join(seen) or 'none of the equations'}."
    if standing == "lost" and outcome["kind"] == "completed":
        who = named([item["robot"] for item in judged["robots"]["lost"]])
        return f"Nothing was claimed, and not every robot lasted: it lost {who}."
    who = "" if outcome["robot"] is None else f", robot {outcome['robot']}"
    reason = outcome["reason"].rstrip(".") or "nothing says why"
    return f"The run {_ENDED[outcome['kind']]} at t = {outcome['t_s']:.3f} s{who}: {reason}."


def _failing(judged: Mapping[str, Any]) -> Iterator[str]:
    for name, claim in judged["claims"].items():
        if claim["expected"] is None or claim["holds"]:
            continue
        title, unit = CLAIM_TITLES[name]
        if claim["holds"] is None:
            yield f"{title} could not be judged"
        elif not claim["expected"]:
            yield f"{title} holds, and should not"
        elif claim["largest_in_window"] is None:
            yield f"{title} does not hold"
        else:
            largest, tolerance = claim["largest_in_window"], claim["tolerance"]
            when = "" if name == "lyapunov" else f" in the last {_window_s(judged):g} s"
            yield (f"{title} does not hold: {largest:.2g} {unit}{when}, "
                   f"tolerance {tolerance:g} {unit}")  # fmt: skip


def _notes(run: Recorded) -> Iterator[str]:
    """What a reader should know beside the verdict."""
    yield from run.problems
    judged = run.verdict
    if judged is None:
        return
    if not judged["robots"]["judged"]:
        yield "Nobody is judged: every robot was down at the end."
    elif down := judged["robots"]["down_at_the_end"]:
        yield f"Judged without {named(down)}, down at the end."
    for lost in judged["robots"]["lost"]:
        yield f"Robot {lost['robot']} was lost at t = {lost['t_s']:.3f} s: {lost['reason']}"
    if (rises := verdict.rises_in_words(judged)) is not None:
        yield rises
    refused = sum(item["times"] for item in judged["messages"]["rejected"])
    if refused:
        yield f"Messages refused: {refused}; see below."
    for item in judged["messages"].get("refused", ()):  # not in older runs
        yield f"who has {item['who']}'s certificate was denied {item['key']}"
    if _falling(judged):
        yield ("What fails was still falling at the end: it may need a longer run "
               "(--set duration_s=…).")  # fmt: skip
    yield from judged.get("warnings", assess(run.scenario).warnings)  # not in older runs


def _window_s(judged: Mapping[str, Any]) -> float:
    """The stretch that was judged: a run may have been shorter."""
    return float(min(judged["window_s"], judged["simulated_s"]))


def _falling(judged: Mapping[str, Any]) -> bool:
    """Whether all errors that should have been small were well below their largest at the end."""
    failing = [
        (judged[_ERRORS[name]], claim["largest_in_window"])
        for name, claim in judged["claims"].items() if claim["expected"] and claim["holds"] is False
        and name in _ERRORS
    ]  # fmt: skip
    return bool(failing) and all(
        last is not None and largest is not None and last < 0.9 * largest
        for last, largest in failing
    )


def _moments(run: Recorded) -> Iterator[Moment]:
    """The events in order of time, and when the errors settled among them."""
    found = [_moment(event) for event in run.events if event.kind != "timing"]
    settled = None if run.verdict is None else run.verdict["settling_time_s"]
    if settled is not None:
        found.append(
            Moment(settled, "settled", "errors stay within their tolerances from here on", "good")
        )
    if run.outcome is not None:
        who = "" if run.outcome.robot is None else f"robot {run.outcome.robot}: "
        well = run.outcome.kind == "completed"
        found.append(Moment(run.outcome.t_ns / 1e9, run.outcome.kind,
                            f"{who}{run.outcome.reason}", "" if well else "bad"))  # fmt: skip
    yield from sorted(found, key=lambda moment: moment.t_s)


def _moment(event: Event) -> Moment:
    bad = event.kind in (
        "lost",
        "host lost",
        "kill",
        "rejected",
        "refused",
        "silent at the end",
        "waiting",
    )
    words = told(event.kind, event.details)
    words = words if len(words) <= _MOST_LETTERS else words[:_MOST_LETTERS] + "…"
    return Moment(event.t_ns / 1e9, event.kind, words, "bad" if bad else "")


def _pictures(run: Recorded) -> Iterator[Picture]:
    """Every figure there is, as PNG or SVG, whichever is smaller."""
    for name, title in FIGURES.items():
        found: list[tuple[bytes, str]] = []
        for suffix, kind in (("png", "image/png"), ("svg", "image/svg+xml")):
            with suppress(OSError):
                found.append(((run.folder / "figures" / f"{name}.{suffix}").read_bytes(), kind))
        if found:
            data, kind = min(found, key=lambda item: len(item[0]))
            source = f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"
            yield Picture(name, title, source, _in_words(name, run))


def _in_words(name: str, run: Recorded) -> str:
    """What a figure shows."""
    judged, scenario = run.verdict, run.scenario
    if name == "errors" and judged is not None:
        ends = ", ".join(
            f"{CLAIM_TITLES[claim][0]} {value:.1e} {CLAIM_TITLES[claim][1]}"
            for claim, key in _ERRORS.items() if (value := judged[key]) is not None
        )  # fmt: skip
        return f"Errors over time on a log axis, with their tolerances. At the end: {ends}."
    if name == "graph":
        edges = ", ".join(f"{a} to {b}" for a, b in scenario.formation.edges) or "none"
        return f"The robots at their places in the pattern. Edges: {edges}."
    return {
        "errors": "Errors of Eqs. 3 to 5 over time on a log axis, with their tolerances.",
        "paths": f"The paths of {len(scenario.ids)} robots in the plane, and where they are at the "
        "end beside the desired pattern.",
        "headings": "The robots' headings over time, and their gaps to the first one's.",
        "lyapunov": "V over time on a log axis; stretches in which it gains more than its budget "
        "are shaded.",
        "deliveries": "A band per link: the delay of every message at the time of its sending, or "
        "how it was lost.",
        "delays": "Histograms of measured delays beside the configured distributions.",
    }[name]  # fmt: skip


def _lost_share(judged: Mapping[str, Any] | None) -> float | None:
    """The share of all copies of messages that were lost; None without messages."""
    fates = {} if judged is None else judged["messages"]["fates"]
    lost = sum(count for fate, count in fates.items() if fate.startswith("lost"))
    return lost / sum(fates.values()) if fates else None


def _changed(run: Recorded) -> dict[str, Any]:
    """The values of a scenario that are no defaults, without what the page shows elsewhere."""
    elsewhere = ("name", "description", "robots", "timeline", "formation.edges")
    return {
        place: value for place, value in by_path(run.scenario, changed_only=True).items()
        if not place.startswith(elsewhere)
    }  # fmt: skip


def _robots(run: Recorded) -> list[dict[str, Any]]:
    """A row per robot: its place, start, neighbours and damping."""
    scenario = run.scenario
    return [
        {
            "id": robot.id, "offset_m": robot.offset_m, "start": robot.start,
            "neighbours": scenario.neighbours_of[robot.id],
            "damping": scenario.vehicles[robot.id].damping,
            "mass_kg": scenario.vehicles[robot.id].mass_kg,
        }
        for robot in scenario.robots
    ]  # fmt: skip


def _in_runs(folder: Path) -> bool:
    """Whether a run lies where an index is kept."""
    return folder.resolve().parent.name == "runs"


def _there(folder: Path, name: str) -> str | None:
    """A file in a run's folder, relative to the index, if it is there."""
    return f"{folder.name}/{name}" if (folder / name).is_file() else None


def _replace(file: Path, text: str) -> None:
    """Put ``text`` into ``file`` in one step: nobody ever reads half a page."""
    part = file.with_name(f".{file.name}.{os.getpid()}")
    part.write_text(text, encoding="utf-8")
    part.replace(file)
