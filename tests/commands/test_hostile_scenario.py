"""A small scenario keeps nobody busy: what is done for it is counted, or there is a bound."""

import difflib

import pytest

from formnet.formation.briefing.resolving import resolve
from formnet.formation.paper import graph
from formnet.formation.paper.theory import assess
from formnet.formation.plan.partition import PartitionAction
from formnet.formation.plan.reach import Named
from formnet.formation.scenario import model, network
from formnet.formation.scenario.loading import ScenarioError, loads
from formnet.lab.forecast import stiffness
from formnet.netem.files import from_file
from formnet.netem.files.problems import MOST_SHOWN
from formnet.netem.settings.delays import TraceDelaySettings
from formnet.netem.settings.links import LinkSettings

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


# --- many links --------------------------------------------------------------------------


def looked_at(text: str) -> None:
    """All that is done with a scenario before it is run."""
    scenario = loads(text)
    assess(scenario)
    resolve(scenario)
    assert scenario.plan is not None


def test_the_settings_of_links_are_worked_out_once_for_all_that_share_them(counted):
    """They were for each link and rule, several times each."""
    rule = '[[network.links]]\nfrom = "*"\nto = "*"\ndelay = {{ distribution = "{}", {} }}\n'
    rules = rule.format("normal", "mean_s = 0.1, stddev_s = 0.01") * 20
    changes = counted(LinkSettings, "changed")
    looked_at(HEAD + edges(complete(20)) + rules + robots(20))
    assert len(changes) == 20


def test_links_that_differ_in_too_many_ways_are_refused(monkeypatch):
    monkeypatch.setattr(network, "MOST_VARIANTS", 100)
    monkeypatch.setattr("formnet.formation.scenario.rules.MOST_VARIANTS", 100)
    rules = "".join(
        f"[[network.links]]\nfrom = {k}\nto = '*'\nboth_ways = true\nplayout_s = 0.{k:02}\n"
        for k in range(1, 20)
    )
    with pytest.raises(ScenarioError, match="links differ in more than 100 ways"):
        loads(HEAD + edges(complete(20)) + rules + robots(20))


def test_the_timeline_is_worked_out_once_an_entry(counted):
    """A dictionary of all robots was made for each link and entry."""
    reaches = counted(PartitionAction, "reach")
    effects = counted(PartitionAction, "effect")
    entry = "[[timeline]]\naction = 'partition'\nat_s = 0.001\nshape = 'halves'\n"
    looked_at(HEAD + edges(complete(20)) + entry * 9 + robots(20))
    assert len(reaches) <= 2 * 9  # for the links, and for the words of the plan
    assert len(effects) == 9


def test_a_link_is_found_among_many_pairs_without_trying_them():
    """100,000 pairs were tried on each of 80,000 links."""

    class Pairs(list):
        begun = 0

        def __iter__(self):
            self.begun += 1
            return super().__iter__()

    pairs = Pairs([(0, 0)] * 1000 + [("*", [3, 4]), ([5, 6], "*"), (1, [2, 2])])
    named = Named(pairs, both_ways=False)
    found = {(a, b) for a in range(8) for b in range(8) if named.covers(a, b)}
    assert found == {
        (a, b)
        for a in range(8)
        for b in range(8)
        if b in (3, 4) or a in (5, 6) or (a, b) in ((0, 0), (1, 2))
    }
    both = Named(pairs, both_ways=True)
    assert {(a, b) for a in range(8) for b in range(8) if both.covers(a, b)} == {
        *found,
        *((b, a) for a, b in found),
    }
    assert pairs.begun == 2


def test_the_ids_and_links_of_a_scenario_are_listed_once():
    """The list of all robots was made anew for each link."""
    scenario = loads(HEAD + edges(complete(9)) + robots(9))
    assert scenario.ids is scenario.ids
    assert scenario.directed_links is scenario.directed_links


def test_when_robots_are_down_is_worked_out_once(counted):
    spans = counted(model, "spans_of")
    entry = "[[timeline]]\nat_s = 0.00{}\naction = 'kill'\nrobots = '*'\nrestart_after_s = 0.001\n"
    looked_at(HEAD + edges(complete(9)) + "".join(map(entry.format, (1, 4, 7))) + robots(9))
    assert len(spans) == 1


def test_the_eigenvalues_of_a_matrix_are_computed_once(counted):
    """Each took seconds for 1000 robots, and was asked for four times or more."""
    graph._spectrum.cache_clear()
    computed = counted(graph.np.linalg, "eigvalsh")
    text = HEAD + edges(complete(11)) + robots(11)
    looked_at(text)
    looked_at(text)
    assert len(computed) == 1


# --- files of numbers --------------------------------------------------------------------

TRACE = "delay = { distribution = 'trace', file = 'trace.csv' }\n"


def test_a_file_is_read_once_however_many_tables_name_it(tmp_path, counted):
    (tmp_path / "trace.csv").write_text("0.0, 0.1\n1.0, 0.2\n")
    reads = counted(from_file, "read_numbers")
    rules = f"[[network.links]]\nfrom = 0\nto = 1\n{TRACE}" * 8
    loads(HEAD + edges([[0, 1]]) + rules + robots(2), folder=tmp_path)
    assert len(reads) == 1


def test_a_broken_file_is_read_once_however_many_tables_name_it(tmp_path, counted):
    (tmp_path / "trace.csv").write_text("0.0, none\n")
    reads = counted(from_file, "read_numbers")
    rules = f"[[network.links]]\nfrom = 0\nto = 1\n{TRACE}" * 8
    with pytest.raises(ScenarioError, match="must be a number"):
        loads(HEAD + edges([[0, 1]]) + rules + robots(2), folder=tmp_path)
    assert len(reads) == 1


def test_the_rows_that_tables_take_of_files_are_bounded_together(tmp_path, monkeypatch):
    """Eight tables of one file of a million rows took the memory of the machine."""
    monkeypatch.setattr(from_file, "MOST_ROWS", 15)
    (tmp_path / "trace.csv").write_text("".join(f"{k}.0, 0.1\n" for k in range(4)))
    rule = f"[[network.links]]\nfrom = 0\nto = 1\n{TRACE}"
    text = HEAD + edges([[0, 1]]) + robots(2)
    loads(text + rule * 3, folder=tmp_path)
    with pytest.raises(ScenarioError, match=r"must take at most 15 rows together") as caught:
        loads(text + rule * 4, folder=tmp_path)
    assert [problem.place for problem in caught.value.problems] == ["network.links[3].delay.file"]


def test_a_trace_is_checked_once_and_not_for_each_link(tmp_path, counted):
    (tmp_path / "trace.csv").write_text("0.0, 0.1\n1.0, 0.2\n")
    checks = counted(TraceDelaySettings, "check")
    halves = counted(TraceDelaySettings, "quantile_s")
    rule = f"[[network.links]]\nfrom = '*'\nto = '*'\n{TRACE}"
    scenario = loads(HEAD + edges(complete(9)) + rule + robots(9), folder=tmp_path)
    assess(scenario)
    resolve(scenario)
    stiffness.course(scenario)
    assert len(checks) == len(halves) == 1
