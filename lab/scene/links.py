"""The links in the field of the scene: by the age of what was heard last, dashed while cut."""

from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from formnet.formation.records.rows import LinkRow
from formnet.formation.scenario.model import Scenario
from formnet.lab.scene.colours import GREY, by_age
from formnet.lab.scene.lines import BENDS, DASHES, beside, line_strips
from formnet.lab.scene.sampling import Times
from formnet.netem.core.transit import DELIVERED, DUPLICATED
from formnet.netem.files.tables import nanoseconds
from formnet.netem.settings.timeline import NEVER, Timeline

Array = NDArray[Any]


class Links:
    """Draws the directed links of ``scenario`` in a field that is ``size`` metres wide.

    ``bows``: how far each link bends, (links,). ``live``: the newest frame has its links at once,
    in the colours that were known last.
    """

    def __init__(
        self,
        scenario: Scenario,
        stream: rr.RecordingStream,
        bows: Array,
        size: float,
        *,
        live: bool,
    ) -> None:
        self._stream, self._bows, self._size, self._live = stream, bows, size, live
        self._links = scenario.directed_links
        column = {robot: k for k, robot in enumerate(scenario.ids)}
        self._ends = np.array([(column[a], column[b]) for a, b in self._links])
        self._heard = _Heard(scenario)
        self._waiting: list[tuple[int, Array]] = []  # frames whose links are not known yet
        self._colours = np.full((1, len(self._links)), GREY, dtype=np.uint32)  # as last known

    def take(self, row: LinkRow) -> None:
        """Take in what became of one message."""
        self._heard.take(row)

    def place(self, t_ns: Array, places: Array) -> None:
        """Take in where the robots are drawn at ``t_ns``, (frames, robots, 2), in metres."""
        self._waiting += zip(t_ns.tolist(), places, strict=True)

    def flush(self, known_ns: int, times: Times) -> None:
        """Draw the links of frames up to ``known_ns``, at the ``times`` of the scene."""
        ready = [frame for frame in self._waiting if frame[0] <= known_ns]
        self._waiting = self._waiting[len(ready) :]
        if not self._links:
            return
        if ready:
            self._colours = self._heard.colours(np.array([t for t, _ in ready]))
            self._draw(ready, self._colours, times)
        if self._live and self._waiting:
            self._draw(self._waiting[-1:], self._colours[-1:], times)

    def _draw(self, frames: list[tuple[int, Array]], colours: Array, times: Times) -> None:
        """The links of ``frames`` in ``colours`` (frames, links)."""
        t_ns = np.array([t for t, _ in frames])
        ends = np.array([places for _, places in frames])[:, self._ends]
        lines = beside(ends, 0.006 * self._size)
        cut = self._heard.cut(t_ns)
        parts = np.where(cut, DASHES, np.where(self._bows != 0.0, BENDS, 1))  # (frames, links)
        bows, gaps = (np.broadcast_to(x, parts.shape).reshape(-1) for x in (self._bows, cut))
        strips = line_strips(lines.reshape(-1, 2, 2), bows, parts.reshape(-1), gaps)
        self._stream.send_columns(
            "field/links",
            times(t_ns),
            rr.LineStrips2D.columns(
                strips=strips, colors=np.repeat(colours.reshape(-1), parts.reshape(-1))
            ).partition(parts.sum(axis=1)),
        )


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
            colours[:, k] = np.where(newest[place] < 0, GREY, by_age(age))
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


def both_ways(scenario: Scenario, edge_bows: Array) -> Array:
    """How far each directed link bends, (links,), given how far each edge does, (edges,).

    See :func:`formnet.lab.figures.canvas.bows`.
    """
    both = {}
    for (first, second), bow in zip(scenario.formation.edges, edge_bows, strict=True):
        both[first, second], both[second, first] = bow, -bow
    return np.array([both[link] for link in scenario.directed_links])
