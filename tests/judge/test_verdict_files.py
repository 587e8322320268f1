"""verdict.json: one model writes it, reads it and describes it, and no file can surprise it."""

import copy
import json
import subprocess
import sys
from io import StringIO

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from verdicts import RICH, made

from formnet.formation.briefing.resolving import resolve
from formnet.formation.records.outcome import Outcome
from formnet.formation.scenario.expect import ERRORS
from formnet.lab.launch.inline import Inline
from formnet.lab.pages.comparison import comparison
from formnet.lab.pages.listing import look_at
from formnet.lab.pages.report import page
from formnet.lab.runs.files import MOST_BYTES
from formnet.lab.runs.recording import Recording
from formnet.lab.schemas import verdict_page
from formnet.lab.schemas.verdict import text as schema_text
from formnet.lab.schemas.verdict import verdict_schema
from formnet.lab.text.summary import claims_table, summarise
from formnet.lab.verdict.files import Unreadable, read, save, text
from formnet.lab.verdict.model import FORMAT, Verdict, judge
from formnet.lab.verdict.recorded import read_run

CHECK = jsonschema.Draft202012Validator(verdict_schema())
CLAIMS = {name: {"expected": True, "observed": False, "holds": False} for name in ERRORS}
WHOLE = json.loads(text(made(claims=CLAIMS, lost=[3], **RICH)))


@pytest.fixture(scope="module")
def ran(tmp_path_factory, paper):
    """The folder of a short run, and its verdict."""
    recording = Recording(tmp_path_factory.mktemp("ran") / "run", paper("theorem6", "duration_s=1"))
    Inline().run(resolve(recording.scenario), recording)
    assert recording.save() == []
    judged = judge(recording, mode="inline", wall_s=1.0, warnings=["x"])
    save(judged, recording.folder)
    return recording.folder, judged


def put(folder, data):
    (folder / "verdict.json").write_text(data if isinstance(data, str) else json.dumps(data))
    return folder


def refused(folder, data):
    """What is said of a verdict that cannot be read."""
    with pytest.raises(Unreadable) as caught:
        read(put(folder, data))
    return str(caught.value)


# --- one model ------------------------------------------------------------------------


def test_what_is_written_is_read_and_begins_with_its_format(ran, tmp_path):
    folder, judged = ran
    assert read(folder) == judged
    written = (folder / "verdict.json").read_text(encoding="utf-8")
    assert written == text(judged)
    assert next(iter(json.loads(written))) == "format"
    assert text(read(put(tmp_path, WHOLE))) == text(Verdict.model_validate(WHOLE))


def test_the_schema_takes_verdicts_and_what_the_model_refuses_it_refuses(ran):
    for verdict in (json.loads(text(ran[1])), WHOLE):
        assert [error.message for error in CHECK.iter_errors(verdict)] == []
    for place, value in ((("format",), 3), (("outcome", "kind"), "won"), (("claims", "x"), {})):
        assert not CHECK.is_valid(changed(place, value))
    assert not CHECK.is_valid({key: value for key, value in WHOLE.items() if key != "why"})


def test_the_committed_schema_and_page_are_what_the_code_says(root):
    """If this fails: make reference."""
    assert (root / "docs" / "verdict.schema.json").read_text(encoding="utf-8") == schema_text()
    assert (root / "docs" / "verdict.md").read_text(encoding="utf-8") == verdict_page.reference()


def test_every_key_is_described():
    schema = verdict_schema()
    for name, table in {"top": schema, **schema["$defs"]}.items():
        assert table["additionalProperties"] is False
        for key, entry in table["properties"].items():
            inner = schema["$defs"][entry["$ref"].rpartition("/")[2]] if "$ref" in entry else {}
            words = entry.get("description") or inner.get("description", "")
            assert words, f"{name}.{key}"
            assert ":" + "mod:" not in words


def test_every_criterion_has_its_error_at_the_end():
    verdict = Verdict.model_validate(WHOLE)
    assert [verdict.error(name) for name in ERRORS] == [0.5, 0.25, 1e300]


@pytest.mark.processes
def test_reading_a_verdict_loads_nothing_that_computes_one(ran):
    program = (
        "import sys; from pathlib import Path; from formnet.lab.verdict.files import read; "
        "read(Path(sys.argv[1])); print([name for name in sys.modules if name in "
        "('scipy', 'pyarrow', 'networkx') or name.startswith('formnet.lab.judge')])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, ran[0]], capture_output=True, text=True, check=True
    )
    assert done.stdout == "[]\n"


# --- formats --------------------------------------------------------------------------


def test_format_1_has_no_number_and_is_read(tmp_path):
    old = {key: value for key, value in WHOLE.items() if key != "format"}
    assert read(put(tmp_path, old)) == Verdict.model_validate(WHOLE)
    for key in ("warnings", "motion"):
        del old[key]
    old["messages"] = {k: v for k, v in old["messages"].items() if k != "refused"}
    found = read(put(tmp_path, old))
    assert (found.warnings, found.motion, found.messages.refused) == ([], None, [])


def test_a_file_that_does_not_fit_its_format_is_refused_with_its_writer(tmp_path):
    old = {key: value for key, value in WHOLE.items() if key not in ("format", "links", "why")}
    assert refused(tmp_path, old) == (
        "verdict.json is not a verdict of format 1 (written by formnet 0.1.0): "
        "why: is required; links: is required"
    )
    old["messages"] = 3
    assert "messages = 3: must be a table" in refused(tmp_path, old)
    assert refused(tmp_path, changed(("claims", "heading", "tolerance"), "x")) == (
        "verdict.json is not a verdict of format 2 (written by formnet 0.1.0): "
        "claims.heading.tolerance = 'x': must be a number"
    )


@pytest.mark.parametrize("number", [FORMAT + 1, 0, -1, "2", 2.5, True, None, [2], "x" * 1000])
def test_another_format_is_refused_with_its_writer(tmp_path, number):
    said = refused(tmp_path, changed(("format",), number))
    assert said.startswith("verdict.json is of format ")
    assert said.endswith(", written by formnet 0.1.0; this formnet reads formats 1 to 2")
    assert len(said) < 150


# --- files of unknown origin ----------------------------------------------------------


@pytest.mark.parametrize(
    "content",
    ["", "{", "3", "[]", "null", "[" * 100_000, '{"a":' * 100_000, "\x00", '"\\ud800"', "1" * 5000],
)
def test_what_is_no_verdict_at_all_is_said(tmp_path, content):
    assert refused(tmp_path, content).startswith("verdict.json is not a verdict")
    (tmp_path / "verdict.json").write_bytes(b'{"a": "\xff"}')
    with pytest.raises(Unreadable, match="not a verdict: not JSON"):
        read(tmp_path)


def test_a_file_that_is_too_long_is_not_read(tmp_path):
    assert read(put(tmp_path, WHOLE)).links
    with (tmp_path / "verdict.json").open("ab") as stream:
        stream.truncate(MOST_BYTES + 1)
    with pytest.raises(Unreadable, match="it is longer than 64 MiB"):
        read(tmp_path)


def test_a_verdict_that_is_no_file_is_none(tmp_path):
    (tmp_path / "verdict.json").mkdir()
    with pytest.raises(Unreadable, match="it is no regular file"):
        read(tmp_path)


def places(node, at=()):
    """Every place in a verdict, inner ones too."""
    inner = node.items() if isinstance(node, dict) else ()
    if isinstance(node, list):
        inner = enumerate(node)
    for key, value in inner:
        yield (*at, key)
        yield from places(value, (*at, key))


def changed(place, value):
    data = copy.deepcopy(WHOLE)
    inside = data
    for part in place[:-1]:
        inside = inside[part]
    inside[place[-1]] = value
    return data


NUMBERS = [True, -1, 0, 7, 2**31, 2**63, 10**400, 0.5, -1e308, 1e308, float("nan"), float("inf")]
OTHERS = [None, "", "x", "1", "lost", "[red]", "\x1b[31m", [], [1], [[]], {}, {"x": 1}, {"x": "y"}]
WRONG = st.sampled_from([*NUMBERS, *OTHERS])


def look(folder, scenario):
    """Everything that is told of a verdict: the page, the list, the terminal, comparisons."""
    run = read_run(folder)
    assert page(run)
    assert look_at(folder)
    if run.verdict is None:
        (problem,) = run.problems
        assert problem.startswith("verdict.json is ")
        return
    console = Console(file=StringIO())
    console.print(claims_table(run.verdict, scenario))
    summarise(console, scenario, run.verdict)
    assert comparison([run, run]).names
    assert isinstance(run.verdict.other_versions(), list)
    save(run.verdict, folder)
    assert read(folder) == run.verdict


@pytest.fixture(scope="module")
def folder(tmp_path_factory, paper):
    """The folder of a run without a sample."""
    recording = Recording(tmp_path_factory.mktemp("few") / "run", paper("theorem6"))
    recording(Outcome("interrupted", 0, None, ""))
    assert recording.save() == []
    return recording


@pytest.mark.long
@given(place=st.sampled_from(sorted(places(WHOLE), key=str)), value=WRONG)
def test_a_changed_verdict_is_told_or_refused_and_never_a_traceback(folder, place, value):
    put(folder.folder, changed(place, value))
    look(folder.folder, folder.scenario)


@pytest.mark.long
@given(
    place=st.sampled_from(
        [place for place in sorted(places(WHOLE), key=str) if isinstance(place[-1], str)]
    ),
    drops=st.booleans(),
)
def test_a_key_that_is_missing_or_unknown_is_told_or_refused(folder, place, drops):
    data = changed(place, 1)
    inside = data
    for part in place[:-1]:
        inside = inside[part]
    value = inside.pop(place[-1])
    if not drops:
        inside[place[-1] + "_"] = value
    put(folder.folder, data)
    look(folder.folder, folder.scenario)


@pytest.mark.long
@given(st.recursive(WRONG, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner)))
def test_any_json_is_refused(folder, data):
    put(folder.folder, data)
    look(folder.folder, folder.scenario)
