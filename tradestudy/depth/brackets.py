"""Where to read next inside brackets that contain the zero of a margin."""

from __future__ import annotations

from typing import Final

import numpy as np

from tradestudy.optics.arrays import FloatArray, IndexArray

_OFF: Final = 0.1  # error of a cubic's zero, relative to the difference of the parabolas that it combines
_NEAREST: Final = (1e-7, 0.1)  # of a bracket: limits of the smallest distance from an estimate


def stencil(first: IndexArray, count: int) -> IndexArray:
    """Of ``count`` places in order, the two on either side of each bracket, by its first place; (4, brackets)."""
    start = np.clip(first - 1, 0, max(0, count - 4))
    return np.asarray(np.minimum(start + np.arange(4)[:, np.newaxis], count - 1))


def between(
    ends: tuple[FloatArray, FloatArray],
    around: tuple[FloatArray, FloatArray] | FloatArray,
    previous: FloatArray | float,
    sections: int,
    least: FloatArray | float = 0.0,
) -> FloatArray:
    """Places that divide brackets into sections, shape (sections − 1, brackets).

    They lie on both sides of the zero of the cubic through margins known around it, from far to near, down to the
    likely error of that zero. Where it is unknown, or the last round has narrowed a bracket less than equal sections
    would, they are equally spaced, so that a margin of any shape costs only more rounds.

    Parameters
    ----------
    ends
        Both ends of the brackets (brackets,).
    around
        Places around each bracket and the margins there, both (places, brackets); see `stencil`.
    previous
        Widths of the brackets before the last round.
    sections
        Their number, even.
    least
        Widths of brackets that need no more rounds.
    """
    low, width = ends[0], ends[1] - ends[0]
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # equal or infinite margins, or no bracket
        zero, apart = cubic_zero(*around)
        share, error = (zero - low) / width, np.maximum(_OFF * apart, least) / width
    # A share that is NaN fails both comparisons, so that such a bracket is divided equally.
    known = (share > 0.0) & (share < 1.0) & (width * (sections - 1) < previous)
    # On each side, the last of sections/2 − 1 places then lies within the likely error of the zero.
    ratio = np.clip(np.where(known, error, 1.0), *_NEAREST) ** (-2.0 / (sections - 2))
    even = np.linspace(0.0, 1.0, sections + 1)[1:-1, np.newaxis]
    return low + np.where(known, falling(np.where(known, share, 0.5), ratio, sections), even) * width


def falling(share: FloatArray, ratio: FloatArray, sections: int) -> FloatArray:
    """Shares of brackets, and others on either side at distances that fall by a ratio; (sections − 1, brackets)."""
    reach = 1.0 - ratio ** -np.arange(1.0, sections // 2)[:, np.newaxis]
    return np.concatenate([share * reach, [share], 1.0 - (1.0 - share) * reach[::-1]])


def cubic_zero(places: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The place of value 0 on a cubic through four places and values (4, …), and how far its parabolas differ."""
    # Neville's scheme for places as polynomials of the value: their values at 0 need no search for a root.
    zeros = list(places)
    for order in range(1, len(places)):
        apart = np.abs(zeros[0] - zeros[1])
        zeros = [
            (values[k + order] * zeros[k] - values[k] * zeros[k + 1]) / (values[k + order] - values[k])
            for k in range(len(zeros) - 1)
        ]
    return zeros[0], apart
