"""Values with their numerical errors in arithmetic, in NumPy and beside other packages."""

from __future__ import annotations

import copy
import math
import pickle

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tradestudy import optics
from tradestudy.optics import Measured

ONE = Measured(value=np.array(4.0), error=np.array(1e-3))
THREE = Measured(value=np.array([1.0, 2.0, 3.0]), error=np.array([0.01, 0.02, 0.03]))
positive = st.floats(0.5, 50.0)
small = st.floats(1e-6, 1e-3)


@given(x=positive, y=positive, dx=small, dy=small)
def test_errors_propagate_by_the_derivatives(x: float, y: float, dx: float, dy: float) -> None:
    a, b = (Measured(value=np.array(v), error=np.array(e)) for v, e in ((x, dx), (y, dy)))
    for found, value, error in (
        (a + b, x + y, dx + dy),
        (a - b, x - y, dx + dy),
        (a * b, x * y, y * dx + x * dy),
        (a / b, x / y, dx / y + x * dy / y**2),
        (3.0 * a, 3.0 * x, 3.0 * dx),
        (1.0 - a, 1.0 - x, dx),
        (np.log(a), math.log(x), dx / x),
        (a**2, x * x, 2.0 * x * dx),
    ):
        assert float(found) == pytest.approx(value, rel=1e-12, abs=1e-12)
        assert float(found.error) == pytest.approx(error, rel=5e-3, abs=1e-12)


@given(x=positive, y=positive, dx=small, dy=small, s=st.floats(-1.0, 1.0), t=st.floats(-1.0, 1.0))
def test_the_error_bounds_what_values_within_the_errors_can_give(
    x: float, y: float, dx: float, dy: float, s: float, t: float
) -> None:
    found = Measured(value=np.array(x), error=np.array(dx)) * np.exp(Measured(value=np.array(-y), error=np.array(dy)))
    assert abs((x + s * dx) * math.exp(-y + t * dy) - float(found)) <= float(found.error) * (1.0 + 2e-3)


def test_where_a_function_ends_the_error_is_one_sided() -> None:
    root = np.sqrt(Measured(value=np.array(0.0), error=np.array(1e-4)))
    assert float(root.error) == pytest.approx(1e-2)


def test_a_value_is_a_number_and_values_are_an_array() -> None:
    assert float(ONE) == 4.0
    assert math.sqrt(ONE) == 2.0
    assert (round(ONE / 3.0), round(ONE / 3.0, 2)) == (1, 1.33)
    assert (ONE < 5, ONE == 4.0, ONE > 5, bool(ONE)) == (True, True, False, True)
    assert (f"{ONE:.2f}", f"{ONE}", f"{ONE.value:.1f}") == ("4.00", "4 ± 0.001", "4.0")
    np.testing.assert_array_equal(THREE, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(THREE > 1.5, [False, True, True])
    assert np.asarray(THREE, dtype=np.float32).dtype == np.float32
    assert (np.sum(THREE), np.interp(1.5, [1, 2, 3], THREE), len(THREE)) == (6.0, 1.5, 3)
    assert pd.Series(THREE).tolist() == [1.0, 2.0, 3.0]
    assert [float(one.error) for one in THREE] == [0.01, 0.02, 0.03]
    assert THREE[1:].error.tolist() == [0.02, 0.03]
    summed = np.zeros(3)
    summed += THREE
    assert summed.tolist() == [1.0, 2.0, 3.0]


def test_arrays_on_either_side_and_of_either_shape() -> None:
    for found in (np.arange(3.0) * ONE, ONE * np.arange(3.0)):
        assert isinstance(found, Measured)
        np.testing.assert_allclose(found, [0.0, 4.0, 8.0])
        np.testing.assert_allclose(found.error, [0.0, 1e-3, 2e-3], rtol=1e-9)
    assert (ONE * THREE).error.tolist() == pytest.approx([0.041, 0.082, 0.123])


def test_what_has_no_meaning_is_refused() -> None:
    for meaningless in (lambda: float(THREE), lambda: list(ONE), lambda: len(ONE), lambda: hash(ONE)):
        with pytest.raises(TypeError):
            meaningless()
    with pytest.raises(ValueError, match="ambiguous"):
        bool(THREE == THREE)


def test_it_is_copied_and_pickled() -> None:
    for other in (copy.deepcopy(THREE), pickle.loads(pickle.dumps(THREE))):
        np.testing.assert_array_equal(other.value, THREE.value)
        np.testing.assert_array_equal(other.error, THREE.error)


def test_measures_of_a_spot_are_used_without_unwrapping() -> None:
    psf = optics.point_spread(focal_length=50e-3, f_number=8, wavelength=550e-9)
    lost = 1.0 - psf.strehl_ratio()
    assert abs(float(lost)) <= float(lost.error) + 1e-4
    mtf = psf.modulation_transfer([0.0, 100e3])
    assert np.asarray(mtf).shape == (2,)
    ratio = mtf[1] / mtf[0]
    assert float(ratio.error) == pytest.approx(mtf.error[1] / mtf.value[0] + mtf.value[1] * mtf.error[0], rel=0.05)
