"""What is shown of a run while it goes on."""

import threading
import time

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from formnet.formation.records.events import (
    HostLost,
    LastTick,
    SilentAtTheEnd,
    Started,
    Waiting,
    named,
)
from formnet.formation.records.stream import Record, Sink
from formnet.lab.judge.errors import by_claim, error_series
from formnet.lab.runs.recording import Recording
from formnet.lab.runs.words import times
from formnet.lab.text.console import escape


class Waits:
    """Prints on whom a run waits: at the first complaint that is the same, and at each doubling."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._last: tuple[str, tuple[int, ...]] | None = None
        self._times = 0

    def take(self, record: Record) -> None:
        """Print it, if ``record`` says so."""
        if not isinstance(record, Waiting):
            return
        same = (record.what, record.robots)
        self._times = self._times + 1 if same == self._last else 1
        self._last = same
        if self._times & (self._times - 1) == 0:
            self._console.print(
                f"[yellow]waiting[/] at t = {record.t_ns / 1e9:.3f} s for "
                f"{named(record.robots)} to " + escape(record.what),
                soft_wrap=True,
            )


class Watch:
    """Shows a run while it goes on: progress, current errors, and events as they come.

    ``scene`` is what draws it, and takes every record, from any thread.
    """

    def __init__(self, console: Console, recording: Recording, scene: Sink | None) -> None:
        self._console = console
        self._recording = recording
        self._scene = scene
        self._lock = threading.RLock()
        self._waits = Waits(console)
        self._started: float | None = None
        self._ended: float | None = None
        self._drawn = 0.0
        self._progress = Progress(
            BarColumn(bar_width=12), TextColumn("{task.description}", markup=False), console=console
        )
        self._task = self._progress.add_task("starting", total=recording.scenario.duration_s)

    def __enter__(self) -> "Watch":
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._draw()
        self._progress.stop()

    @property
    def wall_s(self) -> float:
        """Seconds from the first tick to the last."""
        if self._started is None:
            return 0.0
        return (self._ended or time.monotonic()) - self._started

    def take(self, record: Record) -> None:
        """A sink in front of the recording, for any thread."""
        with self._lock:
            self._take(record)

    def say(self, text: str) -> None:
        """Say something to the user."""
        self._console.print(escape(text), soft_wrap=True)

    def _take(self, record: Record) -> None:
        self._recording(record)
        if self._scene is not None:
            self._scene(record)
        match record:
            case Started():
                self._started = time.monotonic()
                if not self._console.is_terminal:  # which sees the bar
                    self._console.print(f"started with {named(record.robots)}")
            case LastTick():
                self._ended = time.monotonic()
            case HostLost():
                self._console.print(
                    f"[red]host lost:[/] {escape(record.host)}, with "
                    f"{named(record.robots)}: " + escape(record.reason),
                    soft_wrap=True,
                )
            case SilentAtTheEnd():
                self._console.print(
                    f"[yellow]silent at the end:[/] {named(record.robots)}: the fate of "
                    "messages since the last report is unknown",
                    soft_wrap=True,
                )
        self._waits.take(record)

    def refresh(self) -> None:
        """Redraw, at most ten times a second."""
        if time.monotonic() - self._drawn >= 0.1:
            self._draw()

    def _draw(self) -> None:
        self._drawn = time.monotonic()
        latest = self._recording.latest()
        if self._started is None or not len(latest.t_s):
            return
        t_s = float(latest.t_s[-1])
        up = self._recording.up_at(int(latest.t_ns[-1]))
        found = error_series(self._recording.scenario, latest, up)
        speed = t_s / max(self.wall_s, 1e-9)
        errors = " ".join(
            f"{claim} {series[-1]:.1e}" for claim, series in by_claim(found).items() if up
        )
        self._progress.update(
            self._task, completed=t_s, description=f"t = {t_s:.1f} s  {times(speed)}  {errors}"
        )
