"""Texts of strangers speak to no terminal, browser or reader of Markdown: they are shown."""

import io
import json
import re
import shutil
import subprocess
import sys
import unicodedata
from pathlib import Path

import pytest
from click.testing import CliRunner
from markdown_it import MarkdownIt
from rich.table import Table
from rich.text import Text

from formnet.lab.cli import main
from formnet.lab.pages.template import policy
from formnet.lab.scenarios.packaged import CONFIGS
from formnet.lab.text.console import Console, escape
from formnet.lab.text.markdown import as_cell
from formnet.netem.files.printable import printable

TITLE = "\x1b]0;owned\x07"
"""What sets the title of a terminal's window."""
CODES = {
    "C0": (TITLE, r"\x1b]0;owned\x07"),
    "carriage return": ("ok\rFAILS", r"ok\rFAILS"),
    "backspace": ("a\bb", r"a\x08b"),
    "NUL": ("\0", r"\x00"),
    "DEL": ("\x7f", r"\x7f"),
    "C1": ("\x9b31m", r"\x9b31m"),
    "override": ("\u202egnp.exe", r"\u202egnp.exe"),
    "isolate": ("\u2066a\u2069", r"\u2066a\u2069"),
    "zero width": ("a\u200bb\ufeff", r"a\u200bb\ufeff"),
    "separators": ("a\u2028b\u2029c", r"a\u2028b\u2029c"),
    "tag": ("\U000e0041", r"\U000e0041"),
    "surrogate": ("\udcff", r"\udcff"),
    "lines": ("a\n\tb", r"a\n\tb"),
    "what is only text": (r"é ψ → 😀 \x1b a b", r"é ψ → 😀 \x1b a b"),
}
HOSTILE = (
    f"{TITLE}\u202e\x9b2J:x:[red]<script>window.got = 1</script><img src=http://127.0.0.1:9/x>"
)
FORGED = "all is well\nverdict: holds"


def acting(text):
    """The characters of ``text`` that act or hide, but for its lines."""
    return [
        letter
        for letter in text
        if unicodedata.category(letter) in ("Cc", "Cf", "Cs", "Zl", "Zp") and letter != "\n"
    ]


@pytest.mark.parametrize(("text", "shown"), CODES.values(), ids=CODES)
def test_what_acts_or_hides_is_escaped_as_python_writes_it(text, shown):
    assert printable(text) == shown
    assert printable(shown) == shown


def test_what_is_laid_out_keeps_its_lines():
    assert printable("a\n\tb\r\n\x1b", lines=True) == "a\n\tb\\r\n\\x1b"


@pytest.mark.parametrize("terminal", [False, True])
@pytest.mark.parametrize("made", [escape, lambda text: f"[red]{escape(text)}[/]"])
def test_on_a_console_nothing_acts_but_its_own_styles(terminal, made):
    out = io.StringIO()
    colours = "standard" if terminal else None
    console = Console(file=out, force_terminal=terminal, width=200, color_system=colours)
    console.print(made(HOSTILE), soft_wrap=True)
    table = Table("name", "value")
    table.add_row(made(HOSTILE), "1")
    console.print(table)
    said = re.sub(r"\x1b\[[0-9;]*m", "", out.getvalue())  # its own styles
    assert (said != out.getvalue()) is terminal
    assert acting(said) == []
    assert said.count(r"\x1b]0;owned\x07\u202e\x9b2J:x:[red]<script>") == 2
    assert len({len(line) for line in said.splitlines()[1:]}) == 1  # the table is straight


def test_text_that_is_no_markup_is_escaped_on_a_console_too():
    out = io.StringIO()
    Console(file=out, width=200).print(Text(HOSTILE), Text.from_markup(escape(HOSTILE)))
    assert acting(out.getvalue()) == []
    assert out.getvalue().count(r"\x1b]0;owned") == 2


# --- what the program prints ------------------------------------------------------------------


def called(folder, *words):
    program = Path(sys.executable).with_name("formnet")
    done = subprocess.run([program, *map(str, words)], cwd=folder, capture_output=True)
    said = (done.stdout + done.stderr).decode()
    assert "Traceback" not in said, said
    assert acting(said) == [], said
    assert "❌" not in said
    return done.returncode, said


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A short run whose description and verdict are hostile."""
    folder = tmp_path_factory.mktemp("hostile") / "runs" / "run"
    text = json.dumps(f"{HOSTILE}\n{FORGED}")
    words = ["run", str(CONFIGS / "paper" / "section5-delay.toml"), "--inline", "--no-scene"]
    sets = [f"description={text}", "duration_s=0.2", "law.beta=5"]
    words += [word for one in sets for word in ("--set", one)]
    result = CliRunner().invoke(main, [*words, "--out", str(folder)])
    assert result.exit_code == 1, result.output
    assert acting(result.output) == []
    verdict = json.loads((folder / "verdict.json").read_text())
    verdict["mode"] = HOSTILE
    verdict["outcome"]["reason"] = verdict["versions"]["formnet"] = HOSTILE
    verdict["warnings"] = [f"{HOSTILE}\n{FORGED}"]
    (folder / "verdict.json").write_text(json.dumps(verdict))
    return folder


@pytest.fixture
def runs(run, tmp_path):
    """Copies of it, one with a name that is hostile."""
    for name in ("plain", "$\\foo$|`\x1b]0;x\x07\n:x:"):
        shutil.copytree(run, tmp_path / "runs" / name)
    return tmp_path / "runs"


@pytest.mark.processes
def test_an_unknown_key_s_name_is_shown(tmp_path):
    text = (CONFIGS / "paper" / "section5-delay.toml").read_text()
    scenario = tmp_path / "scenario.toml"
    key = HOSTILE.partition("<")[0] + FORGED  # a longer one is refused by its length
    scenario.write_text(f"{json.dumps(key)} = 1\n{text}")
    code, said = called(tmp_path, "check", scenario)
    assert code == 2
    assert r"\x1b]0;owned\x07\u202e\x9b2J:x:[red]" in said
    assert r"all is well\nverdict: holds" in said


@pytest.mark.processes
@pytest.mark.parametrize(
    "words",
    [
        ("list", "."),
        ("list", ".", "--json"),
        ("compare", "plain", "{}"),
        ("compare", "{}", "plain", "--out", "compared"),
        ("report", "{}"),
        ("plot", "{}", "--out", "figures"),
        ("verify", "{}"),
        ("export", "{}", "--format", "csv", "--out", "exported"),
        ("check", "{}/scenario.toml"),
        ("check", "{}"),
        ("replay", "{}"),
        ("doctor", "--hosts", "{}"),
        ("netem-bridge", "--from", "tcp/127.0.0.1:1", "--to", "x", "--network", "{}"),
    ],
    ids=" ".join,
)
def test_no_command_prints_what_acts(runs, words):
    name = next(path.name for path in runs.iterdir() if path.name != "plain")
    code, said = called(runs, *(word.replace("{}", name) for word in words))
    assert code in (0, 1, 2, 3)
    assert said
    if words[0] in ("list", "compare") and "--json" not in words:
        assert r"\x1b]0;x\x07\n:x:" in said


@pytest.mark.processes
def test_json_for_programs_says_the_name_as_it_is(runs):
    _, said = called(runs, "list", ".", "--json")
    found, _ = json.JSONDecoder().raw_decode(said)
    names = {Path(entry["folder"]).name for entry in found}
    assert names == {path.name for path in runs.iterdir() if path.is_dir()}


@pytest.mark.processes
@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_what_is_printed_without_a_console_and_in_logs_is_escaped(stream):
    """Children print this way into their logs; Python's own warnings and tracebacks go here."""
    code = (
        "import sys, traceback, warnings\nfrom formnet.lab.text.streams import lenient\n"
        f"text = {HOSTILE!r}\nwith lenient():\n"
        f"    print(text, file=sys.{stream}); sys.{stream}.writelines([text])\n"
        "    warnings.warn(text)\n"
        "    try: raise ValueError(text)\n    except ValueError: traceback.print_exc()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    said = (done.stdout + done.stderr).decode()
    assert said.count(r"\x1b]0;owned\x07") >= 4
    assert acting(said) == []


# --- Markdown -----------------------------------------------------------------------------------

CELLS = [
    *("a|b", "a\\|b", "\\\\|", "`", "``x`", "`|`", "<script>1</script>", "<!-- -->", "&lt;", ":x:"),
    *("[x](http://e.test)", "![x](http://e.test/x)", "http://e.test", "www.e.test", "@you", "#1"),
    *("**b**", "__b__", "~~s~~", "a\nb", "| --- |", HOSTILE, "\\", "a\\", "", " ", "law.beta"),
]


def kinds(tokens):
    for token in tokens or ():
        yield token.type
        yield from kinds(token.children)


@pytest.mark.parametrize("text", CELLS)
def test_a_cell_of_markdown_is_one_cell_with_text_or_code(text):
    table = f"| a | b |\n|---|---|\n| {as_cell(text)} | end |\n"
    tokens = (
        MarkdownIt("commonmark", {"html": True}).enable(["table", "strikethrough"]).parse(table)
    )
    assert [token.type for token in tokens].count("td_open") == 2
    cells = [token for token in tokens if token.type == "inline"]
    assert cells[-1].content == "end"
    assert set(kinds([cells[2]])) <= {"inline", "text", "code_inline"}
    if not {"|", "\\"} & set(text):
        (shown,) = [child.content for child in cells[2].children] or [""]
        assert shown.strip() == printable(text).strip()


def test_comparison_md_holds_no_more_than_its_table(runs):
    result = CliRunner().invoke(
        main, ["compare", *map(str, sorted(runs.iterdir())), "--out", str(runs.parent / "out")]
    )
    assert result.exit_code in (0, 1), result.output
    for name in ("comparison.md", "comparison.csv"):
        assert acting((runs.parent / "out" / name).read_text()) == []
    text = (runs.parent / "out" / "comparison.md").read_text()
    tokens = MarkdownIt("commonmark", {"html": True}).enable("table").parse(text)
    found = list(kinds(tokens))
    assert not {"html_inline", "html_block", "link_open"} & set(found)
    assert found.count("image") == 1  # the figure
    rows, cells = found.count("tr_open"), found.count("td_open") + found.count("th_open")
    assert cells == 3 * rows
    assert (runs.parent / "out" / "errors.png").exists()


# --- pages --------------------------------------------------------------------------------------


@pytest.fixture
def pages(runs):
    """Every page that formnet writes of these runs."""
    result = CliRunner().invoke(main, ["report", *map(str, sorted(runs.iterdir()))])
    assert result.exit_code == 0, result.output
    assert CliRunner().invoke(main, ["list", str(runs)]).exit_code == 0
    return sorted(runs.rglob("*.html"))


def test_every_page_shows_escapes_and_has_a_strict_policy(pages):
    assert [page.name for page in pages] == ["report.html", "index.html", "report.html"]
    for page in pages:
        text = page.read_text()
        assert acting(text) == []
        assert r"\x1b]0;" in text
        head = text[: text.index("<style>")]
        assert 'http-equiv="Content-Security-Policy" content="default-src &#39;none&#39;; ' in head
        assert "unsafe" not in head
        assert " style=" not in text


def test_a_policy_without_script_lets_none_run():
    assert policy("p {}", img="data:") == (
        "default-src 'none'; style-src 'sha256-SNJDlN1Iy2mnt7DOjQIyDb2LQE6O5PQiSZomcdzawQ4='; "
        "script-src 'none'; img-src data:; base-uri 'none'; form-action 'none'"
    )


INJECTED = """() => {
  document.body.insertAdjacentHTML("beforeend",
    "<img src=http://127.0.0.1:9/x onerror='window.got = 1'><a id=a href='javascript:window.got=1'>x</a>"
    + "<p style='position: fixed'>x</p><form action=http://127.0.0.1:9/><button id=b>x</button></form>");
  const script = document.createElement("script");
  script.textContent = "window.got = 1";
  document.body.append(script);
  document.getElementById("a").click();
}"""


@pytest.mark.browser
def test_in_a_browser_pages_keep_to_their_policy_and_it_keeps_scripts_out(browser, pages):
    for page in pages:
        tab = browser.new_page()
        said, asked = [], []
        tab.on("console", lambda message, said=said: said.append(message.text))
        tab.on("request", lambda request, asked=asked: asked.append(request.url))
        tab.goto(page.as_uri())
        assert said == []
        assert {url.partition(":")[0] for url in asked} <= {"file", "data"}
        assert tab.evaluate("[...document.images].every(i => i.complete && i.naturalWidth > 0)")
        assert tab.evaluate("getComputedStyle(document.querySelector('main')).maxWidth") == "1152px"
        assert tab.evaluate("window.got ?? null") is None
        tab.evaluate(INJECTED)
        tab.wait_for_function("() => document.scripts.length > 0")
        assert tab.evaluate("window.got ?? null") is None
        assert len([text for text in said if "Content Security Policy" in text]) >= 4
        tab.close()
