from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from tests.browser.conftest import Open, Run
from tradestudy.results import judged_uncertainty
from tradestudy.results.views.depth import where_measured
from tradestudy.results.views.groups import camera_titles
from tradestudy.units import LENGTH, pretty
from tradestudy.wording import distance


def reported(page: Any, figure: str) -> tuple[str, dict[str, str]]:
    """What a readout says: where, and the value of each label."""
    rows = page.locator(f"#{figure} .readout .row")
    values = {one.get_attribute("data-label"): one.locator("b").inner_text() for one in rows.all()}
    return page.locator(f"#{figure} .readout .at").inner_text().replace("\u00a0", " "), values


def known(depth: xr.Dataset, titles: dict[str, str], place: int) -> dict[str, str]:
    values = judged_uncertainty(depth).isel(distance=place)
    return {titles[str(key)]: pretty(float(values.sel(camera=key)), LENGTH) for key in depth["camera"].values}


def over(page: Any, figure: str, across: float, up: float) -> None:
    """Put the mouse at shares of a figure."""
    svg = page.locator(f"#{figure} svg")
    svg.scroll_into_view_if_needed()
    box = svg.bounding_box()
    page.mouse.move(box["x"] + across * box["width"], box["y"] + up * box["height"])


def test_keys_read_the_values_of_the_results(visit: Open, headline: Run) -> None:
    depth, titles = where_measured(headline.tree["depth"].to_dataset()), camera_titles(headline.tree)
    distances = depth["distance"].values
    with visit(headline.report) as seen:
        frame = seen.page.locator("#whole_range .frame > .scroll")
        frame.focus()
        for place in range(0, len(distances), 7):
            frame.press("Home")
            for _ in range(place // 10):
                frame.press("ArrowUp")
            for _ in range(place % 10):
                frame.press("ArrowRight")
            where, values = reported(seen.page, "whole_range")
            assert where.endswith(distance(float(distances[place])).replace("\u00a0", " "))
            assert values == known(depth, titles, place)
        frame.press("Escape")
        assert not seen.page.locator("#whole_range .readout").is_visible()


def test_the_cursor_reads_the_values_and_is_linked(visit: Open, headline: Run) -> None:
    depth, titles = where_measured(headline.tree["depth"].to_dataset()), camera_titles(headline.tree)
    with visit(headline.report) as seen:
        for across in (0.2, 0.3, 0.42, 0.55, 0.7):
            over(seen.page, "whole_range", across, 0.3)
            where, values = reported(seen.page, "whole_range")
            places = [
                k
                for k, z in enumerate(depth["distance"].values)
                if where.endswith(distance(float(z)).replace("\u00a0", " "))
            ]
            assert any(values == known(depth, titles, place) for place in places)
        figures = seen.page.locator(".plot").filter(has=seen.page.locator(".cursor line"))
        assert figures.count() >= 2
        assert seen.page.locator("#mid_range .cursor circle").count() >= 2
        intervals = seen.page.locator("#whole_range .readout .interval").all_inner_texts()
        assert all("%: " in one and " to " in one for one in intervals if one)


def test_a_switch_hides_a_camera_in_every_figure(visit: Open, headline: Run) -> None:
    title = next(iter(camera_titles(headline.tree).values()))
    with visit(headline.report) as seen:
        switches = seen.page.locator(f'button.switch[data-label="{title}"]')
        assert switches.count() >= 3
        switches.first.focus()
        switches.first.press("Enter")
        assert {one.get_attribute("aria-pressed") for one in switches.all()} == {"false"}
        over(seen.page, "close_range", 0.3, 0.3)
        assert title not in reported(seen.page, "close_range")[1]
        switches.nth(1).click()
        over(seen.page, "close_range", 0.3, 0.3)
        assert title in reported(seen.page, "close_range")[1]


@pytest.mark.parametrize("figure", ["whole_range", "close_range", "variance_shares", "readings"])
def test_zoom_moves_the_figure_and_reset_puts_it_back(visit: Open, headline: Run, sweep: Run, figure: str) -> None:
    report = (sweep if figure == "variance_shares" else headline).report
    outlines = f"[...document.querySelectorAll('#{figure} svg path')].map((one) => one.getAttribute('d') ?? '')"
    with visit(report) as seen:
        page = seen.page
        before = _numbers(page.evaluate(outlines))
        over(page, figure, 0.3, 0.2)
        page.mouse.down()
        over(page, figure, 0.4, 0.5)
        page.mouse.up()
        assert page.locator(f"#{figure} .ticks text").count() >= 2
        assert not np.allclose(_numbers(page.evaluate(outlines)), before, atol=1.0)
        page.locator(f"#{figure} .tools button", has_text="Reset").click()
        assert page.locator(f"#{figure} .ticks").count() == 0
        assert np.allclose(_numbers(page.evaluate(outlines)), before, atol=0.011)


def _numbers(outlines: list[str]) -> np.ndarray:
    return np.fromstring(
        " ".join("".join(c if c in "0123456789.- " else " " for c in one) for one in outlines), sep=" "
    )


def test_a_table_below_the_figure_has_its_values(visit: Open, headline: Run) -> None:
    depth = headline.tree["depth"].to_dataset()
    with visit(headline.report) as seen:
        details = seen.page.locator("#whole_range details")
        details.locator("summary").press("Enter")
        table = details.locator("table").first
        cells = table.locator("tbody tr").nth(200).locator("th, td").all_inner_texts()
        values = depth["depth_uncertainty"].isel(distance=200)
        assert cells == [
            distance(float(depth["distance"].values[200])).replace("\u00a0", " "),
            *(pretty(float(values.sel(camera=key)), LENGTH) for key in depth["camera"].values),
        ]
