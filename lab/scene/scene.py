"""A run as a scene in Rerun: the field, errors and V, links, events.

The same scene goes to ``run.rrd`` and to a live viewer. Records come in (:meth:`Scene.take`),
frames go out in columns (:meth:`Scene.flush`); nothing here knows where they end up. Two
timelines: ``sim_time``, the run's, and ``wall_time``, when the records came.

Rerun's two-dimensional views have y downwards: the field is drawn with -y. Positions are its
32-bit floats.
"""

from itertools import groupby
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from formnet.formation.paper.geometry import errors, fitted_rotation, rotated
from formnet.formation.records.events import Event, Lost, Network, Severity
from formnet.formation.records.outcome import Outcome
from formnet.formation.records.rows import LinkRows, Sample, Samples
from formnet.formation.records.stream import Record
from formnet.formation.scenario.expect import ERRORS
from formnet.formation.scenario.model import Scenario
from formnet.lab.figures import presence
from formnet.lab.figures.canvas import bows
from formnet.lab.scene.blueprint import blueprint, half_width, scale_bar
from formnet.lab.scene.colours import GREY, rgba
from formnet.lab.scene.lines import BENDS, line_strips
from formnet.lab.scene.links import Links, both_ways
from formnet.lab.scene.sampling import stride
from formnet.lab.scene.traffic import Traffic
from formnet.netem.files.tables import nanoseconds
from formnet.netem.settings.timeline import NEVER

LINKS_LATE_NS = 1_200_000_000
"""What became of messages up to an instant is known so much later, at the latest."""
_MOST_LABELS = 40
_TOGETHER = 10
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
        self._scenario, self._stream = scenario, stream
        column = {robot: k for k, robot in enumerate(scenario.ids)}
        edges = [(column[a], column[b]) for a, b in scenario.formation.edges]
        self._edges = np.array(edges, dtype=np.intp).reshape(-1, 2)
        self._edge_bows = bows(scenario.offsets_m * [1.0, -1.0], edges)  # as the field is drawn
        link_bows = both_ways(scenario, self._edge_bows)
        self._stride = stride(scenario, link_bows)
        self._roster = scenario.roster()
        self._plan = [(nanoseconds(e.at_s), e.what) for e in scenario.plan if not e.robots]
        self._instants: list[tuple[int, list[Sample]]] = []  # to be drawn
        self._newest: tuple[int, list[Sample]] | None = None
        self._shown_ns = -1
        self._before: Array | None = None  # where the robots were in the frame before
        self._anchors: list[tuple[int, int]] = []  # instants, and when they were heard of
        self._half = half_width(scenario)
        self._size = 2.0 * self._half
        self._links = Links(scenario, stream, link_bows, self._size, live=live)
        self._traffic = Traffic(scenario, stream, together=1 if live else _TOGETHER)
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
                self._links.take(row)
                self._traffic.take(row)
        elif isinstance(record, Event | Outcome):
            if isinstance(record, Lost):
                self._roster.lose(record.robot, record.tick)
            self._say(record, wall_ns)

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
        self._links.flush(known_ns, self._times)
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
        size = self._size
        stream.send_blueprint(blueprint(scenario, self._half))
        stream.log("field/robots", rr.Points2D.from_fields(radii=[0.018 * size]), static=True)
        stream.log(
            "field/names",
            rr.Points2D.from_fields(
                radii=[0.0],
                labels=list(map(str, scenario.ids)),
                show_labels=True,
                colors=rgba(len(scenario.ids)),
            ),
            static=True,
        )
        stream.log("field/headings", rr.Arrows2D.from_fields(radii=[0.004 * size]), static=True)
        stream.log(
            "field/pattern",
            rr.LineStrips2D.from_fields(radii=[0.004 * size], colors=[0xC4C4C4FF]),
            static=True,
        )
        stream.log(
            "field/places",
            rr.Points2D.from_fields(radii=[0.009 * size], colors=[0xC4C4C4FF]),
            static=True,
        )
        bar, length = scale_bar(scenario, self._half)
        stream.log(
            "field/scale",
            rr.LineStrips2D(
                [bar],
                radii=[0.003 * size],
                colors=[GREY],
                labels=[f"{length:g} m"],
                show_labels=True,
            ),
            static=True,
        )
        for row, colour in zip(ERRORS.values(), rgba(len(ERRORS)), strict=True):
            line = rr.SeriesLines(names=[f"log10 {row.name} ({row.unit})"], colors=[int(colour)])
            stream.log(f"errors/{row.name}", line, static=True)
        stream.log("lyapunov/v", rr.SeriesLines(names=["log10 V"]), static=True)

    def _times(self, t_ns: Array) -> list[rr.TimeColumn]:
        anchors = np.array(self._anchors or [(0, 0)])
        wall = np.interp(t_ns, anchors[:, 0], anchors[:, 1] - anchors[0, 1])
        self._anchors = self._anchors[-5000:]
        return [
            rr.TimeColumn("sim_time", duration=np.asarray(t_ns).astype("timedelta64[ns]")),
            rr.TimeColumn(
                "wall_time",
                timestamp=((wall.astype(np.int64) + anchors[0, 1]).astype("datetime64[ns]")),
            ),
        ]

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
        colours = np.where(up, rgba(len(self._scenario.ids)), GREY).astype(np.uint32)
        count = len(self._scenario.ids)
        times, send, sizes = self._times(t_ns), self._stream.send_columns, [count] * len(t_ns)
        send(
            "field/robots",
            times,
            rr.Points2D.columns(
                positions=drawn.reshape(-1, 2),
                colors=colours.reshape(-1),
            ).partition(sizes),
        )
        if count <= _MOST_LABELS:
            send(
                "field/names",
                times,
                rr.Points2D.columns(
                    positions=(drawn + self._size * _aside(drawn)).reshape(-1, 2),
                ).partition(sizes),
            )
        vectors = np.stack([np.cos(headings), -np.sin(headings)], axis=-1) * 0.05 * self._size
        send(
            "field/headings",
            times,
            rr.Arrows2D.columns(
                origins=drawn.reshape(-1, 2),
                vectors=vectors.reshape(-1, 2),
                colors=colours.reshape(-1),
            ).partition(sizes),
        )
        before = np.concatenate([drawn[:1] if self._before is None else self._before, drawn[:-1]])
        self._before = drawn[-1:]
        steps = np.stack([before, drawn], axis=2).reshape(-1, 2, 2)
        send(
            "field/trails",
            times,
            rr.LineStrips2D.columns(strips=steps, colors=colours.reshape(-1)).partition(sizes),
        )
        self._draw_errors(t_ns, places, headings, up)
        self._links.place(t_ns, drawn)

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
        for name, column in zip(ERRORS, found.T, strict=True):
            known = np.isfinite(column)
            if known.any():
                logs = np.log10(np.maximum(column[known], _FLOOR))
                self._series(f"errors/{name}", t_ns[known], logs)
        known = np.isfinite(pattern).all(axis=(1, 2))
        if known.any():
            drawn = (pattern * [1.0, -1.0])[known]
            times, send = self._times(t_ns[known]), self._stream.send_columns
            send(
                "field/places",
                times,
                rr.Points2D.columns(
                    positions=drawn.reshape(-1, 2),
                ).partition([len(offsets)] * len(drawn)),
            )
            if len(self._edges):
                send("field/pattern", times, self._edges_between(drawn))

    def _edges_between(self, places: Array) -> Any:
        """The graph's edges between places (frames, robots, 2), in columns."""
        parts = np.where(self._edge_bows != 0.0, BENDS, 1)
        bows, of = (np.tile(x, len(places)) for x in (self._edge_bows, parts))
        lines = places[:, self._edges].reshape(-1, 2, 2)
        strips = line_strips(lines, bows, of, np.zeros_like(of))
        return rr.LineStrips2D.columns(strips=strips).partition([int(parts.sum())] * len(places))

    def _note_plan(self, now_ns: int, wall_ns: int) -> None:
        while self._plan and self._plan[0][0] <= now_ns:
            t_ns, what = self._plan.pop(0)
            self._say(Network(t_ns, what), wall_ns)

    def _say(self, event: Event | Outcome, wall_ns: int) -> None:
        words = ": ".join(filter(None, (event.name, event.words)))
        stream = self._stream
        stream.set_time("sim_time", duration=np.timedelta64(event.t_ns, "ns"))
        stream.set_time("wall_time", timestamp=np.datetime64(wall_ns, "ns"))
        stream.log("events", rr.TextLog(words, level=_LEVELS[event.severity]))


_LEVELS = {
    Severity.DEBUG: rr.TextLogLevel.DEBUG,
    Severity.INFO: rr.TextLogLevel.INFO,
    Severity.WARNING: rr.TextLogLevel.WARN,
    Severity.ERROR: rr.TextLogLevel.ERROR,
}


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
