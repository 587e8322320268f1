"""TOML and scenarios have bounds: what would keep a reader busy is refused, with place and rule."""

import os
import time

import pytest

from formnet.formation.scenario.graph import MOST_EDGES
from formnet.formation.scenario.loading import ScenarioError, load, loads
from formnet.formation.scenario.model import MOST_ROBOTS
from formnet.formation.scenario.network import MOST_ENTRIES
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.netem.files.bounds import MOST_BYTES, MOST_DEPTH
from formnet.netem.files.toml import parse_toml, read_toml

FILE = CONFIGS / "paper" / "section5.toml"
ENDLESS_S = 60.0
"""Before, each of these took minutes, hours, or the whole memory."""

TEXTS = {
    "dots": ("a" + ".a" * 50_000 + " = 1", "a key of 50001 parts: must have at most 32 parts"),
    "dots of a header": ("[" + "a." * 50_000 + "a]", "must have at most 32 parts (line 1)"),
    "blanks between": ("x = 1\na" + " . 'a.b'" * 40, "a key of 41 parts: must have at most 32"),
    "hexadecimal": ("x = 0x" + "f" * 200_000, "a key or number of 200002 characters"),
    "decimal": ("x = " + "9" * 200_000, "must have at most 100 characters (line 1)"),
    "a bare key": ("a" * 10**6 + " = 1", "a key or number of 1000000 characters"),
    "a quoted key": ('"' + "a" * 500 + '" = 1', "a key of 500 characters: must have at most 100"),
    "deep lists": ("x = " + "[" * 40 + "]" * 40, "lists or tables in one another: must be"),
    "deep tables": ("x = " + "{a=" * 40 + "1" + "}" * 40, "must be at most 32 deep"),
    "96 bits": ("[a]\nx = [1, 0xffffffffffffffffffffffff]", "a.x[1] = a number of 96 bits"),
    "long": ("#" * (MOST_BYTES + 1), "2097153 characters: must be at most 2 MiB"),
    "quotes without an end": ('x = """' + '\\"""' * 300_000, "not TOML: "),
    "quotes alone": ('"' * 10**6, "not TOML: "),
}


@pytest.mark.parametrize("case", TEXTS)
def test_a_text_that_would_keep_a_reader_busy_is_refused(case):
    text, words = TEXTS[case]
    began = time.process_time()
    with pytest.raises(ValueError, match=r".") as caught:
        parse_toml(text)
    assert words in str(caught.value)
    assert len(str(caught.value)) < 300
    assert time.process_time() - began < ENDLESS_S


@pytest.mark.parametrize(
    "text",
    [
        'x = "' + "a.b." * 1000 + '"',
        "# " + "a." * 1000,
        "x = '''" + "a." * 1000 + "'''",
        'x = """' + "a." * 1000 + '\\""""',
        "a" + ".a" * (MOST_DEPTH - 2) + " = -9223372036854775808",
        'x."' + "." * 90 + '" = 1',
        "x = 1979-05-27T07:32:00.999999-07:00",
    ],
)
def test_what_only_looks_like_it_is_read(text):
    parse_toml(text)


@pytest.mark.parametrize("kind", ["pipe", "device", "sparse"])
def test_a_file_that_is_none_or_too_long_is_refused(tmp_path, kind):
    path = tmp_path / "x.toml"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        with path.open("wb") as stream:
            stream.truncate(2**40)
    rule = "longer than 2 MiB" if kind == "sparse" else "no regular file"
    with pytest.raises(ValueError, match=rule):
        read_toml(path)


def test_a_link_that_the_user_named_is_followed_and_one_in_a_received_folder_is_not(tmp_path):
    (tmp_path / "scenario.toml").symlink_to(FILE)
    assert load(tmp_path / "scenario.toml").name == "section5"
    with pytest.raises(ScenarioError, match="it is a symbolic link, which is not followed"):
        load(tmp_path / "scenario.toml", follow=False)


EDGES = ", ".join(["[1, 2]"] * (MOST_EDGES + 1))
COUNTS = {
    "robots": (
        "".join(
            f"[[robots]]\nid = {k}\noffset_m = [0, 0]\nstart = {{ x_m = 0, y_m = 0 }}\n"
            for k in range(MOST_ROBOTS + 1)
        ),
        "robots",
        f"must have at most {MOST_ROBOTS} items",
    ),
    "timeline": (
        "[[timeline]]\naction = 'cut'\nat_s = 0.1\n" * (MOST_ENTRIES + 1),
        "timeline",
        f"must have at most {MOST_ENTRIES} items",
    ),
    "links": (
        "[[network.links]]\nfrom = 1\nto = 2\n" * (MOST_ENTRIES + 1),
        "network.links",
        f"must have at most {MOST_ENTRIES} items",
    ),
    "edges": (f"[formation]\nedges = [{EDGES}]\n", "formation.edges", f"at most {MOST_EDGES}"),
}


@pytest.mark.parametrize("case", COUNTS)
def test_a_list_of_a_scenario_is_bounded(case):
    text, place, rule = COUNTS[case]
    with pytest.raises(ScenarioError) as caught:
        loads(text)
    told = [str(problem) for problem in caught.value.problems if problem.place == place]
    assert len(told) == 1
    assert rule in told[0]
    assert len(told[0]) < 300


def test_entries_times_links_are_bounded():
    """Each entry of the timeline is tried on each link: 3000 links and 700 entries took minutes."""
    count = 60
    pairs = [[a, b] for a in range(count) for b in range(a)]
    robots = "".join(
        f"[[robots]]\nid = {k}\noffset_m = [{k}, 0]\nstart = {{ x_m = 0, y_m = 0 }}\n"
        for k in range(count)
    )
    text = f"name = 'x'\nduration_s = 1.0\n[formation]\nedges = {pairs}\n{robots}"
    text += "[[timeline]]\naction = 'cut'\nat_s = 0.1\n" * 700
    with pytest.raises(ScenarioError, match="timeline = 700 entries: times 3540 directed links"):
        loads(text)


@pytest.mark.parametrize("path", ["a" + ".a" * 50_000, "x." * 40 + "y", "a" * 200])
def test_a_key_path_is_bounded(path):
    with pytest.raises(ScenarioError, match="must have at most 32 parts of at most 100 characters"):
        load(FILE, {path: 1})
    with pytest.raises(ScenarioError, match="must have at most 32 parts of at most 100 characters"):
        load(FILE, [f"{path}=1"])


@pytest.mark.parametrize("name", ["²", "٣", "9" * 5000])
def test_a_robot_is_named_by_ascii_digits(name):
    with pytest.raises(ScenarioError, match=r"there is no|must have at most"):
        load(FILE, {f"robots.{name}.damping": 1.0})


@pytest.mark.parametrize("seed", [2**63, 2**70])
def test_a_seed_has_64_bits(seed):
    with pytest.raises(ScenarioError, match="seed"):
        load(FILE, {"seed": seed})
