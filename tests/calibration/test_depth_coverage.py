"""Do stated intervals of depth cover, for every kind and source? A sample of `benchmarks.calibration`."""

import numpy as np
import pytest

from tests.calibration.coverage import coverage_verdict, run_trials
from tests.calibration.depth_coverage import CASES, COVERAGES, by_corners, by_errors, by_target

KINDS = tuple(CASES)
LEVEL = 1e-4  # of one source and kind: a right program fails once in a thousand runs with other seeds


def judge(covered):
    """Both contents, near linear and far from it, by exact binomial tests."""
    for k, coverage in enumerate(COVERAGES):
        verdict = coverage_verdict(covered[:, 2 * k : 2 * k + 2], nominal=coverage, level=LEVEL)
        assert verdict.passed, (coverage, verdict)


@pytest.mark.parametrize("kind", KINDS)
def test_plain_cameras_and_the_program_read_the_same(kind):
    """Two codes, one written from drawings: every error and noise, to rounding; beyond infinity by its sign alone."""
    case, rng = CASES[kind](), np.random.default_rng(0)
    distances = np.array([case.near, 0.3, case.far])
    errors = {name: deviation * rng.standard_normal((50, 1)) for name, deviation in case.errors.items()}
    noise = case.noise * rng.standard_normal((50, 3))
    found = case.camera.read(distances, 0.0, {**errors, "pixel_noise": noise}).inverse_depth
    expected = case.plain({}, errors, distances, noise)
    np.testing.assert_allclose(found[expected > 0.0], expected[expected > 0.0], rtol=0.0, atol=1e-11)
    assert np.all(found[expected <= 0.0] <= 0.0)
    assert np.any(expected <= 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_intervals_by_declared_errors_cover(kind):
    judge(by_errors(CASES[kind](), 20_000, 0))


@pytest.mark.parametrize("kind", KINDS)
def test_intervals_by_a_target_cover(kind):
    case = CASES[kind]()
    judge(run_trials(lambda rng: by_target(case, rng), 100, 0).astype(bool))


@pytest.mark.parametrize("kind", KINDS)
def test_intervals_by_a_saved_posterior_cover(kind, tmp_path):
    case = CASES[kind]()
    judge(run_trials(lambda rng: by_target(case, rng, folder=tmp_path), 20, 1).astype(bool))


@pytest.mark.slow
def test_intervals_by_corners_cover():
    judge(run_trials(by_corners, 6, 0).astype(bool))


def test_intervals_that_are_a_third_too_short_are_caught():
    """By the same judge: 68.27 % at two thirds of its width holds 49.6 %."""
    rng = np.random.default_rng(0)
    scores = np.abs(rng.standard_normal((2000, 4)))
    with pytest.raises(AssertionError):
        judge(scores < np.array([1.0, 1.0, 1.96, 1.96]) * 2.0 / 3.0)
