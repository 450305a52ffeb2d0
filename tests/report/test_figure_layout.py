"""Figures can be read by those who see them and by those who do not, in every study that is quick to compute."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib import colormaps
from matplotlib.colors import to_hex

from tests.report.layout import unreadable
from tradestudy import figures
from tradestudy.api import Result
from tradestudy.figures.curves import beneath, spread
from tradestudy.figures.style import letters_on, line_style, readable
from tradestudy.report.pdf import template
from tradestudy.results.storage import read_finished
from tradestudy.results.views.groups import camera_titles

ROOT = Path(__file__).parents[2]
_UNITS = {"nm": 1e-9, "µm": 1e-6, "mm": 1e-3, "m": 1.0, "km": 1e3, "%": 1e-2, "ppm": 1e-6}
_NUMBER = re.compile(r"(?<![\w./])(\d+(?:\.\d+)?)[ \u00a0](nm|µm|mm|km|ppm|m|%)(?!\w)")
_STUDIES = {
    "robot": [],
    "hand_lens": ["scene.distances.points=93"],
    "stereo_design": [
        "scene.distances.points=40",
        "accuracy.tolerance=5 %",
        "sweep={stereo.baseline: {from: 10 mm, to: 200 mm, points: 4, spacing: log}, "
        "stereo.lenses.focal_length: {from: 4 mm, to: 32 mm, points: 3, spacing: log}}",
    ],
}


@pytest.fixture(scope="module", params=["synthetic", "swept", "example", *_STUDIES])
def study(
    request: pytest.FixtureRequest, make_tree: Callable[..., xr.DataTree], run_of: Callable[..., Result]
) -> xr.DataTree:
    if request.param == "synthetic":
        return make_tree()
    if request.param == "swept":
        return make_tree(sweep={"b": [0.05, 0.1, 0.2]}, declared={"b": 0.1})
    if request.param == "example":
        return read_finished(ROOT / "reports" / "examples" / "plenoptic-vs-stereo")[0]
    return run_of(request.param, *_STUDIES[request.param]).data


def test_no_text_lies_on_another_or_leaves_the_canvas(study: xr.DataTree) -> None:
    found = {name: unreadable(drawing.draw()) for name, drawing in figures.build(study).items()}
    assert not any(found.values()), found


def test_alternative_texts_name_cameras_and_numbers_of_the_results(study: xr.DataTree) -> None:
    titles, known = set(camera_titles(study).values()), _values(study)
    for name, drawing in figures.build(study).items():
        assert any(title in drawing.alt for title in titles) or name == "cost", (name, drawing.alt)
        numbers = _NUMBER.findall(drawing.alt)
        assert numbers or re.search(r"\d", drawing.alt), (name, drawing.alt)
        if name != "cost":  # whose times are rounded as durations
            strange = [f"{digits} {unit}" for digits, unit in numbers if not _is_known(digits, unit, known)]
            assert not strange, (name, strange)


def _values(tree: xr.DataTree) -> np.ndarray:
    """Every number of the results, with those of coordinates and attributes, sorted."""

    def each() -> Iterator[np.ndarray]:
        for group in tree.subtree:
            data = group.to_dataset()
            for array in (*data.data_vars.values(), *data.coords.values()):
                if array.dtype.kind in "fiu":
                    yield np.abs(np.ravel(array.values).astype(float))
            yield np.array([abs(float(one)) for one in data.attrs.values() if isinstance(one, int | float)])

    flat = np.concatenate(list(each()))
    return np.sort(flat[np.isfinite(flat)])


def _is_known(digits: str, unit: str, known: np.ndarray) -> bool:
    """Whether a number of the results rounds to these digits."""
    last = 10.0 ** -len(digits.partition(".")[2])
    value, half = float(digits) * _UNITS[unit], 0.51 * last * _UNITS[unit]
    if "." not in digits:  # at most three digits are shown
        half = max(half, 0.0051 * value)
    at = np.searchsorted(known, value - half)
    return bool(at < known.size and known[at] <= value + half)


def test_labels_keep_their_order_distance_and_bounds() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        count = int(rng.integers(1, 9))
        ideal, sizes = rng.random(count), rng.uniform(0.01, 1.0 / count, count)
        placed = spread(ideal, sizes)
        order = np.argsort(ideal)
        gaps = np.diff(placed[order]) - (sizes[order][1:] + sizes[order][:-1]) / 2.0
        assert np.all(gaps > -1e-12)
        assert np.all(placed - sizes / 2.0 > -1e-12)
        assert np.all(placed + sizes / 2.0 < 1.0 + 1e-12)
        alone = np.abs(ideal[:, None] - ideal) > (sizes[:, None] + sizes) / 2.0
        free = np.all(alone | np.eye(count, dtype=bool), axis=1)
        inside = (ideal > sizes / 2.0) & (ideal < 1.0 - sizes / 2.0)
        if np.all(free & inside):
            np.testing.assert_allclose(placed, ideal)


def test_two_labels_that_would_touch_move_apart_equally() -> None:
    np.testing.assert_allclose(spread(np.array([0.52, 0.5]), np.array([0.1, 0.1])), [0.56, 0.46])
    np.testing.assert_allclose(spread(np.array([0.99, 1.0]), np.array([0.1, 0.1])), [0.85, 0.95])
    np.testing.assert_allclose(spread(np.array([0.9, 0.1]), np.array([0.8, 0.8])), [0.9, 0.1])  # about the middle


def test_a_hidden_curve_is_distinguished_from_one_that_crosses_others() -> None:
    x = np.geomspace(0.1, 10.0, 200)
    level = np.full_like(x, 3.0)
    assert beneath([level, 1.001 * level, x, level], (1e-2, 1e2)) == [2, 1, 0, 0]
    assert beneath([level, np.full_like(x, np.nan)], (1e-2, 1e2)) == [0, 0]


@pytest.mark.parametrize("order", range(7))
def test_letters_contrast_with_their_background(order: int) -> None:
    def luminance(color: str) -> float:
        rgb = np.array([int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)])
        return float(np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4) @ (0.2126, 0.7152, 0.0722))

    color = line_style(order).color
    assert 1.05 / (luminance(readable(color)) + 0.05) > 4.4
    on = letters_on(color)
    light, dark = sorted((luminance(color), 1.0 if on == "white" else luminance(on)), reverse=True)
    assert (light + 0.05) / (dark + 0.05) > 4.0


@pytest.mark.parametrize("place", [0.0, 0.3, 0.5, 0.7, 1.0])
def test_letters_stay_on_fills_that_dark_pages_leave_as_they_are(place: float) -> None:
    style = template("report.css")
    changed = set(re.findall(r"--c([0-9a-f]{6}):", style))
    fill = to_hex(colormaps["cividis"](place))
    assert fill[1:] not in changed
    assert to_hex(letters_on(fill))[1:] not in changed


def test_what_is_black_without_saying_so_becomes_light_on_dark_pages() -> None:
    assert "fill: var(--c000000)" in next(line for line in template("report.css").splitlines() if ".plot svg {" in line)
