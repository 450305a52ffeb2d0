"""Decisions under uncertainty: which camera errs less, and with what probability."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.evaluation import Model, Replicate, ScoreAlignment, alignment_with
from tradestudy.uncertainty.outputs import RunningMean
from tradestudy.uncertainty.sources import Sources
from tradestudy.uncertainty.streams import Sampler


@dataclass(frozen=True, kw_only=True)
class Draws:
    """The sampling of a comparison.

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
        Draws per call of a model; does not affect results.

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
                remedy="use a power of two and several replicates, whose scatter gives the error",
            )

    def depths(self, model: Model, sources: Sources, alignment: ScoreAlignment, replicate: int) -> Replicate:
        """Draw the depths of one replicate from a model of inverse depth.

        The same replicate and alignment give the same random numbers for every model.
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

    ``first`` + ``second`` + ``neither`` is one; ``neither`` contains draws in which both fail or both are
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

    If only calibration errors are drawn, this is the probability over calibrations. A draw without a result loses
    against one with a result, and an infinite depth against a finite one.

    Parameters
    ----------
    first, second : Model
        Models of inverse depth at the compared distances, outputs (draws, distances).
    sources : Sources
        The sources of both cameras together; a shared source, such as temperature, appears once.
    true_depth : array, shape (distances,)
        True depth [m].
    draws : Draws
        The sampling.

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
