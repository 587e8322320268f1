"""CSV and TOML files as people have them: what is wrong is told with file, line and column."""

import pathlib
import random
import re
import tomllib

import pytest

from formnet.formation.machines.hosts import HostsError, load_hosts
from formnet.formation.scenario.loading import ScenarioError, load, loads
from formnet.netem import LinkSettings
from formnet.netem.bridge import lanes
from formnet.netem.files import toml
from formnet.netem.files.csv_file import FileError, read_numbers
from formnet.netem.files.problems import problems
from formnet.netem.files.toml import parse_toml
from formnet.netem.files.toml_clash import clash

# --- CSV: what is read ----------------------------------------------------------------------


@pytest.fixture
def file(tmp_path):
    return tmp_path / "f.csv"


READ = {
    "plain": (b"1\n2\n", [1, 2], [1, 2]),
    "mark": (b"\xef\xbb\xbf1\n0\n0\n", [1, 0, 0], [1, 2, 3]),
    "mark and header": (b"\xef\xbb\xbfdelay_s\n1\n", [1], [2]),
    "header as numpy writes it": (b"# delay (s)\n1\n", [1], [2]),
    "blank lines before and between": (b"\n \nlost\n\n1\n\n0", [1, 0], [5, 7]),
    "quoted header of two lines": (b'"delay\n(s)"\n1\n2\n', [1, 2], [3, 4]),
    "lines as DOS and old Macs end them": (b"1\r\n2\r3\r", [1, 2, 3], [1, 2, 3]),
    "blanks around, signs, exponents": (b" +1 \n-.5\n2.e1\n", [1, -0.5, 20], [1, 2, 3]),
    "header in Greek": ("καθυστέρηση\n1\n".encode(), [1], [2]),
}


@pytest.mark.parametrize("case", READ)
def test_rows_are_read_with_their_lines(file, case):
    content, values, lines = READ[case]
    file.write_bytes(content)
    found = read_numbers(file, 1)
    assert [row[0] for row in found.rows] == values
    assert found.lines == lines


# What a file of two columns holds, and what is said of it.
REFUSED = {
    "a first row that is no header": (
        b"0,0.010,x\n1,2\n",
        "line 1, column 3: must be a number",
    ),
    "an empty cell in the first row": (b"0,\n1,2\n", "line 1, column 2: must be a number"),
    "empty cells alone": (b",\n1,2\n", "line 1, column 1: must be a number"),
    "a unit": (b"0,0.5ms\n1,2\n", "line 1, column 2: must be a number"),
    "a currency": ("€5,€6\n1,2\n".encode(), "line 1, column 1: must be a number"),
    "a dash": (b"-,-\n1,2\n", "line 1, column 1: must be a number"),
    "a header that is half a number": (
        b"time,1\n1,2\n",
        "line 1, column 1: must be a number",
    ),
    "a second header": (b"t,d\nt,d\n1,2\n", "line 2, column 1: must be a number"),
    "a header after numbers": (b"1,2\nt,d\n", "line 2, column 1: must be a number"),
    "not finite": (b"nan,inf\n1,2\n", "line 1, column 1: must be finite"),
    "too large": (b"1,1e999\n", "line 1, column 2: must be finite"),
    "underscores": (b"1_0,2\n", "line 1, column 1: must be a number"),
    "digits that are not ASCII": ("١,2\n".encode(), "line 1, column 1: must be a number"),
    "too few": (b"1,2\n\n1\n", "line 3: must have 2 columns, has 1"),
    "too many": (b"1,2,3\n", "line 1: must have 2 columns, has 3"),
    "semicolons": (
        b"t;d\n1;2\n",
        "line 2, column 1: must be a number; columns are parted by commas, not by semicolons",
    ),
    "decimal commas": (
        b"t;d\n1;0,5\n",
        "line 2, column 1: must be a number; columns are parted by commas, not by semicolons",
    ),
    "tabs": (
        b"1\t2\n",
        "line 1, column 1: must be a number; columns are parted by commas, not by tabs",
    ),
    "UTF-16": (
        "1,2\n".encode("utf-16"),
        "line 1: has a byte that is not UTF-8 (0xff): must be UTF-8 text (is it UTF-16?)",
    ),
    "UTF-16 without a mark": ("1,2\n3,4\n".encode("utf-16-le"), "line 1: has a null character"),
    "Latin-1": (b"1,2\n\xe9,3\n", "line 2: has a byte that is not UTF-8 (0xe9)"),
    "a null character": (b"1,2\n1,\x002\n", "line 2: has a null character"),
    "a quote that is not closed": (
        b'1,2\n"3,4\n5,6\n',
        "line 2: is not CSV: unexpected end of data; is a quote not closed?",
    ),
    "text after a quote": (b'1,2\n"3"x,4\n', "line 2: is not CSV: "),
    "a huge cell": (b"1," + b"2" * 200_000, "line 1: is not CSV: field larger than field limit"),
    "a long cell": (b"1," + b"x" * 100_000, "line 1, column 2: must be a number"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_number_is_told_with_file_line_and_column(file, case):
    content, words = REFUSED[case]
    file.write_bytes(content)
    with pytest.raises(FileError) as caught:
        read_numbers(file, 2)
    told = str(caught.value)
    assert told.startswith(f"file {file}, {words}")
    assert len(told) < 300


@pytest.mark.parametrize("content", [b"", b"\n \n", b"\xef\xbb\xbf", b"time_s\n"])
def test_a_file_without_numbers(file, content):
    file.write_bytes(content)
    with pytest.raises(FileError, match=r"f\.csv holds no numbers"):
        read_numbers(file, 1)


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (1, ""),
        (2, " (and 1 more problem in this file)"),
        (9, " (and 8 more problems in this file)"),
    ],
)
def test_the_first_problem_in_full_and_the_number_of_further_ones(file, bad, words):
    file.write_text("1\n" + "x\n" * bad + "2\n")
    with pytest.raises(FileError) as caught:
        read_numbers(file, 1)
    assert str(caught.value) == f"file {file}, line 2, column 1: must be a number{words}"


def test_whatever_the_bytes_only_a_file_error_comes_out(file):
    seed = 20240
    print(f"seed {seed}")
    draw = random.Random(seed)
    pieces = [
        b"1",
        b"0.5",
        b",",
        b"\n",
        b'"',
        b"\r",
        b"x",
        b"-",
        b"\x00",
        b"\xff",
        b"\xef\xbb\xbf",
        b"nan",
        b"#",
        b" ",
        "½".encode(),
    ]
    read, told = 0, set()
    for _ in range(3000):
        file.write_bytes(b"".join(draw.choices(pieces, k=draw.randrange(12))))
        try:
            read += bool(read_numbers(file, 1).rows)
        except FileError as error:
            told.add(str(error))
    assert read > 50
    assert len(told) > 15
    assert all(text.startswith(f"file {file}") for text in told)


# --- CSV: rules for the numbers ---------------------------------------------------------------


def said(tmp_path, table):
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - the text is what is tested
        LinkSettings.model_validate(table, context={"folder": tmp_path})
    return [str(problem) for problem in problems(LinkSettings, table, caught.value)]


LOSS = {"loss": {"model": "trace"}}
TRACE = {"delay": {"distribution": "trace"}}
SAMPLES = {"delay": {"distribution": "empirical"}}
BROKEN_RULES = {
    "half a loss": (
        LOSS,
        "0\n1\n0.5\n",
        "line 3, column 1: must be 0 or 1",
        {"losses": [0, 1, 0.5]},
        "losses[2] = 0.5: must be 0 or 1",
    ),
    "a negative sample": (
        SAMPLES,
        "rtt\n0.1\n\n-0.1\n",
        "line 4, column 1: must be at least 0",
        {"samples_s": [0.1, -0.1]},
        "samples_s[1] = -0.1: must be at least 0",
    ),
    "a long delay": (
        TRACE,
        "0,1\n1,1e4\n",
        "line 2, column 2: must be at most 3600",
        {"times_s": [0, 1], "delays_s": [1, 1e4]},
        "delays_s[1] = 10000.0: must be at most 3600",
    ),
    "a late time": (
        TRACE,
        "0,1\n1e10,1\n",
        "line 2, column 1: must be at most 1e+09",
        {"times_s": [0, 1e10], "delays_s": [1, 1]},
        "times_s[1] = 10000000000.0: must be at most 1e+09",
    ),
    "times that descend": (
        TRACE,
        '"t\ns",d\n0,1\n2,1\n1,1\n',
        "line 5, column 1: must be at least 1 ns after the time before it, 2.0",
        {"times_s": [0, 2, 1], "delays_s": [1, 1, 1]},
        "times_s[2] = 1.0: must be at least 1 ns after the time before it, 2.0",
    ),
    "one instant twice": (
        TRACE,
        "0,1\n1e-10,2\n",
        "line 2, column 1: must be at least 1 ns after the time before it, 0.0",
        {"times_s": [0, 1e-10], "delays_s": [1, 1]},
        "times_s[1] = 1e-10: must be at least 1 ns after the time before it, 0.0",
    ),
}


@pytest.mark.parametrize("case", BROKEN_RULES)
def test_a_rule_is_the_same_for_rows_of_a_file_and_for_lists(tmp_path, case):
    table, content, of_file, lists, of_list = BROKEN_RULES[case]
    (tmp_path / "f.csv").write_text(content)
    ((key, kind),) = table.items()
    place = f"file {tmp_path / 'f.csv'}, "
    assert said(tmp_path, {key: kind | {"file": "f.csv"}}) == [
        f"{key}.file = 'f.csv': {place}{of_file}"
    ]
    (found,) = said(tmp_path, {key: kind | lists})
    assert found.startswith(f"{key}")
    assert found.endswith(of_list)


def test_further_problems_of_a_file_are_counted_and_others_of_the_table_told(tmp_path):
    (tmp_path / "f.csv").write_text("-0.1\n0.1\n-0.2\n5000\n")
    table = {"delay": {"distribution": "empirical", "file": "f.csv", "correlation": 2.0, "x": 1}}
    assert sorted(said(tmp_path, table)) == [
        "delay.correlation = 2.0: must be less than 1",
        f"delay.file = 'f.csv': file {tmp_path / 'f.csv'}, line 1, column 1: "
        "must be at least 0 (and 2 more problems in this file)",
        "delay.x = 1: unknown key; valid keys here: correlation, distribution, samples_s",
    ]


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"file": 3}, "delay.file = 3: must be a string"),
        (
            {"file": "f.csv", "samples_s": [0.1]},
            "delay.file = 'f.csv': samples_s is given, too: only one of them can be",
        ),
        ({"file": "none.csv"}, "cannot be read: No such file or directory"),
        ({"file": "."}, "cannot be read: it is no regular file"),
        ({"file": "a\0b"}, "cannot be read: embedded null byte"),
    ],
)
def test_a_file_that_cannot_be_taken_is_named(tmp_path, table, words):
    (found,) = said(tmp_path, {"delay": {"distribution": "empirical"} | table})
    assert words in found


# --- TOML -----------------------------------------------------------------------------------


@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_toml_is_read_with_and_without_a_byte_order_mark(root, tmp_path, mark):
    path = tmp_path / "x.toml"
    scenario = (root / "configs" / "paper" / "theorem1.toml").read_text("utf-8")
    path.write_text(mark + scenario, encoding="utf-8")
    assert load(path) == loads(mark + scenario) == loads(scenario)
    network = (root / "configs" / "network" / "wifi.toml").read_text("utf-8")
    path.write_text(mark + network, encoding="utf-8")
    assert lanes.load(path) == lanes.load(root / "configs" / "network" / "wifi.toml")
    hosts = 'listen = "tls/192.0.2.1:7447"\n[[hosts]]\nname = "a"\nssh = "a"\nrobots = [1]\n'
    path.write_text(mark + hosts, encoding="utf-8")
    assert load_hosts(path).hosts[0].robots == [1]


def test_a_key_given_twice_is_named_in_every_kind_of_file(tmp_path):
    path = tmp_path / "x.toml"
    path.write_text("seed = 1\n# and\nseed = 2\n")
    words = "not TOML: seed is given twice: on line 3, and before that on line 1"
    for reader, error in (
        (load, ScenarioError),
        (load_hosts, HostsError),
        (lanes.load, lanes.NetworkFileError),
    ):
        with pytest.raises(error) as caught:
            reader(path)
        assert str(caught.value) == f"{path}: {words}"


TWICE = {
    "a key": ("a = 1\nb = 2\na = 3", "a is given twice: on line 3, and before that on line 1"),
    "a key in a table": (
        "[t]\nx = 1\n\nx = 2\n",
        "t.x is given twice: on line 4, and before that on line 2",
    ),
    "quoted otherwise": (
        'a-b = 1\n"a-b" = 1',
        "a-b is given twice: on line 2, and before that on line 1",
    ),
    "a name to be quoted": (
        "\"a b\" = 1\n'a b' = 1",
        '"a b" is given twice: on line 2, and before that on line 1',
    ),
    "a table": (
        "[law.w1]\nx = 1\n[law.w1]\n",
        "law.w1 is given twice: on line 3, and before that on line 1",
    ),
    "in an array of tables": (
        "[[robots]]\nid = 1\n[[robots]]\nid = 2\nstart = {}\nid = 3\n",
        "robots[1].id is given twice: on line 6, and before that on line 4",
    ),
    "below an array of tables": (
        "[[r]]\n[r.s]\n[[r]]\n[r.s]\nx = 1\n[r.s]",
        "r[1].s is given twice: on line 6, and before that on line 4",
    ),
    "an inline table": (
        "a = { x = 1, y.z = 2, y.z = 3 }",
        "a.y.z is given twice: on line 1, and before that on line 1",
    ),
    "inline tables in a list": (
        "a = [\n  { x = 1 },\n  { y = 1, y = 2 },\n]",
        "a[1].y is given twice: on line 3, and before that on line 3",
    ),
    "beside texts and lists of many lines": (
        't = """\na = 1\n[a]\n"""\na = [ # [\n 1,\n]\na = 2',
        "a is given twice: on line 8, and before that on line 5",
    ),
    "the second of many lines": (
        "a = 1\na = [\n2,\n]\n",
        "a is given twice: on line 2, and before that on line 1",
    ),
    "a value and a table": (
        "a = 1\n[a]\n",
        "a is given twice: on line 2, and before that on line 1",
    ),
    "an array and a table": (
        "[[a]]\n[a]\n",
        "a is given twice: on line 2, and before that on line 1",
    ),
    "a value within a value": (
        "a = 1\nb = 1\na.c = 2",
        "a.c on line 3 contradicts a on line 1: a key is either",
    ),
    "more for an inline table": (
        "[x]\na = {}\n[x.a.b]\n",
        "x.a.b on line 3 contradicts x.a on line 2: a key is either",
    ),
    "DOS lines": (
        "a = 1\r\nb = 1\r\na = 2\r\n",
        "a is given twice: on line 3, and before that on line 1",
    ),
}


@pytest.mark.parametrize("case", TWICE)
def test_what_is_given_twice_is_named_with_both_lines(case):
    text, words = TWICE[case]
    with pytest.raises(ValueError, match=r"^not TOML: " + re.escape(words)):
        parse_toml(text)


@pytest.mark.parametrize("newer", [False, True])
@pytest.mark.parametrize("case", TWICE)
def test_the_words_of_tomllib_do_not_matter(monkeypatch, case, newer):
    """From Python 3.14 on an error says its line as an attribute; before, within its text."""
    text, words = TWICE[case]

    def raises(text):
        try:
            return real(text)
        except tomllib.TOMLDecodeError as error:
            other = tomllib.TOMLDecodeError("Key taken")
            if newer:
                line = re.search(r"line (\d+)", str(error))
                other.lineno = int(line[1]) if line else text.count("\n") + 1
            raise other from None

    real = tomllib.loads
    monkeypatch.setattr(toml.tomllib, "loads", raises)
    with pytest.raises(ValueError, match=r"^not TOML: " + re.escape(words)):
        parse_toml(text)


@pytest.mark.parametrize(
    ("text", "line"),
    [("a = 1\nb = [1,\n2\nc = 3", "c = 3"), ("a = 1\nb = = 2\na = 1", "b = = 2"), ("x\n", "x")],
)
def test_another_error_is_told_with_the_text_of_its_line(text, line):
    with pytest.raises(tomllib.TOMLDecodeError) as theirs:
        tomllib.loads(text)
    with pytest.raises(ValueError, match=r"^not TOML: ") as ours:
        parse_toml(text)
    assert str(ours.value) == f"not TOML: {theirs.value}: {line!r}"


@pytest.mark.parametrize(
    "text", ["token hunter2", "hunter2 = 1\nhunter2 = 1", "hunter2" * 20 + " = 1"]
)
def test_of_what_a_link_leads_to_no_error_shows_a_line(tmp_path, text):
    """``scenario.toml`` in a folder from elsewhere can lead to a file of one's own."""
    (tmp_path / "mine").write_text(text)
    (tmp_path / "scenario.toml").symlink_to(tmp_path / "mine")
    with pytest.raises(ScenarioError, match="hunter2"):
        load(tmp_path / "mine")
    with pytest.raises(ScenarioError, match="it is a symbolic link") as raised:
        load(tmp_path / "scenario.toml")
    assert "hunter2" not in str(raised.value)


@pytest.mark.parametrize("text", ["a = " + "[" * 100_000, "a = {b=" * 20_000])
def test_toml_beyond_what_python_reads_is_no_crash(text):
    with pytest.raises(ValueError, match=r"^not TOML: "):
        parse_toml(text)
    with pytest.raises(ScenarioError, match="not TOML: "):
        loads(text)


@pytest.mark.parametrize("raw", ["{a = 1, a = 2}", "[1", '"x'])
def test_an_override_that_begins_as_toml_and_is_none_is_refused(root, raw):
    scenario = (root / "configs" / "paper" / "theorem1.toml").read_text("utf-8")
    with pytest.raises(ScenarioError, match=r"^f: --set law\.parameters = .*: not TOML: "):
        loads(scenario, "f", [f"law.parameters={raw}"])


KEYS = ("a", "b", "c", '"a"', "'b'")


def drawn(draw):
    """A TOML text of few keys, well formed but for what is given twice."""

    def key():
        return ".".join(draw.choices(KEYS, k=draw.choice((1, 1, 1, 2, 2, 3))))

    def value(depth=0):
        plain = (
            "1",
            "'x = {'",
            "'''\n[a]\nb=1\n'''",
            '"""\na"=\n"""',
            "1979-05-27 07:32:00",
            "[]",
            "{}",
        )
        match draw.randrange(5 if depth < 2 else 2):
            case 2:
                pairs = (f"{key()} = {value(depth + 1)}" for _ in range(draw.randrange(1, 4)))
                return "{ " + ", ".join(pairs) + " }"
            case 3:
                return f"[ {value(depth + 1)}, # ]\n {value(depth + 1)},\n]"
            case _:
                return draw.choice(plain)

    forms = (
        lambda: f"[{key()}]",
        lambda: f"[[{key()}]] # x",
        *[lambda: f"{key()} = {value()}"] * 4,
    )
    return "\n".join(draw.choice(forms)() for _ in range(draw.randrange(1, 7)))


def test_what_is_given_twice_is_found_exactly_where_tomllib_refuses_it():
    seed = 4711
    print(f"seed {seed}")
    draw, refused = random.Random(seed), 0
    for _ in range(4000):
        text = drawn(draw)
        found = clash(text)
        try:
            tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            refused += 1
            assert found is not None, text
            line = re.search(r"line (\d+)", str(error))
            last = int(line[1]) if line else text.count("\n") + 1
            assert found.begin <= last <= found.end, text
            assert found.first <= found.begin, text
        else:
            assert found is None, text
    assert 1000 < refused < 3000


def test_a_file_without_end_is_refused():
    """Not read until the memory is full."""
    with pytest.raises(FileError, match="cannot be read: it is no regular file"):
        read_numbers(pathlib.Path("/dev/zero"), 1)
