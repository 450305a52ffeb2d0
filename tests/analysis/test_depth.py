"""Depth uncertainty against plain random draws through the exact camera models, and against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from tests.cameras.builders import r5, stereo
from tradestudy.analysis.depth import ONE_SIGMA, QUANTILES, WAYS, DepthErrors, evaluate_depth
from tradestudy.cameras.depth_camera import ErrorSource
from tradestudy.cameras.plenoptic import PlenopticCalibration
from tradestudy.cameras.stereo.errors import StereoCalibration

YAW = math.radians(0.2)
DRAWS = 400_000
CALIBRATED_R5 = r5(
    calibration=PlenopticCalibration(
        mla_distance=ErrorSource(standard_deviation=2e-6),
        focal_length=ErrorSource(standard_deviation=1.5e-6),
        correlation=0.6,
        microlens_gap=ErrorSource(standard_deviation=0.5e-6 / math.sqrt(3), shape="uniform"),
    )
)
CALIBRATED_STEREO = stereo(
    calibration=StereoCalibration(
        yaw=ErrorSource(standard_deviation=YAW / math.sqrt(3), shape="uniform"),
        baseline=ErrorSource(standard_deviation=0.2e-3),
        focal_length=ErrorSource(standard_deviation=20e-6),
    )
)


def draw(rng: np.random.Generator, source: ErrorSource) -> np.ndarray:
    if source.shape == "uniform":
        half = math.sqrt(3) * source.standard_deviation
        return rng.uniform(-half, half, DRAWS)
    return rng.normal(0, source.standard_deviation, DRAWS)


def plenoptic_draws(rng: np.random.Generator) -> dict[str, np.ndarray]:
    c = CALIBRATED_R5.calibration
    shared, own = rng.normal(size=(2, DRAWS))
    return {
        "pixel_noise": rng.normal(0, 0.1 * 5.5e-6, DRAWS),
        "mla_distance": c.mla_distance.standard_deviation * shared,
        "focal_length": c.focal_length.standard_deviation * (0.6 * shared + 0.8 * own),
        "microlens_gap": draw(rng, c.microlens_gap),
    }


def stereo_draws(rng: np.random.Generator) -> dict[str, np.ndarray]:
    c = CALIBRATED_STEREO.calibration
    return {"pixel_noise": rng.normal(0, 1e-6, DRAWS)} | {
        name: draw(rng, getattr(c, name)) for name in ("yaw", "baseline", "focal_length")
    }


@pytest.mark.parametrize(
    ("camera", "draws"), [(CALIBRATED_R5, plenoptic_draws), (CALIBRATED_STEREO, stereo_draws)], ids=["r5", "stereo"]
)
@pytest.mark.parametrize("distance", [0.2, 1.0, 4.0, 9.0])
def test_quantiles_and_failures_are_those_of_random_draws(camera, draws, distance: float) -> None:
    errors = draws(np.random.default_rng(20240607))
    evaluation = evaluate_depth(camera, np.array([distance]))
    for row, way in enumerate(WAYS):
        kept = {k: v for k, v in errors.items() if way == "both" or (k == "pixel_noise") == (way == "noise")}
        sample = np.sort(camera.depth_with_errors(distance, kept))
        lost = float(np.mean(np.isinf(sample)))
        claimed = float(evaluation.failed_fraction[row, 0])
        # Three and a half standard errors of a count, and what linearity in disparity leaves out.
        assert abs(lost - claimed) < 3.5 * math.sqrt(max(claimed, 1 / DRAWS) / DRAWS) + 0.01 * claimed
        for column, p in enumerate(QUANTILES):
            spread = 4 * math.sqrt(p * (1 - p) / DRAWS)
            low, high = sample[int((p - spread) * DRAWS)], sample[min(int((p + spread) * DRAWS) + 1, DRAWS - 1)]
            value = float(evaluation.quantile[row, 0, column])
            slack = (
                2.0 * float(evaluation.uncertainty_error[0]) if np.isfinite(evaluation.uncertainty_error[0]) else 0.0
            )
            assert low - slack - 1e-3 * distance * p <= value <= high + slack + 1e-3 * distance or (
                math.isinf(value) and math.isinf(high)
            )


def test_stated_linearisation_error_covers_the_true_one() -> None:
    """The interval's half width by draws is known to half a percent; the statement must not be far below."""
    rng = np.random.default_rng(3)
    for camera, draws in ((CALIBRATED_R5, plenoptic_draws), (CALIBRATED_STEREO, stereo_draws)):
        for distance in (0.3, 1.0, 3.0):
            evaluation = evaluate_depth(camera, np.array([distance]))
            sample = camera.depth_with_errors(distance, draws(rng))
            low, high = np.quantile(sample, ONE_SIGMA)
            true = (high - low) / 2
            stated = float(evaluation.uncertainty_error[0])
            both = float(evaluation.uncertainty[2, 0])
            assert abs(both - true) <= stated + 0.012 * true
            assert stated < 0.2 * both


def test_published_quantiles_of_yaw_alone_at_ten_metres() -> None:
    rig = stereo(disparity_error_px=1e-9)
    evaluation = evaluate_depth(rig, np.array([10.0]))
    quantile = evaluation.quantile[WAYS.index("calibration"), 0]
    assert quantile[[0, 2, 4]] == pytest.approx([5.9375, 10.0, 31.667], rel=3e-4)
    assert evaluation.failed_fraction[WAYS.index("calibration"), 0] == pytest.approx(2.09e-3, rel=3e-3)
    # The same by the closed form f B / (d₀ + s Φ⁻¹(p)), here with 1 + x²/f² of the exact geometry.
    f, B, z = 30.5e-3, 0.1, 10.0
    d0, s = f * B / z, f * YAW * (1 + (B / (2 * z)) ** 2)
    assert quantile == pytest.approx(f * B / (d0 + s * ndtri(1 - np.array(QUANTILES))), rel=1e-9)
    assert evaluation.failed_fraction[1, 0] == pytest.approx(ndtr(-d0 / s), rel=1e-9)


def test_published_failures_of_the_same_type_pair() -> None:
    evaluation = evaluate_depth(r5(), np.array([3.0, 5.0, 7.0]))
    assert evaluation.failed_fraction[WAYS.index("noise")] == pytest.approx([0.01, 0.085, 0.17], rel=0.08)


def test_published_comparison_at_half_a_metre() -> None:
    wide = stereo()
    u_stereo = evaluate_depth(wide, np.array([0.5])).uncertainty[2, 0]
    u_pair = evaluate_depth(r5(), np.array([0.5])).uncertainty[2, 0]
    assert u_pair / u_stereo == pytest.approx(2.9, abs=0.1)
    assert u_stereo == pytest.approx(8.7e-3, rel=0.02)
    least_squares = r5(estimator="least-squares", lenses="all")
    # Published 11.2 mm with the √2 of the disparity error and the disc of |v|/2 pitches.
    disc = float(least_squares.radius_over_pitch(0.5) / (abs(least_squares.virtual_depth(0.5)) / 2))
    assert evaluate_depth(least_squares, np.array([0.5])).uncertainty[0, 0] * disc**2 == pytest.approx(
        11.2e-3 / math.sqrt(2), rel=0.05
    )


def test_parts_add_up_where_errors_are_small() -> None:
    evaluation = evaluate_depth(CALIBRATED_STEREO, np.array([0.3]))
    normal_parts = [value[0] for name, value in evaluation.parts.items() if name != "yaw"]
    # A uniform's central 68.27 % is 0.6827 of its half width, not its standard deviation.
    assert evaluation.parts["yaw"][0] / (0.3**2 / 0.1 * YAW * (1 + (0.05 / 0.3) ** 2)) == pytest.approx(
        0.6827, rel=1e-3
    )
    assert max(normal_parts) < evaluation.uncertainty[2, 0] < sum(normal_parts) + evaluation.parts["yaw"][0]


def test_an_unbounded_interval_is_called_infinite() -> None:
    far = evaluate_depth(r5(), np.array([50.0]))
    assert np.isinf(far.uncertainty[2, 0])
    assert np.isinf(far.quantile[2, 0, -1])
    assert np.isfinite(far.quantile[2, 0, 0])


@pytest.mark.parametrize("distance", [0.5, 4.0, 9.0, 12.0, 20.0, 60.0])
def test_no_factor_of_the_errors_changes_the_uncertainty_by_more_than_is_said(distance: float) -> None:
    def uncertainty(noise: float, yaw: float) -> float:
        camera = stereo(
            disparity_error_px=0.1 * noise,
            calibration=StereoCalibration(yaw=ErrorSource(standard_deviation=yaw * YAW, shape="uniform")),
        )
        return float(evaluate_depth(camera, np.array([distance])).uncertainty[2, 0])

    declared = stereo(calibration=StereoCalibration(yaw=ErrorSource(standard_deviation=YAW, shape="uniform")))
    at_most = float(DepthErrors.of(declared, np.array([distance])).largest_change(0.5)[0])
    found = [uncertainty(1.0, 1.0)] + [uncertainty(s, 1.0) for s in (0.5, 0.9, 1.1, 1.5)] + [uncertainty(1.5, 1.5)]
    lost = np.isinf(found)
    if lost.any():
        assert math.isnan(at_most) if lost.all() else math.isinf(at_most)
    else:
        changes = np.abs(np.array(found) / found[0] - 1.0)
        assert changes[:-1].max() <= at_most
        assert changes[-1] == pytest.approx(at_most, rel=1e-12)
