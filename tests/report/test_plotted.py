from __future__ import annotations

import json

import numpy as np
import pytest

from tradestudy.figures.drawing import Curve
from tradestudy.figures.plotted import plotted
from tradestudy.figures.style import distance_axis, length_tick, log_axis, new_figure, styled
from tradestudy.report.page_data import page_data


def numbers(raw: bytes) -> list[float]:
    return np.frombuffer(raw).tolist()


@pytest.fixture(scope="module")
def curves() -> dict[str, Curve]:
    with styled():
        figure = new_figure(2.0)
        left, right = figure.subplots(1, 2, sharex=True)
        left.plot([0.01, 0.05], [1.0, 2.0], label="a", gid="depth_uncertainty/a")
        left.fill_between([0.01, 0.02, 0.05], [1.0, 2.0, 3.0], [4.0, 5.0, 6.0], label="b")
        left.plot([0.01, 0.05], [3.0, 4.0])  # named by nobody
        right.hist([0.02, 0.03], bins=2, histtype="stepfilled")  # nor is this
        right.errorbar([0.02], [0.5], yerr=[0.1], fmt="o", label="c")
        log_axis(left, "y", tick=length_tick)
        distance_axis(left, (0.01, 0.05))
        left.set_xlabel("distance [mm]")
        right.set_yticks([0.0, 0.5, 1.0], ["0", "50 %", "100 %"])
        drawn = plotted(figure)
    first, second = drawn.panels
    assert (first.x.label, first.x.unit, first.x.factor, first.x.kind) == ("distance", "mm", 1e3, "log")
    assert (first.y.unit, first.y.factor) == ("mm", 1.0)
    assert (second.y.unit, second.y.factor, second.y.names) == ("%", 100.0, {})
    for panel in drawn.panels:
        assert f'id="{panel.id}"'.encode() in drawn.svg
        assert 0.0 <= panel.box[0] < panel.box[2] <= 490.0
    return {f"{one.label}, {one.kind}": one for panel in drawn.panels for one in panel.curves}


def test_named_artists_are_read_with_their_data(curves: dict[str, Curve]) -> None:
    assert set(curves) == {"a, line", "b, band", "c, points", "c, band"}
    line, band = curves["a, line"], curves["b, band"]
    assert line.name == "depth_uncertainty/a"
    assert (numbers(line.x), numbers(line.y)) == ([0.01, 0.05], [1.0, 2.0])
    assert (numbers(band.x), numbers(band.y), numbers(band.top)) == ([0.01, 0.02, 0.05], [1, 2, 3], [4, 5, 6])


def test_error_bars_are_the_band_of_their_marks(curves: dict[str, Curve]) -> None:
    bars = curves["c, band"]
    assert numbers(curves["c, points"].y) == [0.5]
    assert [*numbers(bars.y), *numbers(bars.top)] == pytest.approx([0.4, 0.6])


def test_only_texts_at_data_move_with_them() -> None:
    """On an axis from 0 to 1, data and shares of the panel are the same numbers."""
    with styled():
        figure = new_figure(2.0)
        axes = figure.subplots()
        axes.text(0.2, 0.2, "at data")
        axes.text(0.5, 0.5, "in the panel", transform=axes.transAxes)
        drawn = plotted(figure)
    (anchor,) = json.loads(page_data({"figure": drawn}, {}))["figures"]["figure"][0]["anchors"]
    assert anchor[1:] == [True, True]


@pytest.mark.parametrize("origin", ["mesh", "upper", "lower"])
def test_a_named_map_is_read_cell_by_cell(origin: str) -> None:
    """A value is found again at the place where its colour was drawn: column 1 of row 0, at the bottom or the top."""
    values = np.array([[1.0, 2.0, 3.0], [4.0, np.nan, 6.0]])
    with styled():
        figure = new_figure(2.0)
        axes = figure.subplots()
        if origin == "mesh":
            axes.pcolormesh(np.ma.masked_invalid(values), label="uncertainty [mm]")
            axes.set_xticks([0.5, 1.5, 2.5], ["10", "13", "100"])
            figure.supxlabel("baseline [mm]")
        else:
            axes.imshow(values, origin=origin, label="uncertainty [mm]")  # type: ignore[arg-type]  # of two
        (panel,) = plotted(figure).panels
    (shown,) = panel.curves
    assert (shown.kind, shown.label, shown.unit) == ("map", "uncertainty", "mm")
    start = 0.0 if origin == "mesh" else -0.5
    assert numbers(shown.x) == [start, start + 1, start + 2, start + 3]
    assert numbers(shown.y) == [start, start + 1, start + 2]
    assert np.array_equal(np.reshape(numbers(shown.top), (2, 3)), values, equal_nan=True)
    assert (panel.y.low > panel.y.high) == (origin == "upper")
    if origin == "mesh":
        assert (panel.x.label, panel.x.unit, panel.x.names) == (
            "baseline",
            "mm",
            {"0.5": "10", "1.5": "13", "2.5": "100"},
        )
