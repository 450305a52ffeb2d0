"""A matcher that is known is found again from its errors."""

from __future__ import annotations

import numpy as np
import pytest

from tradestudy.imaging.estimation import fit_errors


@pytest.mark.parametrize(
    ("factor", "floor", "false"), [(1.0, 0.0, 0.0), (1.5, 0.0, 0.01), (1.2, 0.08, 0.0), (1.0, 0.05, 0.03)]
)
def test_a_known_matcher_is_found_within_its_errors(factor: float, floor: float, false: float) -> None:
    rng = np.random.default_rng(7)
    bound = np.exp(rng.uniform(np.log(0.01), np.log(0.3), 20_000))
    error = rng.standard_normal(bound.size) * np.hypot(factor * bound, floor)
    wrong = rng.random(bound.size) < false
    error[wrong] = 40.0 * rng.uniform(0.5, 1.0, np.count_nonzero(wrong)) * rng.choice([-1.0, 1.0], wrong.sum())
    found = fit_errors(error, bound, float(bound.size))
    assert found.matcher.factor == pytest.approx(factor, abs=4.0 * found.factor_error)
    assert found.matcher.floor == pytest.approx(floor, abs=4.0 * found.floor_error)
    assert found.matcher.false_matches == pytest.approx(false, abs=4.0 * found.false_matches_error)
    assert found.factor_error < 0.05
    assert found.floor_error < 0.02
    assert found.declaration.startswith("matcher: {factor: ")
