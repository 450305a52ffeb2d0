"""Sums of normal and uniform errors against direct quadrature at 30 digits and exact special cases."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.sum_of_errors import SumOfErrors


def reference(x: float, sigma: float, half_width: float) -> float:
    """P(N(0, σ²) + U(−h, h) ≤ x), the normal distribution averaged over the uniform."""
    with mpmath.workdps(30):
        points = sorted(
            {-half_width, half_width, *(p for p in (x - 3 * sigma, x, x + 3 * sigma) if abs(p) < half_width)}
        )
        integral = mpmath.quad(lambda t: mpmath.ncdf((x - t) / mpmath.mpf(sigma)), points)
        return float(integral / (2 * mpmath.mpf(half_width)))


@pytest.mark.parametrize("sigma", [1e-4, 0.1, 1.0, 30.0, 900.0])
@pytest.mark.parametrize("x", [-1.3, -0.9, 0.0, 0.4, 1.0])
def test_normal_and_one_uniform_to_1e_12(x: float, sigma: float) -> None:
    errors = SumOfErrors.of([np.array([sigma])], [np.array([1 / np.sqrt(3)])], (1,))
    assert errors.cumulative(x)[0] == pytest.approx(reference(x, sigma, 1.0), abs=1e-12)


def test_normals_alone_add_in_quadrature() -> None:
    errors = SumOfErrors.of([np.array([3.0]), np.array([4.0])], [], (1,))
    assert errors.standard_deviation == pytest.approx([5.0])
    assert errors.quantile(0.975) == pytest.approx([5 * 1.959963984540054], rel=1e-14)


def test_one_uniform_alone_is_exact() -> None:
    errors = SumOfErrors.of([], [np.array([1 / np.sqrt(3)])], (1,))
    assert errors.quantile(0.975) == pytest.approx([0.95], rel=1e-12)
    assert errors.cumulative(np.array([-2.0, -1.0, 0.5, 1.0])) == pytest.approx([0.0, 0.0, 0.75, 1.0], abs=1e-12)


def test_two_equal_uniforms_make_a_triangle() -> None:
    deviation = np.array([1 / np.sqrt(3)])
    two = SumOfErrors.of([], [deviation, deviation], (1,))
    for x in (-1.2, -0.3, 0.0, 0.9):
        assert two.cumulative(x)[0] == pytest.approx(
            float((2 + x) ** 2 / 8 if x < 0 else 1 - (2 - x) ** 2 / 8), abs=1e-4
        )


def test_three_uniforms_are_refused_with_a_remedy() -> None:
    with pytest.raises(OutOfRangeError, match="at most 2"):
        SumOfErrors.of([], [np.array([1.0])] * 3, (1,))


def test_quantile_inverts_cumulative() -> None:
    errors = SumOfErrors.of([np.array([0.1, 1.0, 0.0])], [np.array([1.0, 1.0, 1.0])], (3,))
    for probability in (0.001, 0.025, 0.5, 0.84, 0.999):
        assert errors.cumulative(errors.quantile(probability)) == pytest.approx(probability, abs=1e-12)


def test_zero_errors_are_a_step_and_infinite_bounds_are_certain() -> None:
    errors = SumOfErrors.of([np.array([0.0])], [], (1,))
    assert errors.cumulative(np.array([-1e-9, 0.0, 1e-9])) == pytest.approx([0.0, 1.0, 1.0])
    normal = SumOfErrors.of([np.array([1.0])], [np.array([2.0])], (1,))
    assert normal.cumulative(np.array([-np.inf, np.inf])) == pytest.approx([0.0, 1.0])
