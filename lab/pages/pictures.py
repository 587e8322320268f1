"""The figures of a run as its page shows them, with words for who cannot see them."""

import base64
import re
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from formnet.formation.scenario.expect import ERRORS
from formnet.lab.judge import claim_words
from formnet.lab.runs import files
from formnet.lab.verdict.recorded import Recorded

_TITLES = {
    "errors": "",  # what errors are called depends on the law
    "paths": "Paths and final pattern",
    "deliveries": "Every message of every link",
    "headings": "Headings",
    "lyapunov": "V along the run",
    "delays": "Delays against what was configured",
    "graph": "Communication graph",
}

_KNOWN = {*_TITLES, "thumbnail"}
_NAME = re.compile(r"[a-z][a-z0-9-]{0,40}")
_MOST_OTHERS = 20
MOST_BYTES = 16 * 2**20
"""Of all figures of a page; those that do not fit are left out."""


class Picture(NamedTuple):
    """A figure in the page: a data URI, and words for who cannot see it."""

    name: str
    title: str
    source: str
    alt: str


def pictures(run: Recorded) -> Iterator[Picture]:
    """Every figure there is, as PNG or SVG, whichever is smaller."""
    titles = _TITLES | {"errors": claim_words.capital(claim_words.errors(run.scenario))}
    titles |= {name: claim_words.capital(name.replace("-", " ")) for name in _others(run)}
    left = MOST_BYTES
    for name, title in titles.items():
        found = _smaller(run.folder, name, left)
        if found is not None:
            data, kind = found
            left -= len(data)
            source = f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"
            yield Picture(name, title, source, _in_words(name, run) or f"{title}.")


def _smaller(folder: Path, name: str, most_bytes: int) -> tuple[bytes, str] | None:
    """A figure as PNG or SVG, whichever is smaller, and its media type; None: there is none."""
    found: tuple[bytes, str] | None = None
    for suffix, kind in (("png", "image/png"), ("svg", "image/svg+xml")):
        with suppress(OSError):
            file = files.subfolder(folder, "figures") / f"{name}.{suffix}"
            with files.reading(file, most_bytes if found is None else len(found[0])) as stream:
                found = stream.read(most_bytes), kind
    return found


def _others(run: Recorded) -> list[str]:
    """Figures that this module does not know (see :mod:`formnet.lab.figures`), by name."""
    try:
        there = files.names(files.subfolder(run.folder, "figures"))
    except OSError:
        return []
    found = [name.removesuffix(".png") for name in there if name.endswith(".png")]
    names = (name for name in found if _NAME.fullmatch(name) and name not in _KNOWN)
    return list(islice(names, _MOST_OTHERS))


def _in_words(name: str, run: Recorded) -> str:
    """What a figure shows; empty of one that this module does not know."""
    judged, scenario = run.verdict, run.scenario
    if name == "errors" and judged is not None:
        titles = claim_words.titles(scenario)
        ends = ", ".join(
            f"{titles[name]} {value:.1e} {error.unit}"
            for name, error in ERRORS.items()
            if (value := judged.error(name)) is not None
        )
        return f"Errors over time on a log axis, with their tolerances. At the end: {ends}."
    if name == "graph":
        edges = ", ".join(f"{a} to {b}" for a, b in scenario.formation.edges) or "none"
        return (
            "The robots at their places in the pattern; those that were down and links that "
            f"were cut are marked. Edges: {edges}."
        )
    return {
        "errors": f"{claim_words.capital(claim_words.errors(scenario))} over time on a log axis, "
        "with their tolerances.",
        "paths": f"The paths of {len(scenario.ids)} robots in the plane, and where they are at the "
        "end beside the desired pattern.",
        "headings": "The robots' headings on the circle over time, and their gaps to the mean of "
        "those that are up.",
        "lyapunov": "V over time on a log axis; stretches in which it gains more than its budget "
        "are shaded.",
        "deliveries": "A band per link: the delay of every message at the time of its sending, or "
        "how it was lost.",
        "delays": "Histograms of measured delays beside the configured distributions.",
    }.get(name, "")
