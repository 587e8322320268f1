"""``formnet plot``: the figures of a recorded run, drawn again."""

from pathlib import Path

from rich.console import Console
from rich.markup import escape

from formation.loading import ScenarioError
from lab.recorded import Unreadable, read_run
from lab.recording import fresh_folder
from lab.run import ALL_HOLD, BAD_INPUT, report_problems


def plot_run(folder: Path, out: Path | None) -> int:
    """Draw into a new folder, or into the run's ``figures/``; the exit code of ``formnet plot``."""
    console = Console(stderr=True, highlight=False)
    try:
        run = read_run(folder)
        if not run.samples and not run.link_rows:
            raise Unreadable("; ".join(["nothing to draw", *run.problems]))
        place = folder / "figures" if out is None else fresh_folder(out)
        from lab import figures

        figures.draw(run, place)
    except ScenarioError as error:
        report_problems(console, error)
        return BAD_INPUT
    except (Unreadable, OSError) as error:
        console.print(f"[red]{escape(str(folder))}:[/] {escape(str(error))}", soft_wrap=True)
        return BAD_INPUT
    for problem in run.problems:
        console.print(f"[yellow]without:[/] {escape(problem)}", soft_wrap=True)
    console.print(f"everything is in {escape(str(place))}", soft_wrap=True)
    return ALL_HOLD
