from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.browser.conftest import Open, Run
from tests.browser.pages import WIDTHS, grave_findings


@pytest.mark.parametrize("width", WIDTHS.values(), ids=WIDTHS)
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_pages_are_accessible(visit: Open, reports: list[Path], width: int, dark: bool) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    for report in reports:
        with visit(report, width=width, dark=dark) as seen:
            frame = seen.page.locator(".plot .scroll").first
            frame.press("Home")  # a readout is shown
            assert grave_findings(axe, seen.page) == {}, report


def test_a_phone_scrolls_one_way(visit: Open, reports: list[Path]) -> None:
    for report in reports:
        with visit(report, width=390) as seen:
            assert seen.page.evaluate("document.documentElement.scrollWidth") <= 390, report


def test_without_script_the_page_is_complete(visit: Open, headline: Run) -> None:
    with visit(headline.report, script=False) as seen:
        figures = seen.page.locator(".plot svg")
        assert figures.count() >= 5
        assert all(one.is_visible() for one in figures.all())
        assert seen.page.locator("button").count() == 0


def test_print_shows_no_controls_and_light_figures(visit: Open, headline: Run) -> None:
    with visit(headline.report, dark=True) as seen:
        seen.page.emulate_media(media="print")
        assert not any(one.is_visible() for one in seen.page.locator("button:not(.sort), input, summary").all())
        ground = "getComputedStyle(document.querySelector('.plot .frame')).backgroundColor"
        assert seen.page.evaluate(ground) == "rgb(255, 255, 255)"


def test_dark_figures_are_light_on_dark(visit: Open, headline: Run) -> None:
    with visit(headline.report, dark=True) as seen:
        assert _luminance(seen.page, "document.querySelector('.plot .frame')", "backgroundColor") < 60
        letters = 'document.querySelector(\'#whole_range [id*="ytick_1"] [id*="text_"] g\')'
        assert _luminance(seen.page, letters, "fill") > 180


def _luminance(page: Any, element: str, name: str) -> float:
    color = page.evaluate(f"getComputedStyle({element}).{name}")
    return sum(float(one) for one in color[4:-1].split(",")) / 3.0


def test_the_contents_follow_the_reader(visit: Open, headline: Run) -> None:
    with visit(headline.report) as seen:
        current = seen.page.locator("nav [aria-current]")
        assert current.get_attribute("href") == "#answer"
        seen.page.evaluate("document.getElementById('claims').scrollIntoView()")
        seen.page.wait_for_function("document.querySelector('nav [aria-current]').hash === '#claims'")
        assert current.count() == 1


def test_tables_sort_filter_and_copy(visit: Open, headline: Run) -> None:
    with visit(headline.report) as seen:
        page = seen.page
        page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        figure = page.locator("#usable-range-table")
        head = figure.locator("thead th").nth(1)
        for direction, falling in (("ascending", False), ("descending", True)):
            head.locator("button").press("Enter")
            assert head.get_attribute("aria-sort") == direction
            texts = [row.locator("td").nth(1).inner_text() for row in figure.locator("tbody tr").all()]
            numbers = [float(one.split()[0]) for one in texts if one[0].isdigit()]
            assert numbers == sorted(numbers, reverse=falling)
            assert len(set(numbers)) > 2
        figure.locator("button", has_text="Copy").click()
        page.wait_for_function(
            "document.querySelector('#usable-range-table .table-tools button').textContent !== 'Copy'"
        )
        lines = page.evaluate("navigator.clipboard.readText()").splitlines()
        assert lines[0].split("\t")[:2] == ["Camera", "From"]
        assert len(lines) == 1 + len(texts)
        register = page.locator("#assumption-register")
        rows = register.locator("tbody tr:visible")
        every = rows.count()
        register.locator("input[type=search]").fill("yaw")
        assert 0 < register.locator("tbody tr:visible:not(:has(th.group))").count() < every


def test_tab_reaches_every_figure_in_order(visit: Open, headline: Run) -> None:
    """Everything that can be focused stands in the order of the page, and says what it is."""
    with visit(headline.report) as seen:
        indices = seen.page.evaluate("[...document.querySelectorAll('[tabindex]')].map((one) => one.tabIndex)")
        assert set(indices) == {0}
        frames = seen.page.locator(".plot .scroll[tabindex]")
        assert frames.count() >= 5
        assert all(one.get_attribute("aria-label") for one in frames.all())


# Blocks wider than they are shown that a keyboard does not reach or that have no name, and whatever is cut elsewhere.
_UNREACHABLE = """() => {
  const every = [...document.querySelectorAll("main *")];
  const scrolls = (one) => one.clientWidth && one.scrollWidth > one.clientWidth + 1 &&
    getComputedStyle(one).overflowX !== "visible";
  const isCut = (one) => one.getBoundingClientRect().right > innerWidth + 1 && !one.closest(".scroll, .equation");
  return every.filter((one) => isCut(one) ||
    (scrolls(one) && (one.tabIndex !== 0 || !one.getAttribute("aria-label") || !one.getAttribute("role"))))
    .map((one) => one.outerHTML.slice(0, 100));
}"""


def test_on_a_phone_everything_wide_scrolls_in_a_block_that_keys_reach(visit: Open, reports: list[Path]) -> None:
    for report in reports:
        with visit(report, width=390) as seen:
            assert seen.page.evaluate(_UNREACHABLE) == [], report


# Size of the smallest letters of all figures [px]: their outlines are drawn at a hundredth of it. Letters that are cut.
_SMALLEST = """() => {
  const sizes = [...document.querySelectorAll('.plot svg [id*="-text_"] > g[transform*="scale"]')]
    .map((one) => one.getScreenCTM()).map(({ a, b }) => 100 * Math.hypot(a, b));
  return Math.min(...sizes);
}"""
_CUT_LETTERS = """() => [...document.querySelectorAll('.plot svg [id*="-text_"]')].filter((one) => {
  const box = one.getBoundingClientRect(), figure = one.ownerSVGElement.getBoundingClientRect();
  return box.width && (box.left < figure.left - 1 || box.right > figure.right + 1);
}).map((one) => one.id)"""


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_figures_on_a_phone_are_legible_and_scroll_to_their_ends(visit: Open, reports: list[Path], dark: bool) -> None:
    for report in reports:
        with visit(report, width=390, dark=dark) as seen:
            for figure in seen.page.locator(".plot svg").all():
                box = figure.bounding_box()
                frame = figure.locator("xpath=..")
                assert box["x"] >= 0.0, report
                shown = frame.evaluate("one => { one.scrollLeft = 1e4; return one.getBoundingClientRect().right; }")
                assert 380.0 <= shown <= 390.0, report
                box = figure.bounding_box()
                assert box["x"] + box["width"] == pytest.approx(shown, abs=2.0), report
            assert seen.page.evaluate(_CUT_LETTERS) == [], report
            assert seen.page.evaluate(_SMALLEST) >= 9.0, report


def test_keys_read_a_figure_on_a_phone(visit: Open, headline: Run) -> None:
    with visit(headline.report, width=390) as seen:
        frame = seen.page.locator("#whole_range .frame > .scroll")
        for key in ("End", "Home"):
            frame.press(key)
            line, box = seen.page.locator("#whole_range .cursor line").first.bounding_box(), frame.bounding_box()
            assert box["x"] <= line["x"] <= box["x"] + box["width"] <= 390.0
