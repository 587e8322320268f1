"""How a run ended, as tables and lines for people: its verdict (:mod:`lab.verdict.model`)."""

from rich.console import Console
from rich.table import Table

from formnet.formation.paper.theory import of_the_paper
from formnet.formation.records.events import named
from formnet.formation.scenario.expect import CRITERIA, LYAPUNOV
from formnet.formation.scenario.model import Scenario
from formnet.lab.judge import claim_words
from formnet.lab.runs.words import times
from formnet.lab.text.console import escape
from formnet.lab.text.tables import Column, output, table
from formnet.lab.verdict.model import FAILS, HOLDS, NOT_JUDGED, Verdict
from formnet.lab.verdict.realtime import Spread, Timing


def claims_table(judged: Verdict, scenario: Scenario) -> Table:
    """What was claimed and observed, a row a claim; ``judged`` is the run's verdict."""
    marks = {True: "[green]holds[/]", False: "[red]FAILS[/]", None: "[dim]not judged[/]"}
    words = {True: "yes", False: "no", None: "-"}
    titles = claim_words.titles(scenario)
    columns = [
        Column("claim", left=True),
        Column("expected", 3),
        Column("observed", 4),
        Column("largest at end", 1),
        Column("tolerance", 2),
        Column("verdict"),
    ]
    rows = []
    for claim, entry in judged.told.items():
        unit = CRITERIA[claim].unit
        largest = entry.largest_in_window
        rows.append(
            [
                titles[claim],
                words[entry.expected],
                words[entry.observed],
                "-" if largest is None else f"{largest:.2e} {unit}",
                f"{entry.tolerance:g} {unit}",
                "[dim]not claimed[/]" if entry.expected is None else marks[entry.holds],
            ]
        )
    why = f": {escape(judged.why)}" if of_the_paper(scenario) else ""
    title = f"{judged.scenario}{why}"
    made = table(title, columns, rows, "all are in verdict.json", output().width)
    if judged.claims[LYAPUNOV.name].largest_in_window is not None:
        said = "V: the largest rise of the whole run, relative to V"
        made.caption = f"{made.caption}\n{said}" if made.caption else said
    return made


def timing_table(timing: Timing, sync_bound_s: float) -> Table:
    """How well a run in real time kept its time, by process."""
    columns = [
        Column(""),
        Column("missed periods"),
        Column("woke late", 3),
        Column("sense→drive", 1),
        Column("transit", 4),
        Column("clock", 2),
    ]

    def spread(found: Spread | None) -> str:
        return "-" if found is None else f"{1e3 * found.p50:.2f} {1e3 * found.p99:.2f}"

    rows = [["plant", "", spread(timing.plant.woke_late_s), "", "", ""]]
    for robot, own in timing.robots.items():
        bound_s = own.clock_uncertainty_s
        known = f"±{1e3 * bound_s:.2f}"
        rows.append(
            [
                f"robot {robot}",
                f"{own.missed} of {own.periods}",
                spread(own.woke_late_s),
                spread(own.sense_to_drive_s),
                spread(own.transit_s),
                known if bound_s <= sync_bound_s else f"[red]{known}[/]",
            ]
        )
    where = "all are in verdict.json"
    return table(f"real time (p50, p99 in ms; {where})", columns, rows, where, output().width)


def summarise(console: Console, scenario: Scenario, judged: Verdict) -> None:
    """Print how a run ended: what went wrong, how well it kept time, and what became of it."""
    outcome = judged.outcome
    if judged.motion is not None:
        words = "; ".join(f"{title} {value}" for title, value in judged.motion.told.items())
        console.print(words, soft_wrap=True)
    if outcome.kind != "completed":
        who = "" if outcome.robot is None else f" robot {outcome.robot}:"
        console.print(
            f"[red]{outcome.kind}[/] at t = {outcome.t_s:.3f} s:{who} " + escape(outcome.reason),
            soft_wrap=True,
        )
    if outcome.kind == "diverged":
        for warning in judged.warnings:
            console.print(f"[yellow]earlier warning:[/] {escape(warning)}", soft_wrap=True)
    if (rises := judged.rises_in_words) is not None:
        console.print(escape(rises), soft_wrap=True)
    robots = judged.robots
    for lost in robots.lost:
        console.print(
            f"[red]lost[/] at t = {lost.t_s:.3f} s: robot {lost.robot}: " + escape(lost.reason),
            soft_wrap=True,
        )
    if not robots.judged:
        console.print("nothing is judged: every robot was down at the end")
    elif robots.down_at_the_end:
        console.print(f"not judged: {named(robots.down_at_the_end)}, down at the end")
    for item in judged.messages.rejected:
        console.print(
            f"[yellow]rejected:[/] robot {item.robot} refused messages from "
            f"{item.source}, {item.times} ×: {escape(item.reason)}"
        )
    for denied in judged.messages.refused:
        console.print(
            f"[yellow]refused:[/] the holder of {escape(denied.who)}'s certificate was denied "
            f"{escape(denied.key)}, {denied.times} × or more",
            soft_wrap=True,
        )
    for closed in judged.messages.disconnected:
        console.print(
            f"[yellow]disconnected:[/] the holder of {escape(closed.who)}'s certificate, "
            f"{closed.times} × or more: {escape(closed.reason)}",
            soft_wrap=True,
        )
    if judged.realtime is not None:
        console.print(timing_table(judged.realtime, scenario.clock.sync_bound_s))
    factor = judged.realtime_factor or 0.0
    settled = {"never": "it did not settle; ", "–": ""}.get(
        at := judged.settled, f"settled after {at}; "
    )
    console.print(
        f"{settled}simulated {judged.simulated_s:.1f} s in {judged.wall_s:.1f} s "
        f"({times(factor)} real time)"
    )
    console.print(f"sha256 of the trajectories: {judged.trajectory_sha256[:16]}…")
    if outcome.planned:
        console.print(_in_a_word(judged, claim_words.titles(scenario)))


def _in_a_word(judged: Verdict, titles: dict[str, str]) -> str:
    claims = judged.claimed
    if not claims:
        trouble = "" if judged.passed else ", but the run diverged or lost a robot"
        return f"nothing was claimed{trouble}"
    if judged.standing == HOLDS:
        return "[green]every claim holds[/]"
    found = {
        word: [titles[name] for name, holds in claims.items() if holds is value]
        for word, value in ((FAILS, False), (NOT_JUDGED, None))
    }
    return "; ".join(f"[red]{word}:[/] {', '.join(some)}" for word, some in found.items() if some)
