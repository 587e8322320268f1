"""Runs side by side: nothing is lost, and no word is broken, however narrow the terminal is."""

import re

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from rich.markup import escape

from formnet.lab.cli import main
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.lab.text.side_by_side import MOST_COLUMNS, fitting, renderables, turned

ROWS = [
    ("verdict", ["FAILS", "holds", "FAILS", "holds"] * 2),
    ("outcome", ["completed"] * 8),
    ("formation (Eq. 3)", [f"FAILS, {k}.9e+01 m" for k in range(8)]),
    ("at the end: heading, Eq. 4 (rad)", [f"{k}.14e-01" for k in range(8)]),
    ("messages lost", ["0 of 2010"] * 8),
    ("sha256", [f"df971a3fcd8{k}" for k in range(8)]),
    ("network.default.loss.probability", [f"0.0{k}" for k in range(8)]),
]
NAMES = [f"section5-delay-beta-{k}" for k in range(8)]


def printed(width, names=NAMES, rows=ROWS):
    """The lines of ``rows`` side by side in a terminal so wide."""
    console = Console(width=width, force_terminal=False, color_system=None)
    with console.capture() as capture:
        for item in renderables("results", names, rows, width, escape):
            console.print(item)
    return [line.rstrip() for line in capture.get().splitlines()]


def words(text):
    return re.findall(r"[^\s─]+", text)


@pytest.mark.parametrize("width", [36, 40, 60, 80, 110, 200])
@pytest.mark.parametrize("count", [2, 3, 4, 8])
def test_no_word_is_broken_and_none_is_lost(width, count):
    names, rows = NAMES[:count], [(title, cells[:count]) for title, cells in ROWS]
    lines = printed(width, names, rows)
    assert max(map(len, lines)) <= width
    given_words = {
        word for title, cells in rows for text in (title, *cells, *names) for word in words(text)
    } | {"results", "results:", "run", "the", "same", "in", "all"}
    found = {word for line in lines for word in words(line)}
    assert {word.removesuffix(":") for word in found} <= {w.removesuffix(":") for w in given_words}
    for _, cells in rows:
        for cell in cells:
            assert all(any(word in line for line in lines) for word in words(cell))


def test_more_than_three_runs_have_a_row_each_and_what_is_the_same_is_said_once():
    lines = printed(200)
    (head,) = [line for line in lines if "sha256" in line]
    assert "outcome" not in head
    assert "messages lost" not in head
    for k, name in enumerate(NAMES):
        (row,) = [line for line in lines if line.split()[:1] == [name]]
        assert f"df971a3fcd8{k}" in row
        assert f"0.0{k}" in row
    text = "\n".join(lines)
    assert text.count("completed") == text.count("0 of 2010") == 1
    assert "results: the same in all" in text


def test_three_runs_have_a_column_each_where_they_fit():
    rows = [(title, cells[:MOST_COLUMNS]) for title, cells in ROWS]
    lines = printed(120, NAMES[:MOST_COLUMNS], rows)
    assert [line.split()[0] for line in lines if line.startswith(" verdict")] == ["verdict"]
    (row,) = [line for line in lines if "sha256" in line]
    assert words(row) == ["sha256", "df971a3fcd80", "df971a3fcd81", "df971a3fcd82"]


def test_where_not_even_two_columns_fit_each_run_has_a_paragraph():
    lines = printed(36)
    assert NAMES[3] in lines
    assert "  sha256: df971a3fcd83" in lines


CELLS = st.text(alphabet="ab 1.", max_size=12)


@given(
    st.lists(st.lists(CELLS, min_size=3, max_size=3), min_size=1, max_size=5), st.integers(1, 60)
)
def test_columns_hold_their_longest_word_and_fit_together(grid, width):
    found = fitting(grid, width)
    longest = [max((len(w) for row in grid for w in row[k].split()), default=0) for k in range(3)]
    if found is None:
        assert sum(longest) + 7 > width  # between and beside three columns
    else:
        assert sum(found) + 7 <= width
        assert all(have >= need for have, need in zip(found, longest, strict=True))


@given(st.lists(st.lists(st.sampled_from("xy"), min_size=4, max_size=4), max_size=6))
def test_turned_around_nothing_is_missing(cells):
    rows = [(f"row {k}", row) for k, row in enumerate(cells)]
    grid, alike = turned(list("abcd"), rows)
    found = {place: [row[grid[0].index(place)] for row in grid[1:]] for place in grid[0][1:]}
    found |= {place: [value] * 4 for place, value in alike}
    assert found == dict(rows)
    assert all(len(set(column)) > 1 for place, column in found.items() if place in grid[0])


def test_compare_of_four_runs_writes_a_row_each(tmp_path):
    folders = []
    for k in range(4):
        folders.append(str(tmp_path / f"run-{k}"))
        CliRunner().invoke(
            main,
            [
                "run",
                str(CONFIGS / "paper" / "section5-delay.toml"),
                "--inline",
                "--no-figures",
                "--no-scene",
                "--out",
                folders[-1],
                "--set",
                "duration_s=0.1",
                "--set",
                f"law.beta={k + 5}",
            ],
        )
    result = CliRunner().invoke(main, ["compare", *folders, "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    text = (tmp_path / "out" / "comparison.md").read_text()
    for k in range(4):
        assert f"| run-{k} | {k + 5} |" in text
    assert text.count("| outcome | completed |") == 1
    assert "| settled after | never |" in text
    table = (tmp_path / "out" / "comparison.csv").read_text().splitlines()
    assert "outcome,completed,completed,completed,completed" in table
    assert "law.beta,5,6,7,8" in table
