"""Tables read by the kernel of nonuniform transforms, against plane waves in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tradestudy.optics.chain.array_field import TableKernel, fast_count


@pytest.mark.parametrize("oversampling", [1.5, 2.0, 2.5])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-5, 1e-6, 1e-7])
def test_a_table_is_interpolated_to_its_tolerance_up_to_its_band(oversampling: float, tolerance: float) -> None:
    kernel = TableKernel.within(oversampling, tolerance)
    rng, count = np.random.default_rng(4), (fast_count(160), fast_count(143))
    at = [rng.uniform(kernel.end_effect, n - 1 - kernel.end_effect, 300) for n in count]
    at[0][:50] = kernel.end_effect
    for share in (0.1, 0.5, 0.9):  # of the largest frequency
        wave = [share * math.pi / oversampling * sign for sign in (1.0, -0.7)]
        table = np.exp(1j * np.add.outer(wave[0] * np.arange(count[0]), wave[1] * np.arange(count[1])))
        read = kernel.interpolated(kernel.coefficients(table), *at)
        assert np.max(np.abs(read - np.exp(1j * (wave[0] * at[0] + wave[1] * at[1])))) < 10 * tolerance


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("oversampling", [1.2, 1.5, 2.5])
def test_the_smallest_table_can_be_interpolated(tolerance: float, oversampling: float) -> None:
    kernel = TableKernel.within(oversampling, tolerance)
    count = fast_count(1.0)
    coefficients = kernel.coefficients(np.ones((count, count), dtype=complex))
    middle = np.array([(count - 1) / 2])
    np.testing.assert_allclose(kernel.interpolated(coefficients, middle, middle), 1.0, atol=10 * tolerance)


def test_a_table_is_dark_outside() -> None:
    kernel = TableKernel.within(2.0, 1e-4)
    coefficients = kernel.coefficients(np.ones((33, 41), dtype=complex))
    rows, columns = np.array([-0.5, 33.5, 16.0, 16.0, 16.0]), np.array([20.0, 20.0, -3.0, 41.2, 20.0])
    np.testing.assert_allclose(kernel.interpolated(coefficients, rows, columns), [0, 0, 0, 0, 1], atol=1e-3)
