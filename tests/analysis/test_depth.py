"""Depth uncertainty against plain random draws through cameras in plain numpy, and against closed forms."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from tests.analysis.plain_depths import CENTRAL, F_MAIN, PIXEL, B, F, depth_quantile, of_rig, r5_depth, stereo_depth
from tests.cameras.builders import PITCH, r5, stereo, unfocused
from tests.uncertainty.builders import correlated_normal
from tradestudy.cameras.calibration import Calibration, Propagation
from tradestudy.cameras.parts import Lens
from tradestudy.depth.evaluation import ERROR_SOURCES, depth_uncertainty, evaluate_depth, variance_shares
from tradestudy.uncertainty.distributions import Normal, StudentT, Uniform
from tradestudy.uncertainty.joint import GaussianCopula
from tradestudy.uncertainty.sources import ErrorClass, Source

YAW = math.radians(0.2)
DRAWS = 400_000
NOISE, CALIBRATION, BOTH = range(3)
EXACT = Propagation(model="exact", seed=3, tolerance=4e-3, max_draws=2**17, judged=(0.35, 1.0, 4.0))
R5_CALIBRATION = Calibration(
    groups=(
        GaussianCopula(
            name="main lens",
            parameters=("mla_distance", "focal_length"),
            marginals=(Normal(mean=0.0, standard_deviation=2e-6), Normal(mean=0.0, standard_deviation=1.5e-6)),
            correlation=np.array([[1.0, 0.6], [0.6, 1.0]]),
            error_class=ErrorClass.RIG,
        ),
        of_rig("microlens_gap", Uniform(low=-0.5e-6, high=0.5e-6)),
    )
)
STEREO_CALIBRATION = Calibration(
    groups=(
        of_rig("yaw", Uniform(low=-YAW, high=YAW)),
        of_rig("baseline", Normal(mean=0.0, standard_deviation=0.2e-3)),
        of_rig("focal_length", Normal(mean=0.0, standard_deviation=20e-6)),
    )
)


def r5_draws(rng: np.random.Generator) -> dict[str, np.ndarray]:
    shared, own = rng.normal(size=(2, DRAWS))
    return {
        "pixel_noise": rng.normal(0.0, 0.1 * 5.5e-6, DRAWS),
        "mla_distance": 2e-6 * shared,
        "focal_length": 1.5e-6 * (0.6 * shared + 0.8 * own),
        "microlens_gap": rng.uniform(-0.5e-6, 0.5e-6, DRAWS),
    }


def stereo_draws(rng: np.random.Generator) -> dict[str, np.ndarray]:
    return {
        "pixel_noise": rng.normal(0.0, 0.1 * PIXEL, DRAWS),
        "yaw": rng.uniform(-YAW, YAW, DRAWS),
        "baseline": rng.normal(0.0, 0.2e-3, DRAWS),
        "focal_length": rng.normal(0.0, 20e-6, DRAWS),
    }


CASES = {
    "r5": (r5(calibration=R5_CALIBRATION), r5_draws, r5_depth),
    "stereo": (stereo(calibration=STEREO_CALIBRATION), stereo_draws, stereo_depth),
}


def of_error_source(errors: Mapping[str, np.ndarray], error_source: str) -> dict[str, np.ndarray]:
    return {
        k: v for k, v in errors.items() if error_source == "both" or (k == "pixel_noise") == (error_source == "noise")
    }


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("distance", [0.35, 1.0, 4.0])
def test_exact_quantiles_and_failures_are_those_of_random_draws(name: str, distance: float) -> None:
    camera, draws, depth = CASES[name]
    errors = draws(np.random.default_rng(20240607))
    found = evaluate_depth(replace(camera, propagation=EXACT), np.array([distance]))
    for row, error_source in enumerate(ERROR_SOURCES):
        sample = np.sort(depth(distance, of_error_source(errors, error_source)))
        lost, claimed = float(np.mean(np.isinf(sample))), float(found.failed_fraction[row, 0])
        slack = 5.0 * float(found.failed_fraction_error[row, 0])
        assert abs(lost - claimed) < 4.0 * math.sqrt(max(claimed, 1 / DRAWS) / DRAWS) + slack
        for column, p in enumerate(EXACT.probabilities):
            spread = 4.0 * math.sqrt(p * (1 - p) / DRAWS)
            low, high = sample[int((p - spread) * DRAWS)], sample[min(int((p + spread) * DRAWS) + 1, DRAWS - 1)]
            value = float(found.quantile[row, 0, column])
            # The draws are settled for half widths; each end of the interval may be off by as much again.
            slack = 2.0 * EXACT.tolerance * abs(value - distance) if math.isfinite(value) else 0.0
            assert low - slack <= value <= high + slack


@pytest.mark.parametrize("name", CASES)
def test_stated_errors_cover_the_true_ones_of_either_model(name: str) -> None:
    """The half width of 400 000 random draws has a standard error of 0.2 %."""
    camera, draws, depth = CASES[name]
    errors, places = draws(np.random.default_rng(3)), np.array([0.35, 1.0, 3.0])
    for propagation in (Propagation(), EXACT):
        found = evaluate_depth(replace(camera, propagation=propagation), places)
        for k, distance in enumerate(places.tolist()):
            low, high = np.quantile(depth(distance, errors), CENTRAL[0.6827])
            true, stated = (high - low) / 2.0, float(found.uncertainty_error[BOTH, k])
            assert abs(float(found.uncertainty[BOTH, k]) - true) <= 3.5 * stated + 0.008 * true
            assert stated < 0.2 * true


def test_published_quantiles_of_yaw_alone_at_ten_metres() -> None:
    """Z = B/(B/Z + ψ) for every quantile of a normal yaw, with tan(θ + ψ) of the exact geometry."""
    rig = stereo(propagation=Propagation(model="exact", tolerance=1e-4, max_draws=2**19, judged=(8.0,)))
    found = evaluate_depth(rig, np.array([10.0]))
    p = np.array(EXACT.probabilities)
    closed = stereo_depth(10.0, {"yaw": YAW * ndtri(1.0 - p)})
    assert closed[[0, 2, 4]] == pytest.approx([5.9375, 10.0, 31.667], rel=3e-4)
    assert found.quantile[CALIBRATION, 0] == pytest.approx(closed, rel=2e-3)
    pole = math.atan(B / 2 / 10.0) * 2.0 / YAW
    off = found.failed_fraction[CALIBRATION, 0] - ndtr(-pole)
    assert abs(off) < 4.0 * found.failed_fraction_error[CALIBRATION, 0] < 4e-3
    linear = evaluate_depth(stereo(), np.array([10.0]))
    assert linear.quantile[CALIBRATION, 0] == pytest.approx(closed, rel=1e-3)
    assert linear.failed_fraction[CALIBRATION, 0] == pytest.approx(ndtr(-pole), rel=2e-3)


def test_ends_of_a_uniform_yaw_of_half_a_degree_at_ten_metres() -> None:
    half = math.radians(0.5)
    rig = stereo(
        calibration=Calibration(groups=(of_rig("yaw", Uniform(low=-half, high=half)),)),
        propagation=Propagation(model="exact", tolerance=2e-4, max_draws=2**19, judged=(10.0,)),
    )
    near_95, near, middle, far, far_95 = evaluate_depth(rig, np.array([10.0])).quantile[CALIBRATION, 0]
    assert (near, far) == pytest.approx((6.267, 24.74), rel=5e-4)
    assert (near_95, far_95) == pytest.approx((5.467, 58.5), rel=3e-3)
    assert middle == pytest.approx(10.0, rel=1e-4)
    # The line in inverse depth takes the uniform yaw for a normal one, and misses the far end widely.
    assert evaluate_depth(replace(rig, propagation=Propagation()), np.array([10.0])).quantile[BOTH, 0, -1] > 200.0


def test_a_baseline_error_and_noise_have_a_closed_form() -> None:
    """Both are normal, and depth is their ratio."""
    rig = stereo(
        disparity_error_px=2.0,
        calibration=Calibration(groups=(of_rig("baseline", Normal(mean=0.0, standard_deviation=0.05 * B)),)),
        propagation=replace(EXACT, judged=(1.0, 3.0), tolerance=1e-3),
    )
    places = np.array([1.0, 3.0])
    found = evaluate_depth(rig, places)
    closed = [[depth_quantile(z, p, noise=2.0 * PIXEL, baseline=0.05 * B) for p in EXACT.probabilities] for z in places]
    np.testing.assert_allclose(found.quantile[BOTH], closed, rtol=1e-3)


def test_noise_alone_is_exact_to_the_last_digits() -> None:
    """Z_p = fB/(d + σ Φ⁻¹(1 − p)) of a parallel pair; beyond infinity from Φ(−d/σ) on."""
    rig, places = stereo(disparity_error_px=20.0), np.array([1.0, 5.0, 20.0])
    found, p = evaluate_depth(rig, places), np.array(EXACT.probabilities)
    disparity, sigma = F * B / places, 20.0 * PIXEL
    moved = disparity[:, None] + sigma * ndtri(1.0 - p)
    closed = np.where(moved > 0.0, F * B / np.maximum(moved, 1e-300), np.inf)
    np.testing.assert_allclose(found.quantile[NOISE], closed, rtol=1e-12)
    np.testing.assert_allclose(found.failed_fraction[NOISE], ndtr(-disparity / sigma), rtol=1e-6, atol=1e-18)
    assert np.all(found.failed_fraction_error[NOISE] == 0.0)


def test_published_failures_of_the_same_type_pair() -> None:
    places = np.array([3.0, 5.0, 7.0])
    found = evaluate_depth(r5(), places).failed_fraction[NOISE]
    assert found == pytest.approx([0.01, 0.085, 0.17], rel=0.08)
    # Φ((d∞ − d)/σ) with d = √3 p b_L/a_L.
    z, lever = 14.77255e-3, math.sqrt(3) * PITCH * 0.568093e-3
    disparity = lever / (z - F_MAIN * places / (places - F_MAIN))
    np.testing.assert_allclose(found, ndtr((lever / (z - F_MAIN) - disparity) / 0.55e-6), rtol=1e-6)


def test_published_comparison_at_half_a_metre() -> None:
    u_stereo = evaluate_depth(stereo(), np.array([0.5])).uncertainty[BOTH, 0]
    u_pair = evaluate_depth(r5(), np.array([0.5])).uncertainty[BOTH, 0]
    assert u_pair / u_stereo == pytest.approx(2.9, abs=0.1)
    assert u_stereo == pytest.approx(8.7e-3, rel=0.02)
    least_squares = r5(estimator="least-squares", lenses="all")
    # Published 11.2 mm with the √2 of the disparity error and the disc of |v|/2 pitches.
    disc = float(least_squares.radius_over_pitch(0.5) / (abs(least_squares.virtual_depth(0.5)) / 2))
    assert evaluate_depth(least_squares, np.array([0.5])).uncertainty[NOISE, 0] * disc**2 == pytest.approx(
        11.2e-3 / math.sqrt(2), rel=0.05
    )


def test_shares_of_independent_errors_are_those_of_each_error_alone() -> None:
    """Var(1/Z) adds up: σ²/(fB)², ψ²/B² (1 + x²/f²)², (σ_B/(BZ))² and (σ_f/(fZ))²."""
    places = np.array([0.3, 2.0, 10.0])
    found = variance_shares(stereo(calibration=STEREO_CALIBRATION), places)
    each = {
        "noise": np.full(3, (0.1 * PIXEL / (F * B)) ** 2),
        "relative rotation": (YAW / math.sqrt(3) / B * (1.0 + (B / 2 / places) ** 2)) ** 2,
        "relative position": (0.2e-3 / B / places) ** 2,
        "interior orientation": (20e-6 / F / places) ** 2,
    }
    assert set(found) == set(each)
    for part, value in each.items():
        np.testing.assert_allclose(found[part], value / sum(each.values()), rtol=1e-4)


def test_tied_array_distance_and_focal_length_have_the_published_shares() -> None:
    """R5 at 1 m, each 1 µm, ρ = 0.9: 47.6 and 52.4 %, of parts that are a part of their own."""
    vocabulary = {
        **r5().error_vocabulary,
        **{name: replace(r5().error_vocabulary[name], part=name) for name in ("mla_distance", "focal_length")},
    }
    tied = correlated_normal(
        name="main lens", parameters=("mla_distance", "focal_length"), mean=np.zeros(2),
        standard_deviation=np.full(2, 1e-6), correlation=np.array([[1.0, 0.9], [0.9, 1.0]]), error_class=ErrorClass.RIG,
    )  # fmt: skip
    camera, place = r5(disparity_error_px=1e-9), np.array([1.0])
    apart = variance_shares(replace(camera, calibration=Calibration(groups=(tied,), vocabulary=vocabulary)), place)
    assert apart["mla_distance"][0] == pytest.approx(0.476, abs=5e-4)
    assert apart["focal_length"][0] == pytest.approx(0.524, abs=5e-4)
    together = variance_shares(r5(calibration=Calibration(groups=(tied,))), place)
    assert set(together) == {"noise", "interior orientation"}
    assert sum(share[0] for share in together.values()) == pytest.approx(1.0, rel=1e-12)


def test_shares_are_unknown_without_variance() -> None:
    wild = Source(
        name="yaw",
        distribution=StudentT(location=0.0, scale=1e-4, degrees_of_freedom=1.5),
        error_class=ErrorClass.RIG,
    )
    camera = stereo(calibration=Calibration(groups=(wild,)), propagation=Propagation(model="exact"))
    shares = variance_shares(camera, np.array([1.0]))
    assert all(np.isnan(share).all() for share in shares.values())
    assert np.isfinite(evaluate_depth(camera, np.array([1.0])).uncertainty).all()


def test_an_unbounded_interval_is_infinite() -> None:
    for propagation in (Propagation(), Propagation(model="exact")):
        far = evaluate_depth(r5(calibration=R5_CALIBRATION, propagation=propagation), np.array([50.0]))
        assert np.isinf(far.uncertainty[BOTH, 0])
        assert np.isnan(far.uncertainty_error[BOTH, 0])
        assert np.isinf(far.quantile[BOTH, 0, -1])
        assert np.isfinite(far.quantile[BOTH, 0, 0])


@pytest.mark.parametrize("model", ["linear", "exact"])
def test_depth_is_unknown_exactly_where_the_axis_is_not_seen(model: str) -> None:
    """Both cameras of a parallel pair see the axis from fB/w on, where views begin to overlap; lenses from f on."""
    places, propagation = np.geomspace(0.01, 2.0, 41), Propagation(model=model)  # type: ignore[arg-type]
    wide = stereo(lens=Lens(focal_length=8e-3, f_number=4.0), baseline=0.06, propagation=propagation)
    begins = 8e-3 * 0.06 / 10.24e-3
    for error_source in ERROR_SOURCES:
        seen = ~np.isnan(depth_uncertainty(wide, places, error_source))
        np.testing.assert_array_equal(seen, (wide.overlap(places) > 0.0) & wide.images(places))
        np.testing.assert_array_equal(seen, places > begins)
    for camera in (r5(calibration=R5_CALIBRATION, propagation=propagation), unfocused(propagation=propagation)):
        np.testing.assert_array_equal(np.isnan(depth_uncertainty(camera, places)), places <= F_MAIN)
