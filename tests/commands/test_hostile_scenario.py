"""A small scenario keeps nobody busy: what is done for it is counted, or there is a bound."""

import difflib

import pytest

from formnet.formation.scenario.loading import ScenarioError, loads
from formnet.netem.files.problems import MOST_SHOWN

HEAD = 'name = "x"\nduration_s = 0.01\n'


def robots(count: int) -> str:
    return "".join(
        f"[[robots]]\nid = {k}\noffset_m = [{k}.0, 0.0]\nstart = {{ x_m = {k}.0, y_m = 0.0 }}\n"
        for k in range(count)
    )


def edges(pairs: list[list[int]]) -> str:
    return f"[formation]\nedges = {pairs}\n"


def complete(count: int) -> list[list[int]]:
    return [[a, b] for a in range(count) for b in range(a)]


@pytest.fixture
def counted(monkeypatch):
    """Counts the calls of a function from now on: ``calls = counted(place, name)``."""

    def count(place, name):
        calls = []
        real = getattr(place, name)

        def wrapper(*given, **named):
            calls.append(given)
            return real(*given, **named)

        monkeypatch.setattr(place, name, wrapper)
        return calls

    return count


# --- many problems -----------------------------------------------------------------------

UNKNOWN = "".join(f"k{k} = 1\n" for k in range(1000))


@pytest.mark.parametrize(
    "text",
    [
        HEAD + UNKNOWN + robots(1) + edges([]),
        HEAD + robots(1) + edges([]) + f"[[timeline]]\naction = 'cut'\nat_s = 0.0\n{UNKNOWN}",
    ],
    ids=["of the file", "of an entry"],
)
def test_of_many_unknown_keys_the_first_are_told_and_the_others_counted(text, counted):
    hints = counted(difflib, "get_close_matches")
    with pytest.raises(ScenarioError) as caught:
        loads(text)
    *told, last = map(str, caught.value.problems)
    assert len(told) == len(hints) == MOST_SHOWN
    assert all("unknown key" in problem for problem in told)
    assert last == f"and {1000 - MOST_SHOWN} more problems"


def test_of_many_edges_to_missing_robots_the_first_are_told_and_few_ids_with_each():
    """95,000 times the ids of 1000 robots were written out."""
    text = HEAD + edges([[k, k + 1] for k in range(500, 1500)]) + robots(200)
    with pytest.raises(ScenarioError) as caught:
        loads(text)
    *told, last = map(str, caught.value.problems)
    assert len(told) == MOST_SHOWN
    assert told[0] == (
        "formation.edges[0]: robot 500 does not exist (robots: 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, …)"
    )
    assert last == "and 1,980 more problems"
