"""Delay and loss of every link over the run, as plots of the scene."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from formnet.formation.records.rows import LinkRow
from formnet.formation.scenario.model import Scenario
from formnet.lab.scene.colours import rgba
from formnet.lab.scene.sampling import Times, window_ns


class Traffic:
    """Mean delay and share of losses of every link, by stretches of the run.

    So many are drawn ``together``, at least: each time has a cost.
    """

    def __init__(self, scenario: Scenario, stream: rr.RecordingStream, together: int) -> None:
        self._stream, self._together = stream, together
        self._links = scenario.directed_links
        self._window_ns = window_ns(scenario)
        self._ended_ns = 0  # up to where it is drawn
        self._rows: dict[tuple[int, int], list[LinkRow]] = {link: [] for link in self._links}
        self._next: dict[tuple[int, int], int] = {}  # the first stretch that is not drawn
        shown = rgba(len(self._links))
        for (source, destination), colour in zip(self._links, shown, strict=True):
            for what in ("delay", "loss"):  # of one colour in both
                line = rr.SeriesLines(names=[f"{source}→{destination}"], colors=[int(colour)])
                stream.log(f"links/{what}/{source}-{destination}", line, static=True)

    def take(self, row: LinkRow) -> None:
        """Take in what became of one message."""
        self._rows[row.source, row.destination].append(row)

    def flush(self, known_ns: int, times: Times) -> None:
        """Draw the stretches that ended up to ``known_ns``, at the ``times`` of the scene."""
        ended_ns = known_ns // self._window_ns * self._window_ns
        if ended_ns - self._ended_ns < self._together * self._window_ns:
            return
        self._ended_ns = ended_ns
        for link, rows in self._rows.items():
            ready = [row for row in rows if _decided_ns(row) < ended_ns]
            if ready:
                self._rows[link] = [row for row in rows if _decided_ns(row) >= ended_ns]
                self._draw(link, ready, times)

    def _draw(self, link: tuple[int, int], rows: Sequence[LinkRow], times: Times) -> None:
        window = np.array([_decided_ns(row) for row in rows]) // self._window_ns
        lost = np.array([row.fate.startswith("lost") for row in rows])
        delay_ms = np.array(
            [
                np.nan
                if row.t_usable_ns is None or row.fate.startswith("lost")
                else (row.t_usable_ns - row.t_sent_ns) / 1e6
                for row in rows
            ]
        )
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


def _decided_ns(row: LinkRow) -> int:
    """When it was decided what became of a message, as far as is known."""
    return row.t_sent_ns if row.t_usable_ns is None else row.t_usable_ns
