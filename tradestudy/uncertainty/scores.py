"""Standard normal scores of independent scrambles: the draws that all cameras, distances and designs have in common."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Final, TypeVar

import numpy as np

from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.streams import point_generator, scrambled_sobol

Result = TypeVar("Result")

BATCH_DRAWS: Final = 2**14
"""Draws that are worked on at a time, a power of two: a few of their arrays fit into a cache."""

# Scrambles that are kept: 2¹² draws of ten dimensions are a third of a megabyte each, 2¹⁷ draws ten.
_FEW_DRAWS: Final = 2**12
_KEPT_OF_FEW, _KEPT_OF_MANY = 256, 16


def scramble_scores(dimensions: int, draws: int, *, seed: int, point: str, scramble: int) -> FloatArray:
    """Independent standard normal scores at the points of one scrambled Sobol sequence.

    Parameters
    ----------
    dimensions : int
        How many scores one draw takes, >= 0.
    draws : int
        How many draws, a power of two; fewer draws are the first of more.
    seed, point, scramble
        Identity of the random stream (see :func:`tradestudy.uncertainty.streams.point_generator`).

    Returns
    -------
    array, shape (dimensions, draws)
        Read-only: the last few are kept. They do not depend on who asks for them in which order.

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
    from scipy.special import ndtri  # a study is checked without it

    uniform = scrambled_sobol(dimensions, point_generator(seed=seed, point=point, replicate=scramble))
    scores = np.empty((dimensions, draws))
    for start in range(0, draws, BATCH_DRAWS):
        batch = scores[:, start : start + BATCH_DRAWS]
        ndtri(uniform(batch.shape[1]), out=batch)
    scores.setflags(write=False)
    return scores


def each_scramble(task: Callable[[int], Result], scrambles: int) -> list[Result]:
    """Results of a task for every scramble, in order, on as many threads as there are processors.

    Arrays are computed outside Python's lock. A task that depends on nothing but its number has the same results, bit
    for bit, on any number of threads.
    """
    with ThreadPoolExecutor(max_workers=min(scrambles, os.cpu_count() or 1)) as threads:
        return list(threads.map(task, range(scrambles)))
