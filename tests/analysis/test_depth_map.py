"""Depth uncertainty over the picture: against the axis, and against the slope of disparity off it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from tests.calibration.cameras import stereo, webcams
from tradestudy.answers.depth_map import ACROSS, DOWN, depth_map, map_places
from tradestudy.depth.evaluation import depth_uncertainty, distribution
from tradestudy.figures.pictures import map_words, uncertainty_map_drawings
from tradestudy.optics.lens_families import KannalaBrandt
from tradestudy.results import dataset

Z = np.array([0.3, 1.0, 4.0])
FISHEYE = KannalaBrandt(k1=-0.03, k2=0.012)


@pytest.fixture(scope="module")
def measured(calibrated_webcams):
    return replace(webcams(), calibration=calibrated_webcams.calibration)


def test_a_rig_without_lens_models_has_no_map():
    assert depth_map(stereo(), Z) is None


def test_the_centre_of_the_map_is_the_axis(measured):
    linear = replace(measured, propagation=replace(measured.propagation, model="linear"))
    found = depth_map(measured, Z)
    middle = found.uncertainty[:, DOWN // 2, ACROSS // 2]
    np.testing.assert_allclose(middle, depth_uncertainty(linear, Z), rtol=1e-9)
    assert np.all(found.error < 0.1)
    radius = distribution(linear, Z, "both", 0.0).error_radius
    np.testing.assert_allclose(found.radius[:, DOWN // 2, ACROSS // 2], radius, rtol=1e-9)
    assert np.all(found.radius_error < 0.1)


def test_noise_moves_depth_by_the_local_scale_of_the_lens():
    """u = σ p over the slope of disparity with depth, by differences of the lens model alone."""
    camera = replace(stereo(), distortion=FISHEYE)
    found = depth_map(camera, np.array([1.0])).uncertainty[0]
    across, down = map_places()
    c, pitch = camera.principal_distance, camera.sensor.pixel_pitch
    noise = camera.disparity_error_px * pitch
    for row, column in ((2, 5), (7, 12), (12, 16)):
        place = np.array([across[column] * camera.sensor.width, down[row] * camera.sensor.height]) / 2.0 / c
        ray = FISHEYE.unproject(place)
        x, y = ray[:2] / ray[2]
        disparity = [
            c * (FISHEYE.project(np.array([x * z + camera.baseline / 2.0, y * z, z]))
            - FISHEYE.project(np.array([x * z - camera.baseline / 2.0, y * z, z])))[0]
            for z in (1.0 - 1e-5, 1.0 + 1e-5)
        ]  # fmt: skip
        # At one pair of pictures depth moves along both rays; to first order in B/Z that is the slope of disparity.
        slope = (disparity[0] - disparity[1]) / 2e-5
        assert found[row, column] == pytest.approx(noise / slope, rel=2e-2)


def test_the_radius_counts_failed_measurements_as_infinitely_wrong():
    """Z' = cB/(d + e) with normal errors e of the disparity, drawn; the rig has parallel ideal lenses in its middle."""
    camera = replace(stereo(), distortion=FISHEYE)
    distance = np.array([1.0, 30.0, 300.0])
    found = depth_map(camera, distance)
    noise = camera.disparity_error_px * camera.sensor.pixel_pitch
    errors = np.random.default_rng(0).normal(size=400_000) * noise
    product = camera.principal_distance * camera.baseline
    for place, radius in zip(distance, found.radius[:, DOWN // 2, ACROSS // 2], strict=True):
        disparity = product / place + errors
        wrong = np.abs(np.where(disparity > 0.0, product / disparity, np.inf) - place)
        assert radius == pytest.approx(np.quantile(wrong, 0.6827, method="lower"), rel=2e-2)


def test_places_outside_one_camera_s_picture_are_left_out():
    camera = replace(stereo(), distortion=FISHEYE)
    found = depth_map(camera, np.array([0.3, 3.0])).uncertainty
    seen = np.isfinite(found).mean(axis=(1, 2))
    assert seen[0] < seen[1] <= 1.0
    assert np.isnan(found[0, DOWN // 2, 0])
    diagonal = distribution(camera, np.array([3.0]), "both", 0.5).half_width
    assert np.isfinite(diagonal)


def test_the_figure_and_its_sentence(measured):
    found = depth_map(measured, Z)
    across, down = map_places()
    values = {
        "depth_uncertainty": found.uncertainty[None],
        "depth_uncertainty_error": (found.uncertainty * found.error[:, None, None])[None],
    }
    coordinates = {"camera": ["rig"], "distance": Z, "down": down, "across": across}
    titles = xr.Dataset({"title": ("camera", ["Rig"])}, coords={"camera": ["rig"]})
    tree = xr.DataTree.from_dict({"/depth_map": dataset("depth_map", values, coordinates), "/cameras": titles})
    (drawing,) = uncertainty_map_drawings(tree)
    panels = drawing.draw().axes[: len(Z)]
    middle = found.uncertainty[:, DOWN // 2, ACROSS // 2]
    ratios = re.findall(r"\(elsewhere up to (\d+\.\d) times that\)", map_words(tree, "rig"))
    for panel, ratio, uncertainty, least in zip(panels, ratios, found.uncertainty, middle, strict=True):
        drawn = np.ma.filled(panel.images[0].get_array(), np.nan)
        np.testing.assert_allclose(1e-3 * drawn, uncertainty, rtol=1e-12)  # in mm, as the readout shows it
        assert float(ratio) == pytest.approx(np.nanmax(uncertainty) / least, abs=0.05)
