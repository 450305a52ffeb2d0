"""Expansion against the exact models: a length that has grown by so much, read with the calibration of before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.cameras.builders import r5, stereo
from tradestudy.cameras.depth_camera import ErrorSource
from tradestudy.errors import OutOfRangeError

DISTANCE = np.array([0.1, 0.15, 0.3, 1.0])
EXPANSION = 2e-5


@pytest.mark.parametrize(("camera", "length"), [(r5(), "mla_distance"), (stereo(), "baseline")])
def test_the_part_is_the_slope_of_the_exact_depth(camera, length: str) -> None:
    warm = replace(camera, expansion=EXPANSION)
    (part,) = (p for p in warm.depth_error_parts(DISTANCE) if p.name == "temperature")
    change = EXPANSION * getattr(camera, length)
    plus, minus = (warm.depth_with_errors(DISTANCE, {length: sign * change}) for sign in (1.0, -1.0))
    d = warm.disparity(DISTANCE)
    far = warm.depth_of_disparity(d - part.disparity_error, DISTANCE)
    near = warm.depth_of_disparity(d + part.disparity_error, DISTANCE)
    np.testing.assert_allclose(np.abs(plus - minus), far - near, rtol=2e-3)
    assert part.error_class == "per rig"


def test_a_warm_rig_is_a_rig_with_that_error_of_its_baseline() -> None:
    """δZ/Z = δB/B: the one case with a closed form that everybody knows."""
    warm = replace(stereo(), expansion=EXPANSION)
    moved = warm.depth_with_errors(DISTANCE, {"baseline": EXPANSION * warm.baseline})
    np.testing.assert_allclose(moved / DISTANCE - 1.0, EXPANSION, rtol=1e-9)
    cold = replace(
        stereo(),
        calibration=replace(
            warm.calibration, baseline=ErrorSource(standard_deviation=EXPANSION * warm.baseline, shape="normal")
        ),
    )
    of = {p.name: p.disparity_error for p in cold.depth_error_parts(DISTANCE)}
    warm_parts = {p.name: p.disparity_error for p in warm.depth_error_parts(DISTANCE)}
    np.testing.assert_allclose(warm_parts["temperature"], of["baseline"], rtol=1e-12)


@pytest.mark.parametrize("expansion", [-1e-6, 1.0, float("nan")])
def test_an_impossible_expansion_is_refused(expansion: float) -> None:
    with pytest.raises(OutOfRangeError, match="relative expansion with temperature"):
        replace(stereo(), expansion=expansion)
