"""What the claims leave in a folder: their table, all that is known of them, and figures."""

import json
from collections.abc import Sequence
from pathlib import Path

from formnet.formation.briefing.resolving import resolve
from formnet.lab.claims import figures, report
from formnet.lab.claims.beyond import COMPARED
from formnet.lab.claims.results import Row
from formnet.lab.claims.work import scenario_of
from formnet.lab.figures.canvas import plain_style, save
from formnet.lab.figures.plotting import Figure
from formnet.lab.launch.inline import Inline
from formnet.lab.runs import files
from formnet.lab.runs.recording import Collected


def write(folder: Path, rows: Sequence[Row], *, mode: str) -> None:
    """``claims.md``, ``claims.json`` and the figures; ``mode`` says how the runs were done.

    Raises:
        OSError: a file cannot be written; those after it are not.
    """
    files.replace(folder / "claims.md", report.markdown(rows))
    text = json.dumps(
        report.as_json(rows, mode=mode), indent=2, allow_nan=False, ensure_ascii=False
    )
    files.write_new(folder / "claims.json", text + "\n")
    with plain_style():
        drawn = {"claims": figures.summary(rows)} if rows else {}
        following = next((row for row in rows if row.claim.key == "leader-follower"), None)
        if following is not None:
            drawn["remark-9"] = _remark_9(following)
        for name, figure in drawn.items():
            save(figure, folder, name)


def _remark_9(row: Row) -> Figure:
    """Both laws, run again in this process: the same bits."""
    runs = []
    for name in COMPARED:
        case = next(result.case for result in row.results if result.case.name == name)
        run = Collected(scenario_of(case))
        Inline().run(resolve(run.scenario), run)
        runs.append(run)
    return figures.compared(*runs)
