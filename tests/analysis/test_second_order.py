"""Second order against many draws, which share nothing with it, and against normal errors in closed form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.campaigns.depth_cases import KINDS, base_study
from tradestudy.cameras.calibration import ONE_SIGMA
from tradestudy.depth.draws import exact_distribution
from tradestudy.depth.evaluation import distribution, model_error
from tradestudy.depth.linear import second_order
from tradestudy.study.prepared import apply_models


@pytest.mark.parametrize("kind", KINDS)
def test_half_widths_are_those_of_many_draws(tmp_path: Path, kind: str) -> None:
    """With errors so large that a line misses the interval, the estimate of its error holds all that draws find."""
    large = {"cameras.one.calibration.errors.yaw.standard_deviation": "0.3 deg"} if kind == "stereo" else {}
    large["cameras.one.calibration.stability.temperature.standard_deviation"] = "20 K"
    definition = base_study(kind, tmp_path).with_values(large)
    camera = apply_models(definition.case.cameras["one"], {"calibration": "linear"})
    distance = definition.case.distance
    distance = distance[camera.images(distance)][::3]
    found = second_order(camera, distance, 0.0, "calibration")
    assert found is not None
    drawn = replace(camera, propagation=replace(camera.propagation, model="exact", tolerance=1e-4, max_draws=2**18))
    truth = exact_distribution(drawn, distance, 0.0, "calibration")
    line = distribution(camera, distance, "calibration")
    noise = 3.0 * truth.half_width_error / truth.half_width
    apart = np.abs(found.expected.half_width / truth.half_width - 1.0)
    assert np.all(apart <= found.uncertain + noise + 1e-4)
    stated = model_error(camera, distance, "calibration").half_width
    missed = np.abs(truth.half_width / line.half_width - 1.0)
    assert np.all(missed <= 1.1 * stated + noise + 1e-4)


def test_failures_along_the_steepest_direction_are_those_of_a_normal_disparity(tmp_path: Path) -> None:
    """Disparity f B/Z with a normal error of f σ falls to zero with probability Φ(−B/(Z σ))."""
    from scipy.special import ndtr

    values = {"cameras.one.calibration.stability": None, "cameras.one.depth.disparity_error": "0.001 px"}
    values |= {f"cameras.one.calibration.errors.{name}": None for name in ("pitch", "roll", "baseline", "focal_length")}
    values["cameras.one.calibration.errors.yaw.standard_deviation"] = "0.2 deg"
    definition = base_study("stereo", tmp_path).with_values(values)
    rig = definition.case.cameras["one"]
    distance = np.array([5.0, 10.0, 15.0])
    found = second_order(rig, distance, 0.0, "calibration")
    assert found is not None
    expected = ndtr(-0.1 / (distance * np.radians(0.2)))
    np.testing.assert_allclose(found.expected.failed_fraction, expected, rtol=0.02)


def test_errors_that_are_not_normal_are_left_to_draws(tmp_path: Path) -> None:
    yaw = {"standard_deviation": None, "half_width": "0.2 deg"}
    definition = base_study("stereo", tmp_path).with_values({"cameras.one.calibration.errors.yaw": yaw})
    rig = definition.case.cameras["one"]
    assert second_order(rig, np.array([1.0]), 0.0, "both") is None
    assert ONE_SIGMA in rig.propagation.coverages


@pytest.mark.parametrize("kind", KINDS)
def test_a_camera_without_errors_reads_the_truth(tmp_path: Path, kind: str) -> None:
    camera = base_study(kind, tmp_path).with_values({"cameras.one.calibration": None}).case.cameras["one"]
    distance = np.array([0.5, 1.0])
    found = second_order(camera, distance, 0.0, "calibration")
    assert found is not None
    np.testing.assert_allclose(found.expected.quantile, np.broadcast_to(distance, (5, 2)), rtol=1e-12)
    for zero in (found.expected.error_radius, found.expected.failed_fraction, found.uncertain):
        assert zero.tolist() == [0.0, 0.0]


def test_a_width_without_a_far_end_is_certain(tmp_path: Path) -> None:
    """Where depth has no far end along the steepest direction nor beside it, second order leaves nothing open."""
    values = {"cameras.one.calibration.errors.yaw.standard_deviation": "2 deg"}
    rig = base_study("stereo", tmp_path).with_values(values).case.cameras["one"]
    found = second_order(rig, np.array([1.0, 10.0]), 0.0, "both")
    assert found is not None
    assert np.isfinite(found.expected.half_width).tolist() == [True, False]
    assert found.uncertain[1] == 0.0
