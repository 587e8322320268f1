"""The page of a run in a browser, as narrow as a phone."""

import pytest
from click.testing import CliRunner

from formnet.lab.cli import main
from formnet.lab.scenarios.packaged import CONFIGS

pytestmark = pytest.mark.browser

SIDEWAYS = "document.scrollingElement.scrollWidth - document.scrollingElement.clientWidth"
WIDTHS = "[...document.querySelectorAll('figure img')].map(i => i.getBoundingClientRect().width)"
ROOM = "[...document.querySelectorAll('figure')].map(f => [f.scrollWidth, f.clientWidth])"
FILTERS = "[...document.images].map(i => getComputedStyle(i).filter)"


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A folder of runs, with one that is drawn."""
    folder = tmp_path_factory.mktemp("phone") / "runs"
    result = CliRunner().invoke(
        main,
        [
            "run",
            str(CONFIGS / "paper" / "section5-delay.toml"),
            "--inline",
            "--no-scene",
            "--out",
            str(folder / "short"),
            "--set",
            "duration_s=0.4",
        ],
    )
    assert result.exit_code == 1, result.output
    return folder


@pytest.fixture
def opened(browser, runs):
    """A function that opens a page of the folder so wide."""
    pages = []

    def open_(name="short/report.html", width=390, **context):
        page = browser.new_page(viewport={"width": width, "height": 844}, **context)
        page.goto((runs / name).as_uri())
        pages.append(page)
        return page

    yield open_
    for page in pages:
        page.close()


def test_on_a_phone_figures_fit_until_they_are_tapped(opened):
    page = opened()
    widths = page.evaluate(WIDTHS)
    assert len(widths) == 7
    assert all(0 < width <= 390 for width in widths)
    assert all(full <= seen for full, seen in page.evaluate(ROOM))
    assert page.evaluate(SIDEWAYS) == 0
    images = page.locator("figure:not(.narrow) img")
    for k in range(images.count()):
        images.nth(k).click()
    large = [width for width in page.evaluate(WIDTHS) if width > 390]
    assert len(large) == images.count() == 6
    assert sum(full > seen for full, seen in page.evaluate(ROOM)) == 6
    assert page.evaluate(SIDEWAYS) == 0
    figure = page.locator("figure:not(.narrow)").first
    assert figure.evaluate("f => { f.scrollLeft = 200; return f.scrollLeft }") == 200
    images.first.click()
    assert page.evaluate(WIDTHS)[0] == widths[0]


def test_figures_are_enlarged_by_keyboard(opened):
    page = opened()
    box = page.get_by_role("checkbox", name="Enlarge: Errors of Eqs. 3–5")
    outline = "b => getComputedStyle(b.parentElement.querySelector('img')).outlineStyle"
    assert box.evaluate(outline) == "none"
    box.focus()
    page.keyboard.press("Shift+Tab")
    page.keyboard.press("Tab")  # it can be reached so
    assert box.evaluate("b => b === document.activeElement")
    assert box.evaluate(outline) == "solid"
    page.keyboard.press("Space")
    assert page.evaluate(WIDTHS)[0] > 390


def test_a_wide_screen_paper_and_the_dark_have_nothing_to_enlarge(opened):
    wide = opened(width=1280)
    assert wide.get_by_role("checkbox").count() == 0
    before = wide.evaluate(WIDTHS)
    wide.locator("figure img").first.click()
    assert wide.evaluate(WIDTHS) == before
    assert before[0] > 390
    paper = opened()
    paper.locator("figure img").first.click()
    paper.emulate_media(media="print")
    assert all(width <= 390 for width in paper.evaluate(WIDTHS))
    dark = opened(color_scheme="dark")
    dark.locator("figure img").first.click()
    assert all("invert" in value for value in dark.evaluate(FILTERS))
    assert dark.evaluate(WIDTHS)[0] > 390


def test_the_index_fits_a_phone(opened):
    assert opened("index.html").evaluate(SIDEWAYS) == 0
