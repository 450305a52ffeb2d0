"""The line in inverse depth: where it holds, where it is refused, and how far its stated error is from the truth."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from tests.analysis.plain_depths import CENTRAL, B, of_rig, stereo_depth
from tests.cameras.builders import stereo
from tradestudy.cameras.calibration import Calibration, Propagation
from tradestudy.cameras.depth_measurement import PIXEL_NOISE
from tradestudy.cameras.parts import Lens
from tradestudy.depth.evaluation import distribution, model_error
from tradestudy.depth.linear import linear_distribution, linearised_depth, noise_distribution, second_order
from tradestudy.models.plan import plan_of
from tradestudy.optics.lens_families import DoubleSphere, KannalaBrandt
from tradestudy.optics.lens_model import LensModel, Rational
from tradestudy.study.loading import load_prepared
from tradestudy.uncertainty.distributions import Normal

YAW = math.radians(0.2)
STUDY = """
format: 2
study: rig
title: A rig
question: How well does it measure?
cameras:
  rig:
    kind: stereo
    title: Rig
    lenses: {focal_length: 30.5 mm, f_number: 4}
    sensor: {pixels: [1024, 1024], pixel_pitch: 10 um}
    baseline: 100 mm
    convergence_distance: infinity
    focus_distance: 1 m
    depth: {estimator: disparity, disparity_error: 0.001 px, discrimination_step: 0.1 px}
    calibration: {errors: {ERRORS}}
scene: {distances: {from: 0.4 m, to: 3 m, points: 21}, wavelength: 550 nm}
accuracy: {tolerance: 1 %}
usable_range: {relative_uncertainty: 50 %}
"""


def with_one(name: str, deviation: float):
    source = of_rig(name, Normal(mean=0.0, standard_deviation=deviation))
    return stereo(disparity_error_px=1e-9, calibration=Calibration(groups=(source,)))


def ends(distance: float, name: str, deviation: float, coverage: float) -> np.ndarray:
    """Of the central interval: depth falls or rises with one normal error."""
    low, high = Normal(mean=0.0, standard_deviation=deviation).quantile(np.array(CENTRAL[coverage]))
    return np.sort(stereo_depth(distance, {name: np.array([low, high])}))


@pytest.mark.parametrize("distance", [0.5, 1.4, 1.5, 3.0, 8.0, 12.0])
def test_a_line_in_inverse_depth_holds_where_a_line_in_depth_fails(distance: float) -> None:
    """95 % of a yaw of 0.2°: a line in depth misses the half width by 1 % from 1.45 m on."""
    near, far = ends(distance, "yaw", YAW, 0.95)
    true, rig = (far - near) / 2.0, with_one("yaw", YAW)
    line = linear_distribution(rig, np.array([distance]), 0.0, "calibration")
    assert line.half_widths(0.95)[0, 0] == pytest.approx(true, rel=2e-3)
    assert line.quantile[[0, -1], 0] == pytest.approx([near, far], rel=2e-3)
    line = linearised_depth(rig, np.array([distance]), 0.0)
    in_depth = 1.959964 * distance**2 * float(line.standard_deviation[0])
    assert (abs(in_depth / true - 1.0) > 0.01) == (distance > 1.45)


@pytest.mark.parametrize("distance", [12.0, 40.0, 1e3])
def test_failures_are_found_at_scores_of_a_tiny_noise_in_the_billions(distance: float) -> None:
    """Disparity is linear in its noise, so failures are those of a normal inverse depth."""
    rig = with_one("yaw", YAW)
    line = linear_distribution(rig, np.array([distance]), 0.0, "calibration")
    deviation = linearised_depth(rig, np.array([distance]), 0.0).standard_deviation[0]
    assert line.failed[0, 0] == pytest.approx(ndtr(-1.0 / distance / deviation), rel=1e-8)


@pytest.mark.parametrize(("k1", "field", "noise_px"), [(-0.1, 0.9, 20.0), (-0.3, 0.5, 20.0)])
def test_failures_are_found_where_noise_moves_images_out_of_the_field_of_a_lens(
    k1: float, field: float, noise_px: float
) -> None:
    """The lens model has no ray at one end of the search, or at both."""
    yaw = of_rig("yaw", Normal(mean=0.0, standard_deviation=math.radians(0.5)))
    rig = stereo(
        lens=Lens(focal_length=6e-3, f_number=4.0),
        distortion=Rational(k1=k1),
        disparity_error_px=noise_px,
        calibration=Calibration(groups=(yaw,)),
    )
    truth = np.array([0.5, 1.0, 2.0, 4.0, 8.0, 20.0])
    line = linearised_depth(rig, truth, field)
    scale = line.standard_deviation / np.abs(line.sensitivity[line.parameters.index(PIXEL_NOISE)])
    scores = ndtri((np.arange(200_000) + 0.5) / 200_000)[:, np.newaxis] * scale
    noise = scores * noise_px * rig.sample_pitch
    read = rig.measured_depth(truth, field, {PIXEL_NOISE: noise, "yaw": np.zeros((1, 1))})
    lost = read.no_overlap | read.out_of_range | ~(read.inverse_depth > 0.0)
    assert linear_distribution(rig, truth, field, "both").failed[0] == pytest.approx(lost.mean(axis=0), abs=1e-5)


@pytest.mark.parametrize(
    ("lens", "focal_length", "field", "noise_px", "yaw"),
    [
        (KannalaBrandt(k1=-0.05), 4e-3, 0.5, 60.0, 0.0),  # sideways at scores that none of these measurements has
        (KannalaBrandt(), 4.2e-3, 0.9, 20.0, 0.0),
        (KannalaBrandt(), 5e-3, 0.9, 60.0, -3.0),  # without noise, no depth is read
        (DoubleSphere(xi=0.2, alpha=0.6), 5e-3, 0.7, 60.0, 0.0),
        (Rational(k1=-0.3), 6e-3, 0.5, 20.0, 0.0),  # out of the field, mostly of near points
    ],
)
def test_failures_are_those_of_many_measurements_where_noise_turns_rays_sideways(
    lens: LensModel, focal_length: float, field: float, noise_px: float, yaw: float
) -> None:
    bias = math.radians(yaw)
    rig = stereo(
        lens=Lens(focal_length=focal_length, f_number=4.0),
        distortion=lens,
        disparity_error_px=noise_px,
        calibration=Calibration(groups=(of_rig("yaw", Normal(mean=bias, standard_deviation=1e-3)),)),
    )
    truth = np.array([0.3, 0.5, 1.0, 2.0, 4.0, 8.0, 20.0])
    scores = ndtri((np.arange(200_000) + 0.5) / 200_000)[:, np.newaxis]
    read = rig.measured_depth(truth, field, {PIXEL_NOISE: scores * noise_px * rig.sample_pitch, "yaw": np.array(bias)})
    lost = np.mean(read.no_overlap | read.out_of_range | ~(read.inverse_depth > 0.0), axis=0)
    assert noise_distribution(rig, truth, field).failed[0] == pytest.approx(lost, abs=1e-5)
    to_second_order = second_order(rig, truth, field, "noise")
    assert to_second_order is not None
    assert to_second_order.expected.failed_fraction == pytest.approx(lost, abs=0.02)


def test_a_line_in_inverse_depth_misses_a_baseline_that_is_off_by_a_tenth() -> None:
    """Depth is proportional to the baseline: 19.60 % at 95 %, which the line takes for 20.38 %."""
    rig, place = with_one("baseline", 0.1 * B), np.array([2.0])
    near, far = ends(2.0, "baseline", 0.1 * B, 0.95)
    line = linear_distribution(rig, place, 0.0, "calibration")
    assert (far - near) / 4.0 == pytest.approx(0.1960, abs=5e-5)
    assert line.half_widths(0.95)[0, 0] / 2.0 == pytest.approx(0.2038, abs=5e-5)


def test_depth_that_does_not_depend_on_disparity_is_not_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where the image lies exactly on the microlenses; the depth at other distances stays, without warnings."""
    rig, places = with_one("yaw", YAW), np.array([1.0, 2.0])
    line = linearised_depth(rig, places, 0.0)
    known = linear_distribution(rig, places, 0.0, "both")
    sensitivity = line.sensitivity.copy()
    sensitivity[line.parameters.index(PIXEL_NOISE), 0] = 0.0
    monkeypatch.setattr("tradestudy.depth.linear.linearised_depth", lambda *_: replace(line, sensitivity=sensitivity))
    found = linear_distribution(rig, places, 0.0, "both")
    for name in ("half_width", "error_radius", "failed_fraction"):
        here, there = np.ravel(getattr(found, name))
        assert np.isnan(here)
        assert there == np.ravel(getattr(known, name))[1]


@pytest.mark.parametrize("spread", [0.03, 0.05, 0.07, 0.1, 0.15])
def test_the_measured_error_of_the_linear_model_is_its_true_error(spread: float) -> None:
    """Half widths of all coverages that are reported, against the closed form."""
    rig, places = with_one("baseline", spread * B), np.array([1.0, 3.0])
    line = linear_distribution(rig, places, 0.0, "calibration")
    found = model_error(rig, places, "calibration")
    for k, distance in enumerate(places.tolist()):
        missed = []
        for coverage in (0.6827, 0.95):
            near, far = ends(distance, "baseline", spread * B, coverage)
            missed.append(abs(line.half_widths(coverage)[0, k] / ((far - near) / 2.0) - 1.0))
        assert found.half_width[k] == pytest.approx(missed[0], abs=2e-3)
        assert found.intervals[k] == pytest.approx(max(missed), abs=6e-3)
        assert found.intervals[k] >= found.half_width[k]


@pytest.mark.parametrize("model", ["off", "linear", "exact"])
@pytest.mark.parametrize("offset", [0.0, 0.02])
def test_a_constant_error_is_exact_in_every_model(model: str, offset: float) -> None:
    """A baseline that is certainly off by a share scales depth and its noise, and adds no uncertainty."""
    constant = of_rig("baseline", Normal(mean=offset * B, standard_deviation=0.0))
    rig = stereo(calibration=Calibration(groups=(constant,)), propagation=Propagation(model=model))
    places = np.array([1.0, 3.0])
    for quantile in distribution(rig, places, "calibration").quantiles[0]:
        np.testing.assert_allclose(quantile, (1.0 + offset) * places, rtol=1e-9)
    widened = distribution(rig, places, "both").half_width / distribution(stereo(), places, "noise").half_width
    np.testing.assert_allclose(widened, 1.0 + offset, rtol=1e-9)
    for source in ("calibration", "both"):
        found = model_error(rig, places, source)
        for error in (found.half_width, found.radius, found.judged, found.intervals, found.failures()):
            np.testing.assert_array_equal(error, 0.0)


@pytest.mark.parametrize(
    ("errors", "model"),
    [
        ("yaw: {standard_deviation: 0.2 deg}", "linear"),
        ("baseline: {standard_deviation: 2 mm}", "linear"),
        ("baseline: {standard_deviation: 7 mm}", "exact"),  # 0.5 % at 68 %, 2 % at 95 %
        ("baseline: {standard_deviation: 10 mm}", "exact"),
        ("yaw: {half_width: 0.5 deg}", "exact"),
    ],
)
def test_a_plan_chooses_the_linear_model_where_it_keeps_the_tolerance(tmp_path: Path, errors: str, model: str) -> None:
    file = tmp_path / "rig.yaml"
    file.write_text(STUDY.replace("ERRORS", errors), encoding="utf-8")
    plan = plan_of(load_prepared(file))
    assert plan.models("rig")["calibration"] == model
