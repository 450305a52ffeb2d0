"""Where two microlenses see every point, against rays through the pupil counted lens by lens."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cameras.builders import r5
from tradestudy import load
from tradestudy.cameras.focus import BlurCriterion
from tradestudy.cameras.focused_plenoptic.design import FocusedPlenoptic
from tradestudy.units import LENGTH, parse

CASES = Path(__file__).parents[1] / "data" / "coverage-of-other-relay"


def fewest_lenses(camera: Any, distance: float) -> int:
    """The smallest number of hexagonal cells that rays from the pupil through the image of a point reach."""
    f, z, p = camera.main_lens.focal_length, camera.mla_distance, camera.microlenses.pitch
    b = 1.0 / (1.0 / f - 1.0 / distance)
    rng = np.random.default_rng(1)
    angle = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    rim = camera.main_lens.pupil_diameter / 2.0 * np.stack([np.cos(angle), np.sin(angle)])
    on_array = rim * (1.0 - z / b)  # of a point on the axis; the lattice is shifted instead of the point
    reach = float(np.abs(on_array).max())
    size = int(reach / p) + 3
    i, j = np.meshgrid(np.arange(-2 * size, 2 * size + 1), np.arange(-2 * size, 2 * size + 1))
    lattice = p * np.stack([i + 0.5 * j, np.sqrt(0.75) * j]).reshape(2, -1)
    shifts = p * np.array([[1.0, 0.5], [0.0, np.sqrt(0.75)]]) @ rng.random((2, 3000))
    lattice = lattice[:, np.hypot(*lattice) <= reach + 3.0 * p]  # no shift is longer than two pitches
    x, y = lattice[:, None, :] - shifts[:, :, None]
    return int((x * x + y * y <= reach**2).sum(axis=1).min())


@pytest.mark.parametrize("name", ["mini40.0", "mini40.2"])
def test_the_microlenses_focal_length_does_not_decide_what_they_see(name: str) -> None:
    camera = load(CASES / f"{name}.yaml").prepared.case.cameras["c"]
    assert isinstance(camera, FocusedPlenoptic)
    rows = dict(camera.properties())
    (covered,) = (value for key, value in rows.items() if "see every point" in key)
    assert covered == "everywhere"
    assert all(fewest_lenses(camera, distance) >= 2 for distance in (0.05, 0.3, 5.0, 1e6))
    assert rows["total covering plane, where |virtual depth| is 2"] == "none"
    assert abs(float(camera.virtual_depth(np.inf))) == pytest.approx(3.39, abs=0.01)
    # Both are as sharp: nowhere is the blur more than 4.3 px.
    assert float(camera.blur_px(np.array([np.inf])).max()) < 6.0
    sharp = camera.focus.sharp_range(BlurCriterion(blur_px=6.0, measure="none", wavelength=550e-9)).slices
    assert (sharp.near[0], sharp.far[0]) == (pytest.approx(camera.main_lens.focal_length), np.inf)


def test_both_sides_of_the_array_are_covered_up_to_and_from_the_stated_distances() -> None:
    camera = r5()
    (covered,) = (str(value) for key, value in camera.properties() if "see every point" in key)
    near, far = (parse(one, LENGTH) for one in re.findall(r"[\d.]+ mm", covered))
    assert covered.startswith("up to ")
    assert " and from " in covered
    assert 0.0 < near < far
    for distance in (near * 0.98, far * 1.02):
        assert fewest_lenses(camera, distance) >= 2
    for distance in (near * 1.02, far * 0.98):
        assert fewest_lenses(camera, distance) < 2
