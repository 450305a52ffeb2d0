"""What a real matcher adds to the bound of matching, against simulated disparities and against the bound itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.imaging.test_picture import CLOSED, SETTINGS, hand_lens
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.models import AT_BOUND, Matcher
from tradestudy.imaging.picture import PictureDisparityError, at_bound

PLACES = np.array([50e-3, 55e-3, 58e-3])
BOUND = PictureDisparityError(settings=SETTINGS, models=CLOSED)
REAL = Matcher(factor=1.4, floor=0.03, pixel_locking=0.05, false_matches=0.02)


def test_noise_floor_and_locking_scatter_as_simulated() -> None:
    """Disparities measured with noise, a floor and a periodic bias of unknown phase, drawn one by one."""
    rng, draws, bound = np.random.default_rng(3), 400_000, 0.04
    phase = rng.uniform(0.0, 2.0 * np.pi, draws)
    off = rng.normal(0.0, 1.4 * bound, draws) + rng.normal(0.0, 0.03, draws) + 0.05 * np.sin(2.0 * np.pi * 7.3 + phase)
    assert float(REAL.error_px(bound)) == pytest.approx(float(np.std(off)), rel=5e-3)
    # By hand: 0.056² + 0.03² + 0.05²/2 = 0.005286.
    assert float(REAL.error_px(bound)) == pytest.approx(math.sqrt(0.005286), rel=1e-12)


def test_each_value_acts_alone() -> None:
    assert float(Matcher(factor=2.0).error_px(0.04)) == pytest.approx(0.08)
    assert float(Matcher(floor=0.03).error_px(0.04)) == pytest.approx(0.05)
    assert float(Matcher(pixel_locking=0.03 * math.sqrt(2.0)).error_px(0.04)) == pytest.approx(0.05)
    assert float(Matcher(false_matches=0.1).error_px(0.04)) == 0.04


def test_light_removes_the_bound_and_leaves_the_floor() -> None:
    np.testing.assert_allclose(Matcher(factor=3.0, floor=0.03).error_px([0.0, 1e-9]), 0.03, rtol=1e-9)
    assert np.isinf(REAL.error_px(np.inf))
    assert np.isnan(REAL.error_px(np.nan))


@pytest.mark.parametrize("bound", [1e-4, 0.02, 0.2])
@pytest.mark.parametrize("factor", [0.7, 1.0, 1.6])
def test_a_change_of_the_bound_changes_the_error_by_less(bound: float, factor: float) -> None:
    truth = float(REAL.error_px(factor * bound)) / float(REAL.error_px(bound))
    assert float(REAL.change(bound, factor)) == pytest.approx(truth, rel=1e-12)
    assert float(AT_BOUND.change(bound, factor)) == factor
    step = 1e-6 * bound
    slope = (float(REAL.error_px(bound + step)) - float(REAL.error_px(bound - step))) / 2.0
    assert float(REAL.numerical_error_px(bound, step)) == pytest.approx(slope, rel=1e-4)


def test_changes_of_unknown_bounds_are_unknown() -> None:
    np.testing.assert_array_equal(REAL.change([np.nan, np.inf, 0.0], [1.2, 1.2, np.inf]), [1.2, 1.2, np.inf])
    assert float(REAL.change(0.0, 5.0)) == 1.0  # the rest is all there is


def test_the_best_matcher_changes_nothing() -> None:
    camera, law = hand_lens(), replace(BOUND, matcher=Matcher(factor=1.0, floor=0.0))
    assert law == BOUND
    np.testing.assert_array_equal(law.error_px(camera, PLACES), BOUND.bound_px(camera, PLACES))
    np.testing.assert_array_equal(law.numerical_error_px(camera, PLACES), BOUND.derived(camera, PLACES).error)
    assert law.false_matches == 0.0
    assert AT_BOUND.words == ""


def test_a_matcher_adds_to_the_error_and_keeps_the_picture_s_statements() -> None:
    camera, law = hand_lens(), replace(BOUND, matcher=REAL)
    bound = BOUND.error_px(camera, PLACES)
    np.testing.assert_allclose(
        law.error_px(camera, PLACES) ** 2, (1.4 * bound) ** 2 + 0.03**2 + 0.05**2 / 2, rtol=1e-12
    )
    for mine, plain in ((law.limit, BOUND.limit), (law.saturation, BOUND.saturation)):
        np.testing.assert_array_equal(mine(camera, PLACES).value, plain(camera, PLACES).value)
    assert np.isnan(law.error_px(camera, 10e-3))  # no picture, whoever matches it
    real = replace(camera, disparity_error_px=law)
    assert at_bound(real) == replace(camera, disparity_error_px=BOUND)
    assert at_bound(camera) is camera


@pytest.mark.parametrize(
    ("values", "limit"),
    [
        ({"factor": 0.9}, "1 or more"),
        ({"factor": math.inf}, "1 or more"),
        ({"floor": -0.1}, "0 px or more"),
        ({"pixel_locking": 0.6}, "from 0 to 0.5 px"),
        ({"false_matches": 1.0}, "from 0 to below 1"),
        ({"false_matches": math.nan}, "from 0 to below 1"),
    ],
)
def test_impossible_matchers_are_refused(values: dict[str, float], limit: str) -> None:
    with pytest.raises(OutOfRangeError, match=limit):
        Matcher(**values)
