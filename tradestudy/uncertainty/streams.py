"""Random streams: identified by seed and point, scrambled Sobol points, and standard normal scores made from them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from importlib import resources
from itertools import islice
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import FloatArray

UniformStream = Callable[[int], FloatArray]
"""Returns the next n points of a sequence in the open unit cube, shape (dimensions, n)."""


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


Bits = NDArray[np.uint64]

MOST_DIMENSIONS: Final = 1024
"""Dimensions for which direction numbers are stored."""

# 52 bits leave room for an offset of half a cell in a double, so that no coordinate is ever 0 or 1.
_BITS: Final = 52
_HALF_CELL: Final = 2.0 ** -(_BITS + 1)
_WEIGHTS: Final = 2 ** np.arange(_BITS - 1, -1, -1, dtype=np.uint64)
_BELOW: Final = np.tril(np.ones((_BITS, _BITS)), -1)
_BLOCK_BITS: Final = 10


def scrambled_sobol(dimensions: int, rng: np.random.Generator) -> UniformStream:
    """Start a Sobol sequence under a random linear matrix scramble and digital shift.

    Every point is uniform on the cube, so that estimates are unbiased, and independent scrambles give their error.
    Request powers of two to keep the points balanced.

    The generator matrix of a dimension is L C over GF(2): C from the direction numbers of Joe and Kuo (2008), L lower
    triangular with ones on its diagonal and random bits below it (Matoušek 1998). Points follow in Gray-code order
    (Antonov and Saleev 1979).

    Parameters
    ----------
    dimensions : int
        Number of coordinates of a point, 0 to 1024.
    rng : numpy.random.Generator
        Source of the scramble.

    Returns
    -------
    callable
        Returns the next n points in the open unit cube, shape (dimensions, n), n >= 1.

    Raises
    ------
    OutOfRangeError
        There are more dimensions than direction numbers.
    """
    if dimensions > MOST_DIMENSIONS:
        raise OutOfRangeError(
            "dimensions of a Sobol sequence",
            value=str(dimensions),
            limit=f"<= {MOST_DIMENSIONS}",
            remedy="combine error sources, or leave out those that hardly contribute",
        )
    if dimensions == 0:
        return lambda n: np.empty((0, n))
    shift, columns = _scrambled(dimensions, rng.spawn(1)[0])  # other draws from rng stay as they are
    drawn = 0

    def next_points(n: int) -> FloatArray:
        nonlocal drawn
        points = np.multiply(_points(shift, columns, drawn, n), 2.0**-_BITS, dtype=np.float64)
        drawn += n
        points += _HALF_CELL
        return points

    return next_points


def _scrambled(dimensions: int, rng: np.random.Generator) -> tuple[Bits, Bits]:
    """Shift, shape (dimensions,), and the bits that each bit of a point's number flips, (dimensions, bits)."""
    shift = rng.integers(2, size=(dimensions, _BITS), dtype=np.uint64) @ _WEIGHTS[::-1]
    scramble = rng.integers(2, size=(dimensions, _BITS, _BITS), dtype=np.uint64) * _BELOW + np.eye(_BITS)
    # Products of matrices are fast in floating point, and exact for sums below 2^53.
    generators = (scramble @ _direction_bits(dimensions)).astype(np.int64) & 1
    columns = (_WEIGHTS.astype(float) @ generators).astype(np.uint64)
    columns[:, 1:] ^= columns[:, :-1].copy()  # number n selects the bits of its Gray code, n ^ (n >> 1)
    return shift, columns


@lru_cache(maxsize=4)
def _direction_bits(dimensions: int) -> FloatArray:
    """Generator matrices C, shape (dimensions, bits, bits); row i holds the bits of value 2^-(i + 1)."""
    directions = np.array([_direction_numbers(*line) for line in _lines(dimensions)], dtype=np.uint64)
    return ((directions[:, None, :] // _WEIGHTS[:, None]) % 2).astype(float)


def _lines(dimensions: int) -> list[list[int]]:
    """The primitive polynomial, in binary, and the first direction numbers of each dimension."""
    with (resources.files(__package__) / "joe_kuo.txt").open(encoding="utf-8") as table:
        return [[1], *([int(number) for number in line.split()] for line in islice(table, dimensions - 1))]


def _direction_numbers(polynomial: int, *first: int) -> list[int]:
    """Continue direction numbers m_j by the recurrence of their primitive polynomial, as m_j 2^(bits - j)."""
    degree = len(first)
    m = list(first) or [1] * _BITS  # the first dimension, van der Corput's sequence, has no recurrence
    for j in range(len(m), _BITS):
        following = m[j - degree]
        for k in range(1, degree + 1):
            if polynomial >> (degree - k) & 1:
                following ^= m[j - k] << k
        m.append(following)
    return [number << (_BITS - 1 - j) for j, number in enumerate(m)]


def _points(shift: Bits, columns: Bits, start: int, n: int) -> Bits:
    """Points number start to start + n - 1, block by block: a point is linear in the bits of its number."""
    low_bits = min(_BLOCK_BITS, (n - 1).bit_length())
    within = np.zeros((len(shift), 1), dtype=np.uint64)
    for column in columns[:, :low_bits].T:
        within = np.concatenate([within, within ^ column[:, None]], axis=1)
    blocks = np.arange(start >> low_bits, ((start + n - 1) >> low_bits) + 1)
    first_of = np.repeat(shift[:, None], len(blocks), axis=1)
    for bit in range(int(blocks[-1]).bit_length()):
        first_of[:, (blocks >> bit) & 1 == 1] ^= columns[:, low_bits + bit, None]
    skipped = start - (int(blocks[0]) << low_bits)
    return (first_of[:, :, None] ^ within[:, None, :]).reshape(len(shift), -1)[:, skipped : skipped + n]


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


def _scores(dimensions: int, draws: int, seed: int, point: str, scramble: int) -> FloatArray:
    from scipy.special import ndtri  # imported here, so that checking a study does not load it

    uniform = scrambled_sobol(dimensions, point_generator(seed=seed, point=point, replicate=scramble))
    scores = np.empty((dimensions, draws))
    for start in range(0, draws, BATCH_DRAWS):
        batch = scores[:, start : start + BATCH_DRAWS]
        ndtri(uniform(batch.shape[1]), out=batch)
    scores.setflags(write=False)
    return scores


_few, _many = lru_cache(maxsize=_KEPT_OF_FEW)(_scores), lru_cache(maxsize=_KEPT_OF_MANY)(_scores)


def each_scramble(task: Callable[[int], Result], scrambles: int) -> list[Result]:
    """Results of a task for every scramble, in order, computed on as many threads as there are processors.

    numpy releases Python's global lock. A task that depends only on its number gives bit-identical results on any
    number of threads.
    """
    with ThreadPoolExecutor(max_workers=min(scrambles, os.cpu_count() or 1)) as threads:
        return list(threads.map(task, range(scrambles)))
