"""A run as a scene in Rerun: the field, errors and V, links, events.

The same scene goes to ``run.rrd`` and to a live viewer. Records come in (:meth:`Scene.take`),
frames go out in columns (:meth:`Scene.flush`); nothing here knows where they end up. Two
timelines: ``sim_time``, the run's, and ``wall_time``, when the records came.

Rerun's two-dimensional views have y downwards: the field is drawn with -y. Positions are its
32-bit floats.
"""

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from formnet.formation.paper.geometry import errors, fitted_rotation, rotated
from formnet.formation.paper.theory import CLAIMS
from formnet.formation.scenario.model import Scenario
from formnet.formation.wire.record import Event, LinkRow, LinkRows, Outcome, Record, Sample, Samples
from formnet.lab.figures import presence
from formnet.lab.figures.canvas import SCREEN_COLOURS, bowed, bows, colours
from formnet.lab.judge.claim_words import UNITS
from formnet.lab.runs.words import told
from formnet.lab.scene.blueprint import blueprint, half_width, scale_bar
from formnet.netem.core.transit import DELIVERED, DUPLICATED
from formnet.netem.files.tables import nanoseconds
from formnet.netem.settings.timeline import NEVER, Timeline

MOST_FRAMES = 3000
"""Instants of a run that are shown, at most; evenly apart, and the last one."""
MOST_CELLS = 600_000
"""... and at most so many divided by robots and directed links together."""
MOST_WINDOWS = 600
"""Stretches of a run over which a link's delay and loss are averaged, at most."""
LINKS_LATE_NS = 1_200_000_000
"""What became of messages up to an instant is known so much later, at the latest."""
_TOGETHER = 10
_DASHES = 7
_BENDS = 5
"""Straight parts of a link that bends around others."""
_MOST_LABELS = 40
_GREY = 0x9A9A9AFF
_FLOOR = 1e-16

Array = NDArray[Any]


class Scene:
    """Draws a run of ``scenario`` into ``stream``.

    ``live``: somebody looks at the newest frame, so it has links as they were last known to be,
    until more is known, and delay and loss come as soon as they are known.
    """

    def __init__(
        self, scenario: Scenario, stream: rr.RecordingStream, *, live: bool = False
    ) -> None:
        self._scenario, self._stream, self._live = scenario, stream, live
        self._links = scenario.directed_links
        column = {robot: k for k, robot in enumerate(scenario.ids)}
        edges = [(column[a], column[b]) for a, b in scenario.formation.edges]
        self._edges = np.array(edges, dtype=np.intp).reshape(-1, 2)
        self._edge_bows = bows(scenario.offsets_m * [1.0, -1.0], edges)  # as the field is drawn
        self._bows = _both_ways(scenario, self._edge_bows)
        self._stride = _stride(scenario, self._bows)
        self._roster = scenario.roster()
        self._plan = [(nanoseconds(e.at_s), e.what) for e in scenario.plan if not e.robots]
        self._instants: list[tuple[int, list[Sample]]] = []  # to be drawn
        self._newest: tuple[int, list[Sample]] | None = None
        self._shown_ns = -1
        self._before: Array | None = None  # where the robots were in the frame before
        self._anchors: list[tuple[int, int]] = []  # instants, and when they were heard of
        self._heard = _Heard(scenario)
        self._to_link: list[tuple[int, Array]] = []  # frames whose links are not known yet
        self._colours = np.full((1, len(self._links)), _GREY, dtype=np.uint32)  # as last known
        self._traffic = _Traffic(scenario, stream, together=1 if live else _TOGETHER)
        self._begin()

    def take(self, record: Record, wall_ns: int) -> None:
        """Take in one record, which came at ``wall_ns`` (nanoseconds since 1970)."""
        if isinstance(record, Samples) and record.rows:
            self._note_plan(record.rows[-1].t_ns, wall_ns)
            self._anchors.append((record.rows[-1].t_ns, wall_ns))
            for t_ns, rows in groupby(record.rows, key=lambda row: row.t_ns):
                self._newest = (t_ns, list(rows))
                if t_ns // self._scenario.clock.broadcast_period_ns % self._stride == 0:
                    self._instants.append(self._newest)
        elif isinstance(record, LinkRows):
            for row in record.rows:
                self._heard.take(row)
                self._traffic.take(row)
        elif isinstance(record, Event):
            if record.kind == "lost":
                self._roster.lose(record.details["robot"], record.details["tick"])
            self._say(record.t_ns, wall_ns, record.kind, record.details)
        elif isinstance(record, Outcome):
            self._say(record.t_ns, wall_ns, record.kind,
                      {"robot": record.robot, "reason": record.reason})  # fmt: skip

    @property
    def pending(self) -> int:
        """How many frames wait for :meth:`flush`."""
        return len(self._instants)

    def flush(self, *, last: bool = False) -> None:
        """Draw what came since the last time; ``last``: nothing more comes."""
        newest = self._newest
        if newest is None:
            return
        drawn_ns = self._instants[-1][0] if self._instants else self._shown_ns
        if last and newest[0] > drawn_ns:
            self._instants.append(newest)
        if self._instants:
            self._draw()
        known_ns = NEVER if last else newest[0] - LINKS_LATE_NS
        self._draw_links(known_ns)
        self._traffic.flush(known_ns, self._times)

    def lyapunov(self, t_s: Array, v: Array) -> None:
        """Draw V (n,) at ``t_s`` (n,), seconds."""
        keep = np.flatnonzero(np.isfinite(v) & (v > 0.0))[:: self._stride]
        if len(keep):
            self._series("lyapunov/v", (t_s[keep] * 1e9).astype(np.int64), np.log10(v[keep]))

    # --- the parts of a frame ----------------------------------------------------------------

    def _begin(self) -> None:
        """What does not change, and the blueprint."""
        scenario, stream = self._scenario, self._stream
        self._half = half_width(scenario)
        stream.send_blueprint(blueprint(scenario, self._half))
        self._size = size = 2.0 * self._half
        stream.log("field/robots", rr.Points2D.from_fields(radii=[0.018 * size]), static=True)
        stream.log("field/names", rr.Points2D.from_fields(
            radii=[0.0], labels=list(map(str, scenario.ids)), show_labels=True,
            colors=_rgba(len(scenario.ids)),
        ), static=True)  # fmt: skip
        stream.log("field/headings", rr.Arrows2D.from_fields(radii=[0.004 * size]), static=True)
        stream.log("field/pattern", rr.LineStrips2D.from_fields(
            radii=[0.004 * size], colors=[0xC4C4C4FF]), static=True)  # fmt: skip
        stream.log("field/places", rr.Points2D.from_fields(
            radii=[0.009 * size], colors=[0xC4C4C4FF]), static=True)  # fmt: skip
        bar, length = scale_bar(scenario, self._half)
        stream.log("field/scale", rr.LineStrips2D(
            [bar], radii=[0.003 * size], colors=[_GREY], labels=[f"{length:g} m"], show_labels=True,
        ), static=True)  # fmt: skip
        for name, colour in zip(CLAIMS, _rgba(len(CLAIMS)), strict=True):
            _label(stream, f"errors/{name}", f"log10 {name} ({UNITS[name]})", int(colour))
        _label(stream, "lyapunov/v", "log10 V")

    def _times(self, t_ns: Array) -> list[rr.TimeColumn]:
        anchors = np.array(self._anchors or [(0, 0)])
        wall = np.interp(t_ns, anchors[:, 0], anchors[:, 1] - anchors[0, 1])
        self._anchors = self._anchors[-5000:]
        return [
            rr.TimeColumn("sim_time", duration=np.asarray(t_ns).astype("timedelta64[ns]")),
            rr.TimeColumn("wall_time", timestamp=(
                (wall.astype(np.int64) + anchors[0, 1]).astype("datetime64[ns]"))),
        ]  # fmt: skip

    def _series(self, entity: str, t_ns: Array, values: Array) -> None:
        self._stream.send_columns(entity, self._times(t_ns), rr.Scalars.columns(scalars=values))

    def _draw(self) -> None:
        instants, self._instants = self._instants, []
        t_ns = np.array([t for t, _ in instants])
        table = np.array([[row[2:5] for row in rows] for _, rows in instants])
        self._shown_ns = int(t_ns[-1])
        places, headings = table[..., :2], table[..., 2]
        drawn = places * [1.0, -1.0]
        half = half_width(self._scenario, places, self._half)
        if half > self._half:  # somebody leaves what is in sight
            self._half = half
            self._stream.send_blueprint(blueprint(self._scenario, half))
        up = presence.up(self._scenario, self._roster, t_ns)
        colours = np.where(up, _rgba(len(self._scenario.ids)), _GREY).astype(np.uint32)
        count = len(self._scenario.ids)
        times, send, sizes = self._times(t_ns), self._stream.send_columns, [count] * len(t_ns)
        send("field/robots", times, rr.Points2D.columns(
            positions=drawn.reshape(-1, 2), colors=colours.reshape(-1),
        ).partition(sizes))  # fmt: skip
        if count <= _MOST_LABELS:
            send("field/names", times, rr.Points2D.columns(
                positions=(drawn + self._size * _aside(drawn)).reshape(-1, 2),
            ).partition(sizes))  # fmt: skip
        vectors = np.stack([np.cos(headings), -np.sin(headings)], axis=-1) * 0.05 * self._size
        send("field/headings", times, rr.Arrows2D.columns(
            origins=drawn.reshape(-1, 2), vectors=vectors.reshape(-1, 2),
            colors=colours.reshape(-1)).partition(sizes))  # fmt: skip
        before = np.concatenate([drawn[:1] if self._before is None else self._before, drawn[:-1]])
        self._before = drawn[-1:]
        steps = np.stack([before, drawn], axis=2).reshape(-1, 2, 2)
        send("field/trails", times, rr.LineStrips2D.columns(
            strips=steps, colors=colours.reshape(-1)).partition(sizes))  # fmt: skip
        self._draw_errors(t_ns, places, headings, up)
        self._to_link += zip(t_ns.tolist(), drawn, strict=True)

    def _draw_errors(
        self, t_ns: Array, places: Array, headings: Array, up: NDArray[np.bool_]
    ) -> None:
        """The errors of those who are up, and the pattern at their place."""
        offsets = self._scenario.offsets_m
        found = np.full((len(t_ns), 3), np.nan)
        pattern = np.full((len(t_ns), len(offsets), 2), np.nan)
        for who in np.unique(up, axis=0):
            rows = (up == who).all(axis=1) & np.isfinite(places).all(axis=(1, 2))
            if not who.any() or not rows.any():
                continue
            here, its = places[rows][:, who], offsets[who]
            with np.errstate(over="ignore", invalid="ignore"):  # a diverging run overflows
                found[rows] = np.stack(errors(here, headings[rows][:, who], its), axis=-1)
                turned = rotated(offsets - its.mean(axis=0), fitted_rotation(here, its))
                pattern[rows] = turned + here.mean(axis=1, keepdims=True)
        for name, column in zip(CLAIMS, found.T, strict=True):
            known = np.isfinite(column)
            if known.any():
                logs = np.log10(np.maximum(column[known], _FLOOR))
                self._series(f"errors/{name}", t_ns[known], logs)
        known = np.isfinite(pattern).all(axis=(1, 2))
        if known.any():
            drawn = (pattern * [1.0, -1.0])[known]
            times, send = self._times(t_ns[known]), self._stream.send_columns
            send("field/places", times, rr.Points2D.columns(
                positions=drawn.reshape(-1, 2),
            ).partition([len(offsets)] * len(drawn)))  # fmt: skip
            if len(self._edges):
                send("field/pattern", times, self._edges_between(drawn))

    def _edges_between(self, places: Array) -> Any:
        """The graph's edges between places (frames, robots, 2), in columns."""
        parts = np.where(self._edge_bows != 0.0, _BENDS, 1)
        bows, of = (np.tile(x, len(places)) for x in (self._edge_bows, parts))
        lines = places[:, self._edges].reshape(-1, 2, 2)
        strips = _strips(lines, bows, of, np.zeros_like(of))
        return rr.LineStrips2D.columns(strips=strips).partition([int(parts.sum())] * len(places))

    def _draw_links(self, known_ns: int) -> None:
        """The links of frames up to ``known_ns``."""
        ready = [frame for frame in self._to_link if frame[0] <= known_ns]
        self._to_link = self._to_link[len(ready) :]
        if not self._links:
            return
        if ready:
            self._colours = self._heard.colours(np.array([t for t, _ in ready]))
            self._send_links(ready, self._colours)
        if self._live and self._to_link:
            self._send_links(self._to_link[-1:], self._colours[-1:])

    def _send_links(self, frames: list[tuple[int, Array]], colours: Array) -> None:
        """The links of ``frames`` in ``colours`` (frames, links)."""
        t_ns = np.array([t for t, _ in frames])
        column = {robot: k for k, robot in enumerate(self._scenario.ids)}
        ends = np.array([(column[a], column[b]) for a, b in self._links])
        lines = _beside(np.array([places for _, places in frames])[:, ends], 0.006 * self._size)
        cut = self._heard.cut(t_ns)
        parts = np.where(cut, _DASHES, np.where(self._bows != 0.0, _BENDS, 1))  # (frames, links)
        bows, gaps = (np.broadcast_to(x, parts.shape).reshape(-1) for x in (self._bows, cut))
        strips = _strips(lines.reshape(-1, 2, 2), bows, parts.reshape(-1), gaps)
        self._stream.send_columns("field/links", self._times(t_ns), rr.LineStrips2D.columns(
            strips=strips, colors=np.repeat(colours.reshape(-1), parts.reshape(-1))
        ).partition(parts.sum(axis=1)))  # fmt: skip

    def _note_plan(self, now_ns: int, wall_ns: int) -> None:
        while self._plan and self._plan[0][0] <= now_ns:
            t_ns, what = self._plan.pop(0)
            self._say(t_ns, wall_ns, "network", {"what": what})

    def _say(self, t_ns: int, wall_ns: int, kind: str, details: dict[str, Any]) -> None:
        words = told(kind, details)
        stream = self._stream
        stream.set_time("sim_time", duration=np.timedelta64(t_ns, "ns"))
        stream.set_time("wall_time", timestamp=np.datetime64(wall_ns, "ns"))
        stream.log("events", rr.TextLog(f"{kind}: {words}" if words else kind,
                                        level=_LEVELS.get(kind, "INFO")))  # fmt: skip


_LEVELS = {
    "kill": "WARN", "pause": "WARN", "waiting": "WARN", "rejected": "WARN", "refused": "WARN",
    "lost": "ERROR", "host lost": "ERROR", "diverged": "ERROR", "failed": "ERROR",
    "broken": "ERROR", "interrupted": "WARN", "silent at the end": "WARN",
}  # fmt: skip


class _Heard:
    """Per link: the stamp of the newest message that could be used, and whether it is cut."""

    def __init__(self, scenario: Scenario) -> None:
        self._links = scenario.directed_links
        self._ahead: dict[tuple[int, int], list[tuple[int, int]]] = {k: [] for k in self._links}
        self._newest = dict.fromkeys(self._links, -1)
        self._cuts = {link: _cuts(scenario.timeline_of(*link)) for link in self._links}
        self._stale_ns = nanoseconds(scenario.neighbours.silence_s)

    def take(self, row: LinkRow) -> None:
        """Take in what became of one message."""
        if row.t_usable_ns is not None and row.fate in (DELIVERED, DUPLICATED):
            self._ahead[row.source, row.destination].append((row.t_usable_ns, row.t_sent_ns))

    def cut(self, t_ns: Array) -> NDArray[np.bool_]:
        """Whether each link is cut, (instants, links)."""
        cut = np.empty((len(t_ns), len(self._links)), dtype=bool)
        for k, link in enumerate(self._links):
            at_ns, state = self._cuts[link]
            cut[:, k] = state[np.searchsorted(at_ns, t_ns, side="right") - 1]
        return cut

    def colours(self, t_ns: Array) -> Array:
        """Every link's colour, (instants, links); instants ascend, over all calls."""
        colours = np.empty((len(t_ns), len(self._links)), dtype=np.uint32)
        for k, link in enumerate(self._links):
            ahead = sorted(self._ahead[link])
            usable, sent = np.array([(-1, self._newest[link]), *ahead]).T
            newest = np.maximum.accumulate(sent)
            place = np.searchsorted(usable, t_ns, side="right") - 1
            self._newest[link] = int(newest[place[-1]])
            self._ahead[link] = ahead[place[-1] :]
            age = (t_ns - newest[place]) / self._stale_ns
            colours[:, k] = np.where(newest[place] < 0, _GREY, _by_age(age))
        return colours


def _cuts(timeline: Timeline) -> tuple[Array, Array]:
    """When a link changes, and whether it is cut from then on."""
    found = [(-1, False)]
    while timeline.next_ns < NEVER:
        at_ns = timeline.next_ns
        timeline.advance(at_ns)
        found.append((at_ns, timeline.is_cut))
    at, state = zip(*found, strict=True)
    return np.array(at), np.array(state)


class _Traffic:
    """Mean delay and share of losses of every link, by stretches of the run.

    So many are drawn ``together``, at least: each time has a cost.
    """

    def __init__(self, scenario: Scenario, stream: rr.RecordingStream, together: int) -> None:
        self._stream, self._together = stream, together
        self._links = scenario.directed_links
        shortest = 10 * scenario.clock.broadcast_period_ns
        windows = max(10, min(MOST_WINDOWS, MOST_CELLS // (4 * len(self._links) or 1)))
        self._window_ns = max(shortest, nanoseconds(scenario.duration_s) // windows)
        self._ended_ns = 0  # up to where it is drawn
        self._rows: dict[tuple[int, int], list[LinkRow]] = {link: [] for link in self._links}
        self._next: dict[tuple[int, int], int] = {}  # the first stretch that is not drawn
        shown = _rgba(len(self._links))
        for (source, destination), colour in zip(self._links, shown, strict=True):
            for what in ("delay", "loss"):  # of one colour in both
                _label(stream, f"links/{what}/{source}-{destination}", f"{source}→{destination}",
                       int(colour))  # fmt: skip

    def take(self, row: LinkRow) -> None:
        """Take in what became of one message."""
        self._rows[row.source, row.destination].append(row)

    def flush(self, known_ns: int, times: Any) -> None:
        """Draw the stretches that ended up to ``known_ns``."""
        ended_ns = known_ns // self._window_ns * self._window_ns
        if ended_ns - self._ended_ns < self._together * self._window_ns:
            return
        self._ended_ns = ended_ns
        for link, rows in self._rows.items():
            ready = [row for row in rows if _decided_ns(row) < ended_ns]
            if ready:
                self._rows[link] = [row for row in rows if _decided_ns(row) >= ended_ns]
                self._draw(link, ready, times)

    def _draw(self, link: tuple[int, int], rows: Sequence[LinkRow], times: Any) -> None:
        window = np.array([_decided_ns(row) for row in rows]) // self._window_ns
        lost = np.array([row.fate.startswith("lost") for row in rows])
        delay_ms = np.array([
            np.nan if row.t_usable_ns is None or row.fate.startswith("lost")
            else (row.t_usable_ns - row.t_sent_ns) / 1e6 for row in rows
        ])  # fmt: skip
        first = min(self._next.get(link, window.min()), window.min())
        count = window.max() - first + 1
        self._next[link] = first + count
        index, arrived = window - first, np.isfinite(delay_ms)
        name, ends = f"{link[0]}-{link[1]}", (np.arange(first, first + count) + 1) * self._window_ns
        with np.errstate(invalid="ignore"):  # 0 / 0 is NaN, where the line has a gap
            mean_ms = np.bincount(index[arrived], delay_ms[arrived], minlength=count) / np.bincount(
                index[arrived], minlength=count
            )
            share = np.bincount(index, lost) / np.bincount(index)
        for what, values in (("delay", mean_ms), ("loss", 100.0 * share)):
            self._stream.send_columns(
                f"links/{what}/{name}", times(ends), rr.Scalars.columns(scalars=values)
            )


def _aside(places: Array) -> Array:
    """From each place to that of its label, away from the middle, where fewer links are.

    (n, robots, 2), in sizes of the field; Rerun draws a label below its point.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # a diverging run overflows
        away = places - places.mean(axis=1, keepdims=True)
        length = np.linalg.norm(away, axis=-1, keepdims=True)
        outwards = np.divide(away, length, out=np.zeros_like(away), where=length > 0.0)
    aside: Array = 0.035 * outwards - np.array([0.0, 0.015])
    return aside


def _decided_ns(row: LinkRow) -> int:
    """When it was decided what became of a message, as far as is known."""
    return row.t_sent_ns if row.t_usable_ns is None else row.t_usable_ns


def _label(stream: rr.RecordingStream, entity: str, name: str, colour: int | None = None) -> None:
    colours = None if colour is None else [colour]
    stream.log(entity, rr.SeriesLines(names=[name], colors=colours), static=True)


def _both_ways(scenario: Scenario, edge_bows: Array) -> Array:
    """How far each directed link bends, given that of each edge (:func:`bows`)."""
    both = {}
    for (first, second), bow in zip(scenario.formation.edges, edge_bows, strict=True):
        both[first, second], both[second, first] = bow, -bow
    return np.array([both[link] for link in scenario.directed_links])


def _stride(scenario: Scenario, bows: Array) -> int:
    """Of how many instants one is shown."""
    lines = len(scenario.directed_links) + (_BENDS - 1) * int(np.count_nonzero(bows))
    cells = len(scenario.ids) + lines + lines // 2  # links, and the edges of the pattern
    frames = max(100, min(MOST_FRAMES, MOST_CELLS // cells))
    instants = nanoseconds(scenario.duration_s) // scenario.clock.broadcast_period_ns + 1
    return -(-instants // frames)


def _rgba(count: int) -> Array:
    shown = [int(colour[1:], 16) << 8 | 0xFF for colour in colours(count, SCREEN_COLOURS)]
    return np.array(shown, dtype=np.uint32)


def _by_age(share: Array) -> Array:
    """Green for what was just said, red for what is as old as a silence."""
    x = np.clip(share, 0.0, 1.0)
    red = np.round(255 * np.minimum(1.0, 2 * x)).astype(np.int64)
    green = np.round(190 * np.minimum(1.0, 2 - 2 * x)).astype(np.int64)
    return red << 24 | green << 16 | 0x30 << 8 | 0xFF  # type: ignore[no-any-return]


def _beside(lines: Array, gap: float) -> Array:
    """Lines (..., 2, 2) moved to the side, so that the two directions of a link are two."""
    along = lines[..., 1, :] - lines[..., 0, :]
    length = np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    side = np.stack([-along[..., 1], along[..., 0]], axis=-1) / length
    return lines + gap * side[..., None, :]  # type: ignore[no-any-return]


def _strips(lines: Array, bows: Array, parts: Array, gaps: Array) -> Array:
    """Lines (n, 2, 2) that bend by ``bows``, each in so many straight parts: (sum of parts, 2, 2).

    Where ``gaps``, every part is followed by a gap as long.
    """
    number = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    of, step = np.repeat(parts, parts), np.repeat(gaps + 1, parts)
    length = 1.0 / (step * (of - 1) + 1)
    begin = step * number * length
    line, bow = np.repeat(lines, parts, axis=0), np.repeat(bows, parts)
    ends = [bowed(line, bow, at) for at in (begin, begin + length)]
    return np.stack(ends, axis=1)
