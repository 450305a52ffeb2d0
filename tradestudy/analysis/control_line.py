"""A linear control variate for inverse depth: its quantiles are known, so its sampling error corrects that of depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.analysis.error_radius import without_rounding
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.evaluation import depth_from_inverse
from tradestudy.uncertainty.outputs import quantiles_of

_FIT_DRAWS: Final = 2**14  # draws used to fit the line
_ROWS: Final = 512  # quantiles that represent the rows of a posterior
_BISECTIONS: Final = 30
_WIDER: Final = 4.0  # times the largest sampled radius; the exact one is smaller
_ALIKE: Final = 1e-12
_REACH: Final = 9.0  # standard deviations; the probability beyond is below 1e-18


@dataclass(frozen=True, kw_only=True, eq=False)
class Drivers:
    """The variables that the line for inverse depth depends on.

    Parameters
    ----------
    scores
        Standard normal scores of each draw, shape (scores, draws).
    responses
        For each draw, the effect of its posterior row on inverse depth from near to far, shape (directions, draws);
        empty without a posterior.
    rows
        The same effect for every row of the posterior, shape (directions, rows).
    """

    scores: FloatArray
    responses: FloatArray
    rows: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class SamplingError:
    """Sampling errors, in each scramble, of the line's quantiles, share at or beyond infinity, and radius of error [m].

    Shapes (scrambles, probabilities, distances) for the quantiles, otherwise (scrambles, distances).
    """

    quantiles: FloatArray
    failed: FloatArray
    radius: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Within:
    """The share of draws that a radius about the true distances [m] contains."""

    distance: FloatArray
    share: float

    def radius(self, inverse: FloatArray) -> FloatArray:
        """Radius [m] of draws of inverse depth (distances, draws); those without a depth are infinitely wrong."""
        if self.share >= 1.0:
            return np.full(self.distance.shape, np.inf)
        wrong = np.abs(depth_from_inverse(inverse) - self.distance[:, np.newaxis])
        return without_rounding(quantiles_of(np.where(np.isnan(wrong), np.inf, wrong), self.share), self.distance)


def sampling_error(
    inverse: FloatArray, drivers: Drivers, scrambles: int, probabilities: FloatArray, within: Within
) -> SamplingError:
    """Sampling error, in each scramble, of quantiles, failed share and radius of a line fitted to inverse depth.

    Parameters
    ----------
    inverse
        Inverse depths of all draws, shape (distances, draws); no line is fitted at distances with a NaN.
    drivers
        The variables of the line, which is fitted by least squares.
    scrambles
        Number of scrambles, which follow one another in the draws.
    probabilities
        Probabilities of the quantiles.
    within
        The true distances, and the share of draws within the radius.
    """
    known = np.concatenate([drivers.scores, drivers.responses])
    ranked = np.where(np.isnan(inverse).any(axis=1, keepdims=True), 0.0, inverse)
    slopes = _slopes(ranked, known)
    of_scores, of_rows = slopes[:, : len(drivers.scores)], slopes[:, len(drivers.scores) :]
    deviation = np.linalg.norm(of_scores, axis=1)
    rows = of_rows @ drivers.rows
    exact, lines = _quantiles_of_line(rows, deviation, probabilities), np.split(slopes @ known, scrambles, axis=1)
    infinity = -ranked.mean(axis=1, keepdims=True)
    beyond = _share_below(rows, deviation, infinity)
    middle = -infinity - np.mean(lines, axis=(0, 2))[:, np.newaxis]
    radii = np.stack([within.radius(middle + line) for line in lines])
    return SamplingError(
        quantiles=np.stack([quantiles_of(line, probabilities) - exact for line in lines]),
        failed=np.stack([np.mean(line <= infinity, axis=1) - beyond for line in lines]),
        radius=_error_of_radii(radii, within, rows, deviation, middle),
    )


def _error_of_radii(
    radii: FloatArray, within: Within, rows: FloatArray, deviation: FloatArray, middle: FloatArray
) -> FloatArray:
    """Sampled radii (scrambles, distances) of a line about its middle [1/m], less the exact ones; 0 where infinite."""
    finite, distance = np.isfinite(radii), within.distance[:, np.newaxis]
    low, high = np.zeros(distance.shape), _WIDER * np.max(np.where(finite, radii, 0.0), axis=0)[:, np.newaxis]
    some = rows if rows.shape[1] <= _ROWS else quantiles_of(rows, (np.arange(_ROWS) + 0.5) / _ROWS).T
    for _ in range(_BISECTIONS):
        radius = 0.5 * (low + high)
        with np.errstate(divide="ignore"):
            nearest = 1.0 / np.maximum(distance - radius, 0.0)
        near, far = (_share_below(some, deviation, end - middle) for end in (nearest, 1.0 / (distance + radius)))
        below = (near - far)[:, np.newaxis] < within.share
        low, high = np.where(below, radius, low), np.where(below, high, radius)
    return np.where(finite, radii, 0.0) - np.where(finite, 0.5 * (low + high)[:, 0], 0.0)


def _slopes(inverse: FloatArray, known: FloatArray) -> FloatArray:
    some = slice(None, None, max(1, known.shape[1] // _FIT_DRAWS))
    centred = known[:, some] - known[:, some].mean(axis=1, keepdims=True)
    size = np.linalg.norm(centred, axis=1, keepdims=True)
    unit = centred / np.where(size > 0.0, size, 1.0)
    # Directions of a posterior are nearly parallel; combinations that the draws cannot distinguish are left out.
    inverted = np.linalg.pinv(unit @ unit.T, rcond=_ALIKE, hermitian=True)
    return np.asarray((inverse[:, some] @ unit.T @ inverted) / np.where(size > 0.0, size, 1.0)[:, 0])


def _share_below(rows: FloatArray, deviation: FloatArray, limit: FloatArray) -> FloatArray:
    """Probability that a row plus a normal error is at most a limit; all ``rows`` (distances, rows) weigh the same."""
    from scipy.special import ndtr

    own = rows if rows.shape[1] else np.zeros_like(limit)
    spread = deviation[:, None]
    smooth = ndtr((limit - own) / np.where(spread > 0.0, spread, 1.0))
    return np.asarray(np.mean(np.where(spread > 0.0, smooth, own <= limit), axis=1))


def _quantiles_of_line(rows: FloatArray, deviation: FloatArray, probabilities: FloatArray) -> FloatArray:
    """Quantiles (probabilities, distances) of a row plus a normal error; all ``rows`` weigh the same."""
    from scipy.special import ndtr, ndtri

    if not rows.shape[1]:
        return np.asarray(ndtri(probabilities)[:, None] * deviation)
    ascending = np.sort(rows, axis=1)
    if not np.any(deviation > 0.0):
        return quantiles_of(ascending, probabilities)
    middle = quantiles_of(ascending, (np.arange(_ROWS) + 0.5) / _ROWS)
    scale = np.where(deviation > 0.0, deviation, np.finfo(float).tiny)
    p = probabilities[:, None]
    low = np.broadcast_to(middle[0] - _REACH * deviation, (probabilities.size, deviation.size))
    high = np.broadcast_to(middle[-1] + _REACH * deviation, low.shape)
    for _ in range(_BISECTIONS):
        x = 0.5 * (low + high)
        below = np.mean(ndtr((x - middle[:, None]) / scale), axis=0) < p
        low, high = np.where(below, x, low), np.where(below, high, x)
    return np.asarray(0.5 * (low + high))
