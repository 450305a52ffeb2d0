"""Standard normal scores of independent scrambles, shared by all cameras, distances and designs."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Final, TypeVar

import numpy as np

from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.sobol import scrambled_sobol
from tradestudy.uncertainty.streams import point_generator

Result = TypeVar("Result")

BATCH_DRAWS: Final = 2**14
"""Draws processed at a time, a power of two: a few of their arrays fit into a cache."""

# Numbers of cached scrambles: in ten dimensions, one of 2¹² draws takes 0.3 MB, one of 2¹⁷ draws 10 MB.
_FEW_DRAWS: Final = 2**12
_KEPT_OF_FEW, _KEPT_OF_MANY = 256, 16


def scramble_scores(dimensions: int, draws: int, *, seed: int, point: str, scramble: int) -> FloatArray:
    """Independent standard normal scores at the points of one scrambled Sobol sequence.

    Parameters
    ----------
    dimensions : int
        Number of scores per draw, >= 0.
    draws : int
        Number of draws, a power of two; a smaller number gives the first draws of a larger one.
    seed, point, scramble
        Identity of the random stream (see :func:`tradestudy.uncertainty.streams.point_generator`).

    Returns
    -------
    array, shape (dimensions, draws)
        Read-only, because the last few arrays are cached; independent of the order of requests.

    Raises
    ------
    OutOfRangeError
        The seed or the number of the scramble is negative.
    """
    return (_few if draws <= _FEW_DRAWS else _many)(dimensions, draws, seed, point, scramble)


@lru_cache(maxsize=_KEPT_OF_FEW)
def _few(dimensions: int, draws: int, seed: int, point: str, scramble: int) -> FloatArray:
    return _scores(dimensions, draws, seed, point, scramble)


@lru_cache(maxsize=_KEPT_OF_MANY)
def _many(dimensions: int, draws: int, seed: int, point: str, scramble: int) -> FloatArray:
    return _scores(dimensions, draws, seed, point, scramble)


def _scores(dimensions: int, draws: int, seed: int, point: str, scramble: int) -> FloatArray:
    from scipy.special import ndtri  # imported here, so that checking a study does not load it

    uniform = scrambled_sobol(dimensions, point_generator(seed=seed, point=point, replicate=scramble))
    scores = np.empty((dimensions, draws))
    for start in range(0, draws, BATCH_DRAWS):
        batch = scores[:, start : start + BATCH_DRAWS]
        ndtri(uniform(batch.shape[1]), out=batch)
    scores.setflags(write=False)
    return scores


def each_scramble(task: Callable[[int], Result], scrambles: int) -> list[Result]:
    """Results of a task for every scramble, in order, computed on as many threads as there are processors.

    numpy releases Python's global lock. A task that depends only on its number gives bit-identical results on any
    number of threads.
    """
    with ThreadPoolExecutor(max_workers=min(scrambles, os.cpu_count() or 1)) as threads:
        return list(threads.map(task, range(scrambles)))
