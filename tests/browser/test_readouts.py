"""A tap keeps the readout; it also says where a camera is not usable, and what a map shows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.browser.conftest import Open, Run
from tests.browser.test_figures import known, over, reported
from tradestudy.figures.sweeps import reference_distance, shown_value
from tradestudy.results.storage import read_finished
from tradestudy.results.views.depth import where_measured
from tradestudy.results.views.groups import camera_titles
from tradestudy.units import LENGTH, pretty
from tradestudy.wording import limit_words


def tap(page: Any, figure: str, across: float, up: float, *, touch: bool) -> None:
    """Tap or click at shares of what is in view of a figure."""
    over(page, figure, across, up)
    box = page.locator(f"#{figure} .frame > .scroll").bounding_box()
    place = box["x"] + across * box["width"], box["y"] + up * box["height"]
    page.touchscreen.tap(*place) if touch else page.mouse.click(*place)


@pytest.mark.parametrize("touch", [False, True], ids=["mouse", "touch"])
def test_a_tap_keeps_the_readout_until_another(visit: Open, headline: Run, touch: bool) -> None:
    with visit(headline.report, touch=touch, width=390 if touch else 1280) as seen:
        page, readout = seen.page, seen.page.locator("#whole_range .readout")
        tap(page, "whole_range", 0.5, 0.3, touch=touch)
        first = reported(page, "whole_range")
        over(page, "close_range", 0.5, 0.3)
        page.mouse.move(2, 2)
        assert reported(page, "whole_range") == first
        assert readout.is_visible()
        tap(page, "whole_range", 0.7, 0.3, touch=touch)
        assert reported(page, "whole_range")[0] != first[0]
        tap(page, "close_range", 0.5, 0.3, touch=touch)
        assert not readout.is_visible()
        assert page.locator("#close_range .readout").is_visible()
        page.keyboard.press("Escape")
        assert page.locator(".readout.shown").count() == 0
        assert page.locator(".cursor line").count() == 0


def test_a_tap_beside_the_figures_removes_the_readout(visit: Open, headline: Run) -> None:
    with visit(headline.report, touch=True) as seen:
        tap(seen.page, "whole_range", 0.5, 0.3, touch=True)
        assert seen.page.locator(".readout.shown").count() == 1
        seen.page.locator("h2").first.tap()
        assert seen.page.locator(".readout.shown").count() == 0


def test_a_kept_readout_follows_switches_and_sliders(visit: Open, sweep: Run) -> None:
    depth, titles = where_measured(sweep.tree["depth"].to_dataset()), camera_titles(sweep.tree)
    with visit(sweep.report) as seen:
        page = seen.page
        tap(page, "whole_range", 0.5, 0.3, touch=False)
        sliders = page.locator("#designs input")
        for number in range(sliders.count()):
            sliders.nth(number).focus()
            sliders.nth(number).press("Home")
        first = {name: 0 for name in depth["depth_uncertainty"].dims if name not in ("camera", "distance")}
        values = reported(page, "whole_range")[1]
        assert any(values == known(depth.isel(first), titles, place) for place in range(depth.sizes["distance"]))
        page.locator("#whole_range button.switch").first.press("Enter")
        assert len(reported(page, "whole_range")[1]) == len(values) - 1


def test_the_readout_says_why_a_camera_is_not_usable(visit: Open, headline: Run, sweep: Run) -> None:
    """Against the limits of the results, as declared and with the sliders at their first values."""
    for run in (headline, sweep):
        depth, titles = run.tree["depth"].to_dataset(), camera_titles(run.tree)
        first = {name: 0 for name in depth["depth_uncertainty"].dims if name not in ("camera", "distance")}
        with visit(run.report) as seen:
            page, frame = seen.page, seen.page.locator("#whole_range .frame > .scroll")
            for slider in page.locator("#designs input").all():
                slider.press("Home")
            frame.focus()
            frame.press("Home")
            for place in range(0, depth.sizes["distance"], 10):
                at = depth.isel(distance=place, **first)
                for key in map(str, depth["camera"].values):
                    row = page.locator(f'#whole_range .readout .row[data-label="{titles[key]}"]')
                    said = [text.strip() for text in row.locator(".unusable").all_inner_texts()]
                    one = at.sel(camera=key)
                    assert bool(said) == (not one["usable"].item())
                    broken = [limit_words(str(k)) for k in one["limit"].values[one["limit_met"].values == 0]]
                    assert all(words in said[0] for words in broken)
                    assert not said or said[0].startswith("not usable: ")
                frame.press("ArrowUp")


def _ends(page: Any, figure: str, panel: int) -> list[float]:
    """Where a panel lies in the window: left, top, right, bottom."""
    page.locator(f"#{figure} svg").scroll_into_view_if_needed()
    return page.evaluate(
        f"""() => {{
          const box = JSON.parse(document.getElementById("page-data").textContent).figures["{figure}"][{panel}].box;
          const to = document.querySelector("#{figure} svg").getScreenCTM();
          return [0, 2].flatMap((k) => {{
            const at = new DOMPoint(box[k], box[k + 1]).matrixTransform(to);
            return [at.x, at.y];
          }});
        }}"""
    )


def test_a_map_of_a_sweep_reads_every_cell(visit: Open, sweep: Run) -> None:
    depth = sweep.tree["depth"].to_dataset()
    place = depth["distance"].values[
        np.argmin(np.abs(np.log(depth["distance"].values / reference_distance(sweep.tree))))
    ]
    values = depth["depth_uncertainty"].sel(camera="stereo", distance=place)
    across, up = sorted((name for name in values.dims), key=lambda name: -values.sizes[name])
    values = values.transpose(up, across)
    with visit(sweep.report) as seen:
        left, top, right, bottom = _ends(seen.page, "sweep_map", 0)
        rows, columns = values.shape
        for row, column in [(0, 0), (rows - 1, 0), (3, 7), (rows - 1, columns - 1), (0, columns - 1)]:
            seen.page.mouse.move(
                left + (right - left) * (column + 0.5) / columns, bottom - (bottom - top) * (row + 0.5) / rows
            )
            value = float(values[row, column])
            where, said = reported(seen.page, "sweep_map")
            assert list(said.values()) == [pretty(value, LENGTH) if np.isfinite(value) else "—"]
            assert all(
                shown_value(values[name], values[name].values[k]) in where for name, k in ((up, row), (across, column))
            )


@pytest.mark.parametrize("zoomed", [False, True], ids=["whole", "zoomed"])
def test_a_map_over_the_picture_reads_the_uncertainty(visit: Open, reports: list[Path], zoomed: bool) -> None:
    report = next(one for one in reports if "real_rig" in one.parent.name)
    maps = read_finished(report.parent)[0]["depth_map"].to_dataset().isel(camera=0)
    with visit(report) as seen:
        page, (rows, columns) = seen.page, (maps.sizes["down"], maps.sizes["across"])
        for panel in range(maps.sizes["distance"]):
            left, top, right, bottom = _ends(page, "depth-map-webcams", panel)
            if zoomed and panel == 0:  # to the lower right quarter, of all panels
                page.mouse.move((left + right) / 2, (top + bottom) / 2)
                page.mouse.down()
                page.mouse.move(right, bottom)
                page.mouse.up()
            for across, down in [(0.545, 0.55), (0.9, 0.9), (0.1, 0.23)]:
                page.mouse.move(left + (right - left) * across, top + (bottom - top) * down)
                x, y = (0.5 + across / 2, 0.5 + down / 2) if zoomed else (across, down)
                value = float(maps["depth_uncertainty"][panel, int(y * rows), int(x * columns)])
                said = reported(page, "depth-map-webcams")[1]
                assert said == {"depth uncertainty": pretty(value, LENGTH) if np.isfinite(value) else "—"}


def test_keys_walk_over_a_map(visit: Open, reports: list[Path]) -> None:
    report = next(one for one in reports if "real_rig" in one.parent.name)
    maps = read_finished(report.parent)[0]["depth_map"].to_dataset().isel(camera=0)
    with visit(report) as seen:
        frame = seen.page.locator("#depth-map-webcams .frame > .scroll")
        frame.focus()
        for key in ["PageDown", "ArrowDown", "ArrowDown", "End", "ArrowLeft", "ArrowLeft"]:
            frame.press(key)
        value = float(maps["depth_uncertainty"][1, 2, maps.sizes["across"] - 3])
        assert list(reported(seen.page, "depth-map-webcams")[1].values()) == [pretty(value, LENGTH)]
