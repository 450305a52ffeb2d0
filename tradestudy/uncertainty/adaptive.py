"""The adaptive Monte Carlo rule of JCGM 101, offered as a comparison and not as the rule of this package.

Its tolerance grows with the standard uncertainty that it estimates, so it declares convergence even where
no standard uncertainty exists.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.evaluation import UNALIGNED, Model, Replicate
from tradestudy.uncertainty.linear import numerical_tolerance
from tradestudy.uncertainty.outputs import shortest_interval
from tradestudy.uncertainty.sources import Sources
from tradestudy.uncertainty.streams import plain_random

_BLOCK_DRAWS = 10_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Adaptive:
    """Result of the adaptive rule for one output: averages over blocks of 10⁴ draws, and their errors."""

    estimate: float
    standard_uncertainty: float
    shortest: tuple[float, float]
    standard_errors: tuple[float, float, float, float]
    tolerance: float
    draws: int
    status: str


def jcgm_adaptive(
    model: Model,
    sources: Sources,
    *,
    significant_digits: int,
    budget_draws: int,
    seed: int,
    point: str,
) -> Adaptive:
    """Draw plainly in blocks until twice the error of y, u and both ends is below half the last digit of u.

    Parameters
    ----------
    model : Model
        Vectorised model with a single output; outputs are taken as they come.
    sources : Sources
        What is uncertain.
    significant_digits : int
        Digits of u that are meant, 1 or 2.
    budget_draws : int
        Largest number of draws.
    seed, point
        Identity of the random stream.

    Returns
    -------
    Adaptive
        With ``status`` ``converged`` or ``budget``; NaN if a draw has no rank or is infinite, for the rule
        knows neither.

    Notes
    -----
    JCGM 101:2008, 7.9.4. The 95 % interval is the shortest.
    """
    blocks: list[tuple[float, float, float, float]] = []
    status, tolerance, error = "budget", np.nan, np.full(4, np.nan)
    while (len(blocks) + 1) * _BLOCK_DRAWS <= budget_draws:
        blocks.append(_block(model, sources, seed=seed, point=point, number=len(blocks)))
        if len(blocks) < 2:
            continue
        table = np.array(blocks)
        error = np.std(table, axis=0, ddof=1) / np.sqrt(len(blocks))
        u = _pooled_deviation(table)
        tolerance = float(numerical_tolerance(u, significant_digits))
        if bool(np.all(2.0 * error < tolerance)):
            status = "converged"
            break
    table = np.array(blocks)
    mean = np.mean(table, axis=0)
    return Adaptive(
        estimate=float(mean[0]),
        standard_uncertainty=_pooled_deviation(table),
        shortest=(float(mean[2]), float(mean[3])),
        standard_errors=(float(error[0]), float(error[1]), float(error[2]), float(error[3])),
        tolerance=tolerance,
        draws=len(blocks) * _BLOCK_DRAWS,
        status=status,
    )


def _block(model: Model, sources: Sources, *, seed: int, point: str, number: int) -> tuple[float, float, float, float]:
    """Mean, standard deviation and shortest interval of one block."""
    replicate = Replicate(
        model,
        sources,
        sampler=plain_random,
        seed=seed,
        point=point,
        replicate=number,
        alignment=UNALIGNED,
        inverse_depth=False,
    )
    replicate.lengthen(_BLOCK_DRAWS, _BLOCK_DRAWS)
    values = replicate.values[0]
    if not np.all(np.isfinite(values)):
        return (np.nan, np.nan, np.nan, np.nan)
    ends, _ = shortest_interval(np.sort(values))
    return (float(np.mean(values)), float(np.std(values, ddof=1)), float(ends[0]), float(ends[1]))


def _pooled_deviation(table: FloatArray) -> float:
    """Standard deviation of all draws from the means and deviations of equal blocks."""
    return float(np.sqrt(np.mean(table[:, 1] ** 2) + np.var(table[:, 0])))
