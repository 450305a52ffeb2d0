"""Decisions under uncertainty: which camera errs less, where curves cross, what stability is needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.evaluation import Model, Replicate, ScoreAlignment, alignment_with
from tradestudy.uncertainty.outputs import RunningMean, replicate_statistics
from tradestudy.uncertainty.sources import Sources
from tradestudy.uncertainty.streams import Sampler


@dataclass(frozen=True, kw_only=True)
class Draws:
    """How a comparison is sampled.

    Parameters
    ----------
    draws : int
        Draws per replicate, a power of two.
    replicates : int
        Independent replicates, >= 2; their scatter is the Monte Carlo error.
    sampler : Sampler
        Scrambled Sobol or plain random points.
    seed : int
        Seed of the study, >= 0.
    point : str
        Identity of the study point.
    batch_draws : int
        Draws per call of a model; never changes a result.

    Raises
    ------
    OutOfRangeError
        A number is outside its range.
    """

    draws: int
    replicates: int
    sampler: Sampler
    seed: int
    point: str
    batch_draws: int = 2**14

    def __post_init__(self) -> None:
        if self.draws < 2 or self.draws & (self.draws - 1) or self.replicates < 2:
            raise OutOfRangeError(
                "draws and replicates of a comparison",
                value=f"{self.draws}, {self.replicates}",
                limit="draws a power of two, replicates >= 2",
                remedy="the error comes from the scatter of independent replicates",
            )

    def depths(self, model: Model, sources: Sources, alignment: ScoreAlignment, replicate: int) -> Replicate:
        """Draw depths of one replicate from a model of inverse depth.

        The same replicate and alignment get the same random numbers whatever the model.
        """
        drawn = Replicate(
            model,
            sources,
            sampler=self.sampler,
            seed=self.seed,
            point=self.point,
            replicate=replicate,
            alignment=alignment,
            inverse_depth=True,
        )
        drawn.lengthen(self.draws, self.batch_draws)
        return drawn


@dataclass(frozen=True, kw_only=True, eq=False)
class RankProbability:
    """Which of two cameras errs less, per distance, with Monte Carlo standard errors.

    ``first`` + ``second`` + ``neither`` is one; ``neither`` holds draws in which both fail or both are
    infinite.
    """

    first: FloatArray
    first_error: FloatArray
    second: FloatArray
    neither: FloatArray


def rank_probability(
    first: Model, second: Model, sources: Sources, true_depth: FloatArray, draws: Draws
) -> RankProbability:
    """Probability that |depth error| of one camera is smaller than that of the other.

    With only the calibration classes of sources active this is the probability over calibrations. A draw
    without a result loses against one with a result; so does one at infinity against a finite one.

    Parameters
    ----------
    first, second : Model
        Models of inverse depth at the compared distances, outputs (draws, distances).
    sources : Sources
        The sources of both cameras together; what both share (temperature) is one source that both models
        read.
    true_depth : array, shape (distances,)
        True depth [m].
    draws : Draws
        How to sample.

    Raises
    ------
    OutOfRangeError
        A model returns an array of the wrong shape.
    """
    wins, losses = RunningMean(), RunningMean()
    alignment = alignment_with([first, second], sources)
    for replicate in range(draws.replicates):
        mine, theirs = (
            _absolute_error(draws.depths(model, sources, alignment, replicate), true_depth) for model in (first, second)
        )
        wins.add(np.mean(mine < theirs, axis=-1))
        losses.add(np.mean(theirs < mine, axis=-1))
    return RankProbability(
        first=wins.mean,
        first_error=wins.standard_error,
        second=losses.mean,
        neither=1.0 - wins.mean - losses.mean,
    )


def _absolute_error(replicate: Replicate, true_depth: FloatArray) -> FloatArray:
    """|depth − truth|, shape (distances, draws); +∞ without a result."""
    error = np.abs(replicate.values - np.asarray(true_depth, float)[:, None])
    return np.where(np.isnan(error), np.inf, error)


def half_width(model: Model, sources: Sources, draws: Draws, replicate: int) -> FloatArray:
    """Half the central 68.27 % interval of depth in one replicate, (outputs,); +∞ where unbounded.

    Parameters
    ----------
    model : Model
        Model of inverse depth.
    sources : Sources
        What is uncertain.
    draws : Draws
        How to sample.
    replicate : int
        Which replicate; the same one always uses the same random numbers.
    """
    drawn = draws.depths(model, sources, alignment_with([model], sources), replicate)
    return replicate_statistics(drawn.values, drawn.failures, depth=True).half_width


@dataclass(frozen=True, kw_only=True)
class Solution:
    """Where a quantity has the wanted value: mean over replicates, and its Monte Carlo standard error.

    The standard error is +∞ where not every replicate has a solution: more draws are needed to tell.
    """

    value: float
    standard_error: float


def solve_in_replicates(
    quantity: Callable[[float, int], float],
    *,
    low: float,
    high: float,
    replicates: int,
) -> Solution:
    """Find the argument at which a quantity is zero, in each replicate by bracketing, and average.

    For an inverse question ("which yaw stability gives a depth uncertainty of 9 mm?") the quantity is the
    logarithm of :func:`half_width` with sources made from the argument, over the wanted width.

    Parameters
    ----------
    quantity : callable (argument, replicate) -> float
        Continuous in its argument for a fixed replicate, of opposite sign at both ends; may be ±∞.
    low, high : float
        Ends of the bracket [unit of the argument].
    replicates : int
        Independent replicates, >= 2.

    Raises
    ------
    OutOfRangeError
        The sign does not change between the ends: the answer lies outside, with the values at both ends.
    """
    if replicates < 2:
        raise OutOfRangeError(
            "replicates of a solution", value=str(replicates), limit=">= 2", remedy="one has no error"
        )
    roots = RunningMean()
    for replicate in range(replicates):
        roots.add(np.array(_root(quantity, low, high, replicate)))
    return Solution(value=float(roots.mean), standard_error=float(roots.standard_error))


def _root(quantity: Callable[[float, int], float], low: float, high: float, replicate: int) -> float:
    """Root of one replicate; the hyperbolic tangent keeps its place and makes infinities finite."""
    ends = [float(np.tanh(quantity(end, replicate))) for end in (low, high)]
    if not ends[0] * ends[1] <= 0.0:
        raise OutOfRangeError(
            "the wanted value is not reached in the bracket",
            value=f"tanh of it is {ends[0]:.4g} at {low:.6g} and {ends[1]:.4g} at {high:.6g}",
            limit="values of opposite sign at the two ends",
            remedy="widen the bracket; if the sign stays, no value of the argument gives the wanted result",
        )
    return float(
        brentq(
            lambda argument: float(np.tanh(quantity(argument, replicate))),
            low,
            high,
            xtol=1e-300,
            rtol=1e-9,
        )
    )


def crossings(
    curve: Callable[[FloatArray, int], FloatArray], distances: FloatArray, *, replicates: int
) -> tuple[Solution, ...]:
    """All distances at which a curve changes sign, with the Monte Carlo error of each.

    For two uncertainty curves the curve is :func:`log_ratio` of their widths. This error is that of the
    sampling alone, and says nothing of readings and assumptions.

    Parameters
    ----------
    curve : callable (distances, replicate) -> array
        Vectorised over distances; NaN where it has no value.
    distances : array, shape (n,)
        Rising grid [m] that is fine enough to have at most one crossing per cell.
    replicates : int
        Independent replicates, >= 2.

    Returns
    -------
    tuple of Solution
        Rising; empty where the curves do not cross on the grid.
    """
    signs = _carried(np.sign(np.stack([curve(distances, replicate) for replicate in range(replicates)])))
    # The majority of replicates decides where to look.
    majority = _carried(np.sign(np.nansum(signs, axis=0)))
    cells = np.flatnonzero(majority[:-1] * majority[1:] < 0.0)
    return tuple(_crossing(curve, distances, signs, int(cell)) for cell in cells)


def _carried(signs: FloatArray) -> FloatArray:
    """Signs along the last axis with a zero counted to the side that it is reached from."""
    carried = signs.copy()
    for k in range(1, signs.shape[-1]):
        carried[..., k] = np.where(carried[..., k] == 0.0, carried[..., k - 1], carried[..., k])
    return carried


def _crossing(
    curve: Callable[[FloatArray, int], FloatArray], distances: FloatArray, signs: FloatArray, cell: int
) -> Solution:
    """One crossing, sought by each replicate in the cell of the majority and one more on either side."""
    first, last = max(cell - 1, 0), min(cell + 2, distances.size - 1)
    roots, missing = RunningMean(), 0
    for replicate, sign in enumerate(signs):
        change = np.flatnonzero(sign[first:last] * sign[first + 1 : last + 1] < 0.0)
        if change.size == 0:
            missing += 1
            continue
        left = first + int(change[0])
        low, high = float(distances[left]), float(distances[left + 1])
        roots.add(np.array(_root(lambda x, r: float(curve(np.array([x]), r)[0]), low, high, replicate)))
    error = float(roots.standard_error) if missing == 0 else np.inf
    return Solution(value=float(roots.mean), standard_error=error)


def log_ratio(first: FloatArray, second: FloatArray) -> FloatArray:
    """ln(first/second) of two widths >= 0; ±∞ where one is infinite or zero, NaN where both are."""
    first, second = np.broadcast_arrays(first, second)
    undecided = (np.isinf(first) & np.isinf(second)) | ((first == 0.0) & (second == 0.0))
    with np.errstate(divide="ignore"):  # the logarithm of a width of zero is meant to be −∞
        top, bottom = np.log(np.where(undecided, np.nan, first)), np.log(second)
    return np.where(undecided, np.nan, top - np.where(undecided, 0.0, bottom))
