from __future__ import annotations

from typing import Any

import pytest

from tests.browser.conftest import Open, Run
from tests.browser.test_figures import known, reported
from tradestudy.report.document import plain_text
from tradestudy.report.sections.answer import describe_design
from tradestudy.results.views.decision import (
    best_cameras_of_designs,
    design_places,
    requirements_of_designs,
    shown_place,
)
from tradestudy.results.views.depth import where_measured
from tradestudy.results.views.designs import value_words
from tradestudy.results.views.groups import camera_titles
from tradestudy.results.views.requirement_conclusions import conclusions_of_design

OUTLINES = "[...document.querySelectorAll('.plot svg path')].map((one) => one.getAttribute('d') ?? '')"


@pytest.mark.parametrize("steps", [(0, 0), (12, 9), (10, 0), (3, 7)])
def test_sliders_change_figures_answers_and_requirements(visit: Open, sweep: Run, steps: tuple[int, int]) -> None:
    depth, titles = where_measured(sweep.tree["depth"].to_dataset()), camera_titles(sweep.tree)
    place = dict(zip(shown_place(sweep.tree), steps, strict=True))
    with visit(sweep.report) as seen:
        page = seen.page
        before = page.evaluate(OUTLINES)
        answers = {
            name: page.locator(f"#{name}").inner_html()
            for name in ("answer-cameras", "answer-requirements", "requirement-table")
        }
        sliders = page.locator("#designs input")
        for number, step in enumerate(steps):
            _move(sliders.nth(number), step)
        for output, (path, step) in zip(page.locator("#designs output").all(), place.items(), strict=True):
            assert output.inner_text() == value_words(depth[path], depth[path].values[step])
        _says_what_the_results_say(page, sweep.tree, place)
        frame = page.locator("#whole_range .frame > .scroll")
        frame.focus()
        for number, key in ((0, "Home"), (depth.sizes["distance"] - 1, "End")):
            frame.press(key)
            assert reported(page, "whole_range")[1] == known(depth.isel(place), titles, number)
        frame.press("Escape")
        page.locator("#designs button").click()
        assert {name: page.locator(f"#{name}").inner_html() for name in answers} == answers
        assert page.evaluate(OUTLINES) == before


def _move(slider: Any, step: int) -> None:
    slider.focus()
    slider.press("Home")
    for _ in range(step):
        slider.press("ArrowRight")


def _says_what_the_results_say(page: Any, tree: Any, place: dict[str, int]) -> None:
    number = list(design_places(tree)).index(place)
    best, rows = best_cameras_of_designs(tree)[number], requirements_of_designs(tree)[number]
    for callout in describe_design(best, conclusions_of_design(rows, camera_titles(tree)), "x"):
        items = [plain_text(one) for block in callout.blocks for one in block.items]  # type: ignore[union-attr]
        shown = page.locator(f"#{callout.name} li").all_inner_texts()
        assert [one.replace("\u00a0", " ") for one in shown] == items
    met = {1: "yes", 0: "no", -1: "cannot be decided"}
    cells = [row.locator("td").nth(2).inner_text() for row in page.locator("#requirement-table tbody tr").all()]
    expected = [met[int(one)] for one in tree["requirements"].to_dataset()["design_met"].isel(place).values]
    assert [one.split("\n")[0].split(",")[0] for one in cells] == expected


def test_the_usable_bars_end_where_the_design_does(visit: Open, sweep: Run) -> None:
    """Bars of the figure, read back from its outlines, against the ends in the results."""
    place = dict(zip(shown_place(sweep.tree), (11, 2), strict=True))
    depth = sweep.tree["depth"].to_dataset().isel(place)
    with visit(sweep.report) as seen:
        page = seen.page
        for number, step in enumerate(place.values()):
            _move(page.locator("#designs input").nth(number), step)
        ends = page.evaluate(
            """() => {
              const data = JSON.parse(document.getElementById("page-data").textContent);
              const isBar = (curve) => curve.name === "usable/stereo" && curve.kind === "shape";
              const panel = data.figures.whole_range.find((one) => one.curves.some(isBar));
              const bar = panel.curves.find(isBar);
              const d = document.getElementById(bar.id).querySelector("path").getAttribute("d");
              const x = [...d.matchAll(/(-?[0-9.]+) -?[0-9.]+/g)].map((found) => +found[1]);
              const share = (place) => (place - panel.box[0]) / (panel.box[2] - panel.box[0]);
              const low = Math.log(panel.x.low), high = Math.log(panel.x.high);
              return [Math.min(...x), Math.max(...x)].map((one) => Math.exp(low + share(one) * (high - low)));
            }"""
        )
        near, far = (float(depth[f"usable_{end}"].sel(camera="stereo").values[0]) for end in ("near", "far"))
        assert ends == pytest.approx([near, min(far, float(depth["distance"].values[-1]))], rel=2e-3)
