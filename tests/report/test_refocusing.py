"""The report of refocusing: the finding on page one, one figure of all planes, and one table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tradestudy
from tradestudy import figures
from tradestudy.report.document import Table, plain_text
from tradestudy.report.sections.refocusing import describe_refocusing
from tradestudy.results.views.headline import answers

CAMERAS = Path(__file__).parents[2] / "studies" / "cameras"


@pytest.fixture(scope="module")
def result() -> tradestudy.Result:
    camera = {"from": str(CAMERAS / "r5-unfocused.yaml")}
    lens = {"principal_separation": -2e-3, "exit_pupil": -30e-3}
    return tradestudy.Study.from_dict(
        {
            "cameras": {"thin": {**camera, "title": "Thin"}, "thick": {**camera, "title": "Thick", "main_lens": lens}},
            "scene": {"distances": [0.02, 0.1, 0.25], "wavelength": 550e-9},
            "refocusing": {},
        }
    ).run()


def test_the_answer_says_range_planes_and_both_depths_of_field(result: tradestudy.Result) -> None:
    assert (
        "The Thin can be refocused from 16.7 mm to ∞, on 21 distinct planes; refocused on 0.15 m, its depth of field "
        "is 155 mm by blur of 1 px and 164 mm by rays."
    ) in answers(result.data)


def test_one_figure_and_one_table_have_every_plane(result: tradestudy.Result) -> None:
    drawing = figures.build(result.data)["refocusing"]
    assert drawing.caption.startswith("The Thin can be refocused")
    data = result.data["refocusing"].to_dataset()
    for title, key, panel in zip(("Thin", "Thick"), ("thin", "thick"), drawing.draw().axes, strict=True):
        (dots,) = panel.lines
        assert dots.get_label() == title
        known = data.sel(camera=key)["refocused_distance"].values
        drawn = np.sort(np.asarray(dots.get_ydata(), dtype=np.float64))
        np.testing.assert_allclose(drawn[np.isfinite(drawn)], np.sort(known[np.isfinite(known)]))
    (table,) = [one for one in describe_refocusing(result.data, {}) if isinstance(one, Table)]
    rows = [[plain_text(cell) for cell in row] for row in table.rows]
    assert sum(len(row) > 1 for row in rows) == int(data["planes"].sum())
    assert "baselines of pairs of views 174 µm (1 px apart)" in rows[0][0].replace("\N{NO-BREAK SPACE}", " ")
    assert [row[0] for row in rows].count("0") == 2
