"""Scrambled Sobol points, equal to those of :class:`scipy.stats.qmc.Sobol` without the import of scipy.stats."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from itertools import islice
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.streams import UniformStream

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
