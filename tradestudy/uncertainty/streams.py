"""Reproducible uniform points: one counter-based stream per seed, study point and replicate."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import FloatArray

UniformStream = Callable[[int], FloatArray]
"""Returns the next n points of a sequence in the open unit cube, shape (dimensions, n)."""

Sampler = Callable[[int, np.random.Generator], UniformStream]
"""Starts a stream of points with the given number of dimensions."""


def point_generator(*, seed: int, point: str, replicate: int) -> np.random.Generator:
    """Random generator of one study point and replicate: Philox, keyed by a hash of seed, point and replicate.

    The stream depends neither on the number of other points, nor on the workers or the order that compute them.

    Parameters
    ----------
    seed : int
        Seed of the study, >= 0; zero is a seed like any other.
    point : str
        Identity of the study point.
    replicate : int
        Number of the independent replicate, >= 0.

    Raises
    ------
    OutOfRangeError
        The seed or the replicate is negative.
    """
    if seed < 0 or replicate < 0:
        raise OutOfRangeError(
            "seed and replicate of a random stream",
            value=f"{seed}, {replicate}",
            limit=">= 0",
            remedy="zero is a valid seed",
        )
    digest = hashlib.blake2b(f"{seed}\0{replicate}\0{point}".encode(), digest_size=16).digest()
    # Sobol sequences spawn generators from a seed sequence.
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(int.from_bytes(digest, "little"))))


def fixed_order_product(matrix: FloatArray, columns: FloatArray) -> FloatArray:
    """Compute matrix @ columns in a fixed order of summation, so that no column depends on its batch."""
    product = np.zeros((matrix.shape[0], columns.shape[1]))
    for row, weights in zip(product, matrix, strict=True):
        for weight, coordinate in zip(weights, columns, strict=True):
            if weight != 0.0:
                row += weight * coordinate
    return product


def plain_random(dimensions: int, rng: np.random.Generator) -> UniformStream:
    """Independent uniform points: plain Monte Carlo, to compare Sobol points with."""
    below_all = 2.0**-54  # replaces an exact 0, which numpy can return
    return lambda n: np.maximum(np.ascontiguousarray(rng.random((n, dimensions)).T), below_all)
