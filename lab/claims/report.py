"""The claims as a table: Markdown, JSON, and a block inside another file."""

from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import Any

from formnet.formation.scenario.expect import ERRORS
from formnet.lab.claims.results import Row
from formnet.lab.runs import files
from formnet.lab.runs.build import versions
from formnet.netem.files import regular

BEGIN, END = "<!-- formnet claims: begin -->", "<!-- formnet claims: end -->"


class NoBlock(ValueError):
    """A file has no place for the table."""


def markdown(rows: Sequence[Row]) -> str:
    """The table, one line a claim."""
    errors = [f"{error.reference} ({error.unit})" for error in ERRORS.values()]
    heads = ["claim", "in the paper", "runs", "should happen", "happened", *errors, "verdict"]
    marks = ["---", "---", "--:", "---", "---", *["--:"] * len(errors), "---"]
    lines = [f"| {' | '.join(heads)} |", f"|{'|'.join(marks)}|"]
    for row in rows:
        cells = [
            f"{row.claim.says} (`{row.claim.key}`)",
            row.claim.where,
            str(len(row.results)),
            row.claim.should,
            row.happened,
            *(number(row, claim) for claim in ERRORS),
            row.verdict,
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def number(row: Row, claim: str) -> str:
    """The telling error of a row for people, in brackets where the equation should not hold."""
    wanted, error = row.telling(claim)
    if error is None:
        return "–"
    text = f"{error:.1e}" if isfinite(error) else "∞"
    return f"({text})" if wanted is False else text


def as_json(rows: Sequence[Row], *, mode: str) -> dict[str, Any]:
    """Everything known of the rows; numbers that are not finite are null."""
    return {
        "mode": mode,
        "versions": versions(),
        "claims": [
            {
                "key": row.claim.key,
                "claim": row.claim.says,
                "where": row.claim.where,
                "should": row.claim.should,
                "happened": row.happened,
                "verdict": row.verdict,
                "runs": [
                    {
                        "name": result.case.name,
                        "scenario": result.case.scenario,
                        "overrides": list(result.case.all_overrides),
                        "expected": None
                        if result.case.expected is None
                        else {
                            **result.case.expected,
                            "diverges": result.case.diverges,
                        },
                        "as_expected": result.as_expected,
                        "outcome": result.verdict.outcome.model_dump(),
                        "claims": {
                            name: claim.model_dump()
                            for name, claim in result.verdict.claims.items()
                        },
                        "settling_time_s": result.verdict.settling_time_s,
                        "trajectory_sha256": result.verdict.trajectory_sha256,
                        "seconds": round(result.seconds, 3),
                    }
                    for result in row.results
                ],
            }
            for row in rows
        ],
    }


def around(file: Path) -> tuple[str, str]:
    """What stands before and after the place for the table in ``file``.

    Raises:
        NoBlock: BEGIN and END are not there, once each and in this order.
        OSError: the file cannot be read.
    """
    text = regular.read(file, files.MOST_BYTES, follow=True).decode("utf-8")
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end or BEGIN in after or END in after:
        raise NoBlock(f"{file} must have one line {BEGIN} and after it one line {END}")
    return before, after


def put_into(file: Path, table: str) -> None:
    """Replace what stands between BEGIN and END in ``file``; raises as :func:`around`."""
    before, after = around(file)
    files.write_to(file, f"{before}{BEGIN}\n{table}{END}{after}")
