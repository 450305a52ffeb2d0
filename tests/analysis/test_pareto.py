"""The Pareto front against the definition, pair by pair."""

from __future__ import annotations

import numpy as np
import pytest

from tradestudy.answers.trade_off import non_dominated


def by_definition(values: np.ndarray, maximise: list[bool]) -> list[bool]:
    """Compare every pair of alternatives, each criterion with its own sign."""

    def beats(one: np.ndarray, other: np.ndarray) -> bool:
        better = [a > b if more else a < b for a, b, more in zip(one, other, maximise, strict=True)]
        worse = [a < b if more else a > b for a, b, more in zip(one, other, maximise, strict=True)]
        return any(better) and not any(worse) and not np.isnan(one).any()

    return [not np.isnan(row).any() and not any(beats(other, row) for other in values) for row in values]


@pytest.mark.parametrize("criteria", [1, 2, 3, 5])
@pytest.mark.parametrize("levels", [3, 1000])
def test_the_front_follows_the_definition(criteria: int, levels: int) -> None:
    """Few levels make ties and duplicates; some values are NaN or infinite."""
    rng = np.random.default_rng(criteria * levels)
    for _ in range(40):
        values = rng.integers(0, levels, size=(60, criteria)).astype(float)
        values[rng.random(values.shape) < 0.02] = np.nan
        values[rng.random(values.shape) < 0.02] = np.inf
        values[rng.random(values.shape) < 0.02] = -np.inf
        maximise = list(rng.random(criteria) < 0.5)
        assert non_dominated(values, maximise).tolist() == by_definition(values, maximise)


def test_duplicates_stay_together_and_the_sign_of_zero_is_ignored() -> None:
    values = np.array([[0.0, 1.0], [-0.0, 1.0], [1.0, 0.0], [1.0, 1.0], [np.nan, -9.0]])
    assert non_dominated(values, [False, False]).tolist() == [True, True, True, False, False]
    assert non_dominated(values, [True, True]).tolist() == [False, False, False, True, False]
    assert non_dominated(np.full((2, 2), np.nan), [True, True]).tolist() == [False, False]
    assert non_dominated(np.empty((0, 2)), [True, True]).tolist() == []
