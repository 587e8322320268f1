"""Figures of the links: delays against what was configured, and every message of every link."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from formnet.formation.plan.timeline import arrows
from formnet.formation.records.rows import LinkRow
from formnet.formation.scenario.model import Scenario
from formnet.lab.figures.canvas import COLOURS, blank
from formnet.lab.figures.plotting import Axes, Figure, Line2D
from formnet.lab.runs.recording import Collected
from formnet.netem.settings.links import LinkSettings
from formnet.netem.settings.timeline import NEVER

MOST_PROFILES = 6
"""How many profiles the delay figure shows: those that delivered most."""
MOST_LINKS = 24
"""How many links the delivery figure shows."""

_BINS = 60
_FOOT, _LOW, _HIGH = -0.4, -0.28, 0.4
"""Heights in a band of links from -0.5 to 0.5: of what is lost, of no delay, of the longest."""
_FATES = {
    "delivered": COLOURS[0],
    "duplicated": COLOURS[5],
    "corrupted": COLOURS[2],
    "lost: random": COLOURS[1],
    "lost: burst": COLOURS[3],
    "lost: cut": COLOURS[6],
    "lost: queue": COLOURS[4],
    "lost: late": "#882255",
    "lost: trace": COLOURS[7],
    "lost: receiver down": "#888888",
}


class Stretch(NamedTuple):
    """A stretch of time in which a link's settings stay what they are (None: they ramp)."""

    begin_ns: int
    end_ns: int
    settings: LinkSettings | None
    is_cut: bool


def of(recording: Collected) -> dict[str, Callable[[], Figure]]:
    """What makes the figures, by name; none without messages."""
    by_link: dict[tuple[int, int], list[LinkRow]] = {}
    for row in recording.link_rows:
        by_link.setdefault((row.source, row.destination), []).append(row)
    if not by_link:
        return {}
    by_link = dict(sorted(by_link.items()))
    return {
        "delays": partial(delays, recording.scenario, by_link),
        "deliveries": partial(deliveries, recording.scenario, by_link, _end_s(recording)),
    }


def stretches(scenario: Scenario, source: int, destination: int) -> Iterator[Stretch]:
    """The history of one directed link, from 0 on."""
    timeline = scenario.timeline_of(source, destination)
    begin_ns = 0
    timeline.advance(0)
    while begin_ns < NEVER:
        settings = None if timeline.ramping else timeline.settings
        yield Stretch(begin_ns, timeline.next_ns, settings, timeline.is_cut)
        begin_ns = timeline.next_ns
        timeline.advance(begin_ns)


def delays(scenario: Scenario, by_link: dict[tuple[int, int], list[LinkRow]]) -> Figure:
    """A histogram for each set of settings in use, beside the distribution it asks for."""
    pooled: dict[str, tuple[LinkSettings, list[tuple[int, int]], list[NDArray[np.float64]]]] = {}
    for link, rows in by_link.items():
        arrived = [(row.t_sent_ns, row.t_usable_ns) for row in rows if row.t_usable_ns is not None]
        times = np.array(arrived, dtype=np.int64).reshape(-1, 2)
        for stretch in stretches(scenario, *link):
            here = (times[:, 0] >= stretch.begin_ns) & (times[:, 0] < stretch.end_ns)
            if stretch.settings is None or not here.any():
                continue
            key = stretch.settings.model_dump_json()
            _, links, found = pooled.setdefault(key, (stretch.settings, [], []))
            found.append((times[here, 1] - times[here, 0]) / 1e6)
            if link not in links:
                links.append(link)
    profiles = sorted(pooled.values(), key=lambda profile: -sum(map(len, profile[2])))
    shown = profiles[:MOST_PROFILES]
    columns = min(2, max(1, len(shown)))
    rows_of_panels = max(1, -(-len(shown) // columns))
    figure = blank(6.4 if columns == 1 else 5.0 * columns, 3.6 * rows_of_panels)
    panels = np.atleast_1d(figure.subplots(rows_of_panels, columns, squeeze=False)).ravel()
    for panel in panels[len(shown) :]:
        panel.set_axis_off()
    for panel, (settings, links, found) in zip(panels, shown, strict=False):
        _histogram(panel, settings, np.concatenate(found))
        names = "all links" if len(links) == len(by_link) else arrows(links)
        panel.set_title(f"{_delay_in_words(settings)}\n{_cut_short(names)}", fontsize=8.5)
    if len(profiles) > MOST_PROFILES:
        figure.suptitle(f"{MOST_PROFILES} of {len(profiles)} profiles, those that carried most")
    return figure


def _histogram(axes: Axes, settings: LinkSettings, delays_ms: NDArray[np.float64]) -> None:
    u = (np.arange(20_000) + 0.5) / 20_000
    if settings.playout_s:
        asked_ms = np.full(len(u), settings.playout_s * 1e3)
    else:
        asked_ms = np.array([settings.delay.quantile_s(float(x)) for x in u]) * 1e3
    top = max(float(delays_ms.max()), float(np.quantile(asked_ms, 0.999)))
    low = min(float(delays_ms.min()), float(asked_ms.min()))
    if top - low < 1e-3:  # a constant: a bar of its own, with room beside it
        low, top = low - 0.5, top + 0.5
    bins = [float(edge) for edge in np.linspace(low, top, _BINS + 1)]
    weights = np.full(len(delays_ms), 100.0 / len(delays_ms))
    axes.hist(
        delays_ms,
        bins,
        weights=weights,
        color=COLOURS[5],
        label=f"measured, {len(delays_ms):,} messages",
    )
    shares = np.histogram(asked_ms, bins)[0] * (100.0 / len(u))
    axes.stairs(shares, bins, color=COLOURS[1], lw=1.4, label=f"configured{_moved_by(settings)}")
    axes.set_xlabel("delay (ms)")
    axes.set_ylabel("messages (%)")
    axes.legend(loc="upper right", fontsize=8)


def _delay_in_words(settings: LinkSettings) -> str:
    items = settings.delay.model_dump(exclude_none=True).items()
    words = [
        f"{key} {value:g}" for key, value in items if isinstance(value, float) and value != 0.0
    ]
    return _cut_short(f"{settings.delay.distribution} {', '.join(words)}".strip())


def _moved_by(settings: LinkSettings) -> str:
    """What beside the delay decides when a message arrives."""
    others = {
        "reordering": settings.reorder.probability,
        "rate": settings.rate.bits_per_s,
        "slots": settings.slots.max_s,
        "order": settings.keep_order,
    }
    if settings.playout_s:
        return " playout"
    beside = [name for name, on in others.items() if on]
    return f", before {', '.join(beside)}" if beside else ""


def _cut_short(text: str, longest: int = 75) -> str:
    return text if len(text) <= longest else text[: longest - 1] + "…"


def _end_s(recording: Collected) -> float:
    """When the run ended, as far as is known."""
    ended_s = 0.0 if recording.outcome is None else recording.outcome.t_ns / 1e9
    return ended_s or recording.scenario.duration_s


def deliveries(
    scenario: Scenario, by_link: dict[tuple[int, int], list[LinkRow]], end_s: float
) -> Figure:
    """Every message of every link at the time of its sending: its delay, or how it was lost.

    Each link has a band, in which height is delay; the grey stretches are cuts. A delay that is
    always the same is drawn in the middle of its band and named beside it. What is lost is at the
    foot of the band.
    """
    shown = list(by_link.items())[:MOST_LINKS]
    highest_ms = (
        max(
            (
                row.t_usable_ns - row.t_sent_ns
                for _, rows in shown
                for row in rows
                if row.t_usable_ns
            ),
            default=0,
        )
        / 1e6
        or 1.0
    )
    figure = blank(11.0, 1.3 + 0.5 * len(shown))
    axes = figure.subplots()
    points: dict[str, list[tuple[float, float]]] = {}
    constant: dict[int, str] = {}
    for band, (link, rows) in enumerate(shown):
        different = {row.t_usable_ns - row.t_sent_ns for row in rows if row.t_usable_ns is not None}
        if len(different) == 1:
            constant[band] = f"{different.pop() / 1e6:.3g} ms"
        for row in rows:
            height = _FOOT
            if row.t_usable_ns is not None and band in constant:
                height = 0.0
            elif row.t_usable_ns is not None:
                share = (row.t_usable_ns - row.t_sent_ns) / 1e6 / highest_ms
                height = _LOW + (_HIGH - _LOW) * share
            points.setdefault(row.fate, []).append((row.t_sent_ns / 1e9, height - band))
        for stretch in stretches(scenario, *link):
            if stretch.is_cut and stretch.begin_ns / 1e9 < end_s:
                begin_s = stretch.begin_ns / 1e9
                length_s = min(stretch.end_ns / 1e9, end_s) - begin_s
                axes.broken_barh([(begin_s, length_s)], (-band - 0.46, 0.92), color="0.9", zorder=0)
        axes.axhline(-band - 0.5, color="0.75", lw=0.6, zorder=0)
    for fate, colour in _FATES.items():
        xy = np.array(points.get(fate, [])).reshape(-1, 2)
        if len(xy):
            marker, size = ("|", 5.0) if "lost" in fate else (".", 1.5)
            axes.plot(xy[:, 0], xy[:, 1], marker, color=colour, ms=size, mew=0.6, rasterized=True)
    axes.set_yticks([-band for band in range(len(shown))], [f"{a}→{b}" for (a, b), _ in shown])
    axes.set_ylim(-len(shown) + 0.5, 0.5)
    if constant:
        beside = axes.secondary_yaxis("right")
        beside.set_yticks([-band for band in constant], list(constant.values()))
        beside.tick_params(length=0, labelsize=8)
    axes.set_xlim(0.0, end_s)
    axes.set_xlabel("sent at t (s)")
    more = f"; the first {MOST_LINKS} of {len(by_link)} links" if len(by_link) > MOST_LINKS else ""
    height_is = f"height in a band: delay, up to {highest_ms:.3g} ms"
    if constant:
        height_is += "; a constant delay: in the middle, with its value on the right"
    axes.set_title(f"{height_is}{more}", fontsize=9)
    handles = [
        Line2D([], [], color=colour, marker="o", ms=4, ls="none", label=fate)
        for fate, colour in _FATES.items()
        if fate in points
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), fontsize=8)
    return figure
