"""The radius about the true distance: closed forms of a biased disparity, failures, and plain draws."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri

import tradestudy
from tests.analysis.plain_depths import PIXEL, B, F, of_rig
from tests.cameras.builders import r5, stereo
from tradestudy import figures
from tradestudy.cameras.calibration import Calibration, Propagation
from tradestudy.depth.distribution import error_radius
from tradestudy.depth.evaluation import distribution, evaluate_depth, model_error
from tradestudy.report.page_data import curve_values
from tradestudy.results.views.terminal import terminal_lines
from tradestudy.uncertainty.distributions import Normal, Uniform
from tradestudy.uncertainty.evaluation import depth_from_inverse

CASE = Path(__file__).parent.parent / "data" / "biased-estimator" / "two.yaml"
EXACT = Propagation(model="exact", tolerance=2e-3)


def radius_of_normal_inverse(truth: float, mean: float, deviation: float, share: float) -> float:
    """Of normal inverse depths w: P(1/(t + r) ≤ w ≤ 1/(t − r)) = share, solved for r; w ≤ 0 is a failure."""

    def missed(r: float) -> float:
        nearest = 1.0 / (truth - r) if r < truth else math.inf
        return float(ndtr((nearest - mean) / deviation) - ndtr((1.0 / (truth + r) - mean) / deviation)) - share

    return float(brentq(missed, 1e-9, 1e6, xtol=1e-15, rtol=1e-14))


# In standard deviations of inverse depth: unbiased, nearer, farther than the truth; precise and with failures.
@pytest.mark.parametrize("bias", [0.0, 0.05, -0.3, 1.0, -2.5, 6.0])
@pytest.mark.parametrize("deviation", [1e-3, 0.05, 0.3])
@pytest.mark.parametrize("share", [0.6827, 0.6827 / 0.95])
def test_radius_of_a_normal_inverse_depth_with_a_bias(bias: float, deviation: float, share: float) -> None:
    truth, mean, sigma = 2.0, 0.5 + 0.5 * deviation * bias, 0.5 * deviation
    if 1.0 - share <= ndtr(-mean / sigma):
        pytest.skip("too many fail: tested below")
    found = error_radius(lambda scores: depth_from_inverse(mean + sigma * scores), np.array([truth]), share)
    assert found[0] == pytest.approx(radius_of_normal_inverse(truth, mean, sigma, share), rel=5e-6)


def test_too_many_failures_leave_no_radius() -> None:
    truth = np.array([2.0, 2.0])
    failing = np.array([0.30, 0.33])  # shares at or beyond infinity
    means = -ndtri(failing) * 0.5
    found = error_radius(lambda scores: depth_from_inverse(means + 0.5 * scores), truth, 0.6827)
    assert np.isfinite(found[0])
    assert np.isinf(found[1])
    assert np.isinf(error_radius(lambda scores: depth_from_inverse(0.5 + 0.01 * scores), truth, 1.0)).all()


def bisected_radius(depth: Callable[[float], float], truth: float, share: float) -> float:
    """By plain bisection of how those outside are shared between too far and too near; depth falls with score."""
    low, high = -9.0, 9.0
    for _ in range(100):
        lean = 0.5 * (low + high)
        above = depth(float(ndtri((1.0 - share) * ndtr(lean)))) - truth
        below = abs(truth - depth(float(-ndtri((1.0 - share) * ndtr(-lean)))))
        low, high = (lean, high) if above > below else (low, lean)
    return max(above, below)


# Curved, with a kink, with a jump and with a flat part, failing at once or gradually; inverse depth by score, truth 2.
HARD = {
    "straight": lambda u: 0.5 + 0.1 * u,
    "curved": lambda u: 0.45 * np.exp(0.3 * u),
    "kink": lambda u: 0.5 + np.where(u > -0.9, 0.02, 0.2) * (u + 0.9) - 0.018,
    "jump": lambda u: 0.5 + 0.05 * u + np.where(u > -1.1, 0.0, -0.1),
    "jump to failure": lambda u: np.where(u > -1.7, 0.51 + 0.05 * u, -0.2),
    "flat": lambda u: 0.5 + 0.03 * np.clip(u, -1.0, 1.2),
    "far too near": lambda u: 0.8 + 0.03 * u,
    "far too far": lambda u: 0.3 + 0.03 * u,
    "barely seen": lambda u: 0.16 + 0.25 * u,
}


@pytest.mark.parametrize("share", [0.3, 0.6827, 0.6827 / 0.95, 0.99, 0.99999])
def test_radius_of_any_falling_depth_agrees_with_plain_bisection(share: float) -> None:
    """All of them in one call too, so that a hard one at one distance does not disturb another."""
    truth = np.full(len(HARD), 2.0)

    def read(scores: np.ndarray) -> np.ndarray:
        return depth_from_inverse(np.stack([of(scores[:, k]) for k, of in enumerate(HARD.values())], axis=1))

    together = error_radius(read, truth, share)
    for name, of, found in zip(HARD, HARD.values(), together, strict=True):
        expected = bisected_radius(lambda u, of=of: float(depth_from_inverse(np.array([of(u)]))[0]), 2.0, share)
        alone = error_radius(lambda scores, of=of: depth_from_inverse(of(scores)), truth[:1], share)[0]
        assert found == pytest.approx(expected, rel=1e-8), name
        assert alone == pytest.approx(expected, rel=1e-8), name


def test_radius_takes_few_reads_of_a_smooth_depth() -> None:
    reads = []

    def read(scores: np.ndarray) -> np.ndarray:
        reads.append(len(scores))
        return depth_from_inverse(0.5 + np.array([0.001, 0.01, 0.05]) * scores)

    error_radius(read, np.full(3, 2.0), 0.6827)
    assert len(reads) <= 3


@pytest.mark.parametrize("shift", [0.0, 0.004, -0.03])
def test_known_error_of_the_baseline_counts_in_the_radius_but_not_in_the_half_width(shift: float) -> None:
    wrong = Calibration(groups=(of_rig("baseline", Normal(mean=shift * B, standard_deviation=0.01 * B)),))
    rig, truth = stereo(disparity_error_px=1.0, calibration=wrong), 3.0
    found = distribution(rig, np.array([truth]), "noise")
    read, assumed = F * B / truth, F * B * (1.0 + shift)  # disparity, and what it is divided into
    expected = radius_of_normal_inverse(truth, read / assumed, PIXEL / assumed, 0.6826894921370859)
    assert found.error_radius[0] == pytest.approx(expected, rel=1e-5)
    ends = assumed / (read + np.array([-PIXEL, PIXEL]))
    assert found.half_width[0] == pytest.approx((ends[0] - ends[1]) / 2.0, rel=1e-6)
    assert found.judged[0] == max(found.half_width[0], found.error_radius[0])
    assert (found.error_radius[0] > found.half_width[0]) == (shift != 0.0)


@pytest.mark.parametrize("model", ["linear", "exact"])
def test_without_a_bias_the_half_width_judges(model: str) -> None:
    places = np.array([0.5, 1.0, 4.0])
    for camera in (stereo(), r5()):
        found = evaluate_depth(replace(camera, propagation=replace(EXACT, model=model)), places)
        np.testing.assert_allclose(found.judged, found.uncertainty, rtol=2e-3)
        assert (found.judged >= found.uncertainty).all()


def midpoint_depths(truth: float, yaw: np.ndarray, pitch: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Depths of the point midway between two rays whose cameras are taken as parallel; the right one is turned."""
    c, half = 8e-3, 0.075
    principal = c * truth / (truth - c)  # focused there
    to_right = np.stack([np.full(yaw.shape, -half), np.zeros(yaw.shape), np.full(yaw.shape, truth)])
    x = np.cos(yaw) * to_right[0] - np.sin(yaw) * to_right[2]
    z = np.sin(yaw) * to_right[0] + np.cos(yaw) * to_right[2]
    y, z = np.cos(pitch) * to_right[1] - np.sin(pitch) * z, np.sin(pitch) * to_right[1] + np.cos(pitch) * z
    left = np.stack([half / truth + noise / (2.0 * principal), np.zeros(yaw.shape), np.ones(yaw.shape)])
    right = np.stack([x / z - noise / (2.0 * principal), y / z, np.ones(yaw.shape)])
    base = np.array([2.0 * half, 0.0, 0.0])
    ll, rr, lr = (np.sum(one * other, axis=0) for one, other in ((left, left), (right, right), (left, right)))
    lb, rb = base @ left, base @ right
    along_left, along_right = (lb * rr - rb * lr) / (ll * rr - lr**2), (lb * lr - rb * ll) / (ll * rr - lr**2)
    return np.where(left[0] > right[0], 0.5 * (along_left + along_right), np.inf)


def test_midpoint_of_skew_rays_agrees_with_a_million_plain_draws() -> None:
    camera = tradestudy.load(CASE).prepared.case.cameras["m"]
    places = np.array([2.0, 6.0])
    found = evaluate_depth(replace(camera, propagation=replace(EXACT, judged=(2.0, 6.0))), places)
    rng, count = np.random.default_rng(5), 10**6
    yaw, pitch = (np.radians(sd) * rng.standard_normal(count) for sd in (0.05, 0.7))
    noise = 0.2 * 8e-6 * rng.standard_normal(count)
    for k, place in enumerate(places):
        depths = midpoint_depths(place, yaw, pitch, noise)
        assert found.error_radius[-1, k] == pytest.approx(np.quantile(np.abs(depths - place), 0.6827), rel=6e-3)
        assert found.quantile[-1, k, 2] - place == pytest.approx(np.median(depths) - place, rel=0.02)
        assert found.error_radius_error[-1, k] < 3e-3 * found.error_radius[-1, k]
    assert found.error_radius[-1, 1] > 1.15 > 1.0 > found.uncertainty[-1, 1]


def test_linear_propagation_states_how_far_its_radius_is_off() -> None:
    """A yaw bound in one direction shifts the median of the exact model: normal and uniform errors, two estimates."""
    places = np.array([2.0, 6.0])
    for yaw in (Normal(mean=0.0, standard_deviation=2e-3), Uniform(low=-4e-3, high=4e-3)):
        rig = stereo(disparity_error_px=1.0, calibration=Calibration(groups=(of_rig("yaw", yaw),)))
        line = distribution(replace(rig, propagation=Propagation(model="linear")), places, "both").error_radius
        exact = distribution(replace(rig, propagation=replace(EXACT, judged=(2.0, 6.0))), places, "both").error_radius
        stated = model_error(rig, places).radius
        assert (np.abs(line / exact - 1.0) < stated + 4e-3).all()
        assert (stated < 0.5).all()


def test_requirement_on_a_biased_estimator_is_not_met() -> None:
    result = tradestudy.load(CASE).run()
    row = result.data["requirements"].to_dataset().sel(requirement="six")
    assert int(row["met"]) == 0
    assert float(row["value"]) == pytest.approx(1.163, rel=0.01)
    depth = result.data["depth"].to_dataset().sel(camera="m").isel(distance=-1)
    assert float(depth["depth_uncertainty"]) == pytest.approx(0.938, rel=0.01)
    assert float(depth["depth_error_radius"]) == pytest.approx(1.163, rel=0.01)
    assert float(depth["depth_error_radius_error"]) < 0.01
    # The curve that is drawn beside the required 1 m shows what misses it.
    assert "Of midpoint, the error radius is drawn" in figures.build(result.data)["whole_range"].caption
    drawn = figures.figure(result.data, "whole_range").axes[0].get_lines()
    curve = next(line for line in drawn if line.get_gid() == "judged_uncertainty/m")
    assert np.asarray(curve.get_ydata())[-1] == pytest.approx(1163.0, rel=0.01)
    assert curve_values(result.data)["judged_uncertainty/m"].value[-1] == pytest.approx(1.163, rel=0.01)
    (biased,) = (line for line in terminal_lines(result.data) if line.startswith("Biased"))
    assert "midpoint" in biased
    assert "too near" in biased
    assert "disparity" not in biased  # whose median is right
