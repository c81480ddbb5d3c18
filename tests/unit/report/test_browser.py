"""The diagnosis' page in a real browser: it renders, moves, obeys the keyboard, prints, fetches nothing."""

import os
import re
import shutil
import zlib

import pytest

pytestmark = pytest.mark.slow
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
STREAM = re.compile(rb"stream\r?\n(.*?)\r?\nendstream", re.DOTALL)


@pytest.fixture(scope="session")
def playwright():
    # Not above: loading it takes a third of a second, and most runs leave these tests out.
    return pytest.importorskip(
        "playwright.sync_api", reason="playwright is not installed: no page is rendered"
    )


@pytest.fixture(scope="session")
def browser(playwright):
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip(f"none of {', '.join(BROWSERS)} is installed: no page is rendered")
    # Chromium's sandbox does not start for root, as whom containers run.
    arguments = ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=found, args=arguments)
        yield chromium
        chromium.close()


@pytest.fixture
def opened(browser, reports):
    """Open a report; any other request and any console message fails the test."""
    contexts = []

    def open_page(verdict="missing", **settings):
        context = browser.new_context(**{"reduced_motion": "reduce", **settings})
        page = context.new_page()
        complaints, address = [], reports[verdict].as_uri()
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: request.url == address or complaints.append(request.url))
        contexts.append((context, complaints))
        page.goto(address)
        return page

    yield open_page
    for context, complaints in contexts:
        context.close()
        assert complaints == []


def place(page, name):
    return page.locator(f".marble.{name}").get_attribute("transform")


def set_time(page, row):
    page.locator(".time").evaluate(
        "(slider, row) => { slider.value = row; slider.dispatchEvent(new Event('input')); }", row
    )


def shows_text(stream):
    """Whether a stream of a PDF is a page, or a part of one, that writes text."""
    try:
        # The last byte of a stream may be taken for a part of the line's end.
        return re.search(rb"\bT[jJ]\b", zlib.decompressobj().decompress(stream)) is not None
    except zlib.error:
        return False


@pytest.mark.parametrize("verdict", ["sufficient", "missing", "unlisted"])
@pytest.mark.parametrize("width", [390, 1200])
def test_page_renders_within_any_width(opened, verdict, width):
    page = opened(verdict, viewport={"width": width, "height": 800})
    assert page.locator("h1").is_visible()
    assert page.locator(".player").is_visible()
    assert not page.locator(".still").is_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    for svg in page.locator("figure svg:visible").all():
        box = svg.bounding_box()
        assert box["width"] > 200
        assert box["height"] > 100


def test_slider_moves_the_marbles_to_where_they_were(opened, diagnosis_of):
    page = opened()
    run = max(diagnosis_of("missing").runs, key=lambda run: run.base_mae)
    for row in (0, 60, 119):
        set_time(page, row)
        for name, series in (("recorded", run.observed), ("before", run.base), ("after", run.final)):
            x, y = (float(number) for number in place(page, name)[len("translate(") : -1].split())
            assert (x, y) == pytest.approx((1000 * series[row, 0], -1000 * series[row, 1]), abs=0.06)
    off = 50 * abs(run.base[119] - run.observed[119]).sum()
    # The page holds places to four digits: a hundredth of a percent.
    assert float(page.locator(".off.before").inner_text().removesuffix(" %")) == pytest.approx(off, abs=0.02)


def test_a_marble_that_was_not_seen_is_not_shown(opened):
    page = opened()
    set_time(page, 31)
    assert not page.locator(".marble.recorded").is_visible()
    assert page.locator(".off.after").inner_text() == "not seen"
    set_time(page, 50)
    assert page.locator(".marble.recorded").is_visible()


def test_choosing_a_run_shows_its_path(opened):
    page = opened()
    before = page.locator(".ghost.recorded").get_attribute("points")
    page.locator(".run").select_option(index=2)
    assert page.locator(".ghost.recorded").get_attribute("points") != before
    assert page.locator(".clock").inner_text() == "row 0"


def test_keyboard_alone_plays_and_moves(opened):
    page = opened()
    play, slider = page.locator(".play"), page.locator(".time")
    play.focus()
    page.keyboard.press("Enter")
    assert play.inner_text() == "Pause"
    page.keyboard.press("Enter")
    assert play.inner_text() == "Play"
    page.keyboard.press("Tab")
    assert slider.evaluate("slider => slider === document.activeElement")
    page.keyboard.press("Home")
    start = place(page, "after")
    for _ in range(40):
        page.keyboard.press("ArrowRight")
    assert slider.input_value() == "40"
    assert place(page, "after") != start
    assert slider.get_attribute("aria-valuetext") == "row 40 of row 119"
    page.keyboard.press("Space")
    assert play.inner_text() == "Pause"


def test_motion_starts_when_seen_and_ends_at_the_end(opened, playwright):
    page = opened(reduced_motion="no-preference")
    page.locator(".speed").select_option("8")
    page.locator(".player").scroll_into_view_if_needed()
    playwright.expect(page.locator(".time")).to_have_value("119", timeout=60_000)
    playwright.expect(page.locator(".play")).to_have_text("Play", timeout=60_000)
    page.locator(".speed").select_option("1")
    page.locator(".play").click()
    playwright.expect(page.locator(".time")).not_to_have_value("119")


def test_nothing_moves_by_itself_where_that_is_unwanted(opened):
    page = opened()
    page.locator(".player").scroll_into_view_if_needed()
    before = place(page, "after")
    page.wait_for_timeout(700)
    assert place(page, "after") == before
    assert page.locator(".play").inner_text() == "Play"
    assert int(page.locator(".time").input_value()) > 0  # where the difference is largest


def test_still_pictures_are_shown_without_scripts(opened):
    page = opened(java_script_enabled=False)
    assert not page.locator(".player").is_visible()
    assert page.locator(".still svg").first.is_visible()


def test_dark_pages_are_dark(opened):
    colours = [
        opened(color_scheme=scheme).evaluate("getComputedStyle(document.documentElement).backgroundColor")
        for scheme in ("light", "dark")
    ]
    assert colours == ["rgb(255, 255, 255)", "rgb(21, 24, 28)"]


def test_page_prints_as_text_with_the_still_pictures(opened):
    page = opened()
    page.emulate_media(media="print")
    assert not page.locator(".player").is_visible()
    assert page.locator(".still svg").first.is_visible()
    printed = page.pdf(prefer_css_page_size=True)
    pages = printed.count(b"/Type /Page\n")
    assert pages >= 3
    assert sum(shows_text(stream) for stream in STREAM.findall(printed)) >= pages
