"""Propagation without draws: noise alone, exactly; and the covariance of everything through the exact Jacobian."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from tradestudy.analysis.depth_distribution import DepthDistribution
from tradestudy.analysis.depth_draws import fixed_errors, nominal_inverse, read_draws, uncertain_groups
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.error_vocabulary import PIXEL_NOISE
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.evaluation import depth_from_inverse
from tradestudy.uncertainty.sources import Sources

# Central differences over so many standard deviations: far above rounding, and with a truncation error of a
# millionth of the third-order term.
_STEP: Final = 1e-3
_FARTHEST_SCORE: Final = 9.0  # beyond it the probability is below 1e-18
_BISECTIONS: Final = 50


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearReading:
    """Inverse depth as a line in every uncertain parameter.

    Parameters
    ----------
    parameters
        Their names.
    covariance
        Of the parameters, square, in their units; the noise counts in its own standard deviations.
    inverse_depth
        Read with every error at its mean [1/m], shape (distances,).
    sensitivity
        Its change with each parameter [1/m per unit], shape (parameters, distances).
    """

    parameters: tuple[str, ...]
    covariance: FloatArray
    inverse_depth: FloatArray
    sensitivity: FloatArray

    @property
    def standard_deviation(self) -> FloatArray:
        """Of inverse depth, √(JᵀVJ) [1/m]."""
        variance = np.einsum("pd,pq,qd->d", self.sensitivity, self.covariance, self.sensitivity)
        # A correlation of ±1 can cancel the variance to a rounding below zero.
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


@lru_cache(maxsize=128)
def _covariance(camera: DepthCamera, way: str) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Names, means and covariance of what is drawn."""
    sources = Sources(groups=uncertain_groups(camera, way))
    covariance = sources.covariance()
    if covariance is None:
        missing = ", ".join(group.name for group in sources.groups if group.covariance is None)
        raise OutOfRangeError(
            "linear propagation needs standard deviations",
            value=f"{missing} has none",
            limit="distributions with a variance",
            remedy="propagate exactly, with effects.calibration: exact",
        )
    mean = np.concatenate([group.nominal for group in sources.groups]) if sources.groups else np.zeros(0)
    return sources.parameters, mean, covariance


def has_covariance(camera: DepthCamera) -> bool:
    """Whether everything uncertain about a camera has a variance, so that a line can be drawn."""
    return all(group.covariance is not None for group in camera.calibration.groups)


def linear_reading(camera: DepthCamera, distance: FloatArray, field: float, way: str = "both") -> LinearReading:
    """Linearise the reading of a camera at distances [m] about the means of its errors.

    Raises
    ------
    OutOfRangeError
        Something uncertain has no variance.
    """
    names, mean, covariance = _covariance(camera, way)
    deviation = np.sqrt(np.diag(covariance))
    moving = np.flatnonzero(deviation > 0.0)
    steps = np.zeros((moving.size, deviation.size))
    steps[np.arange(moving.size), moving] = _STEP * deviation[moving]
    points = mean + np.concatenate([steps, -steps])
    used = [k for k in range(len(names)) if deviation[k] > 0.0 or mean[k] != 0.0]
    values = {names[k]: points[:, [k]] for k in used} | fixed_errors(camera, way)
    sensitivity = np.zeros((len(names), distance.size))
    if moving.size:
        read = read_draws(camera, values, distance, field, camera.noise(distance))
        above, below = read[: moving.size], read[moving.size :]
        sensitivity[moving] = (above - below) / (2.0 * _STEP * deviation[moving, None])
    return LinearReading(
        parameters=names,
        covariance=covariance,
        inverse_depth=nominal_inverse(camera, distance, field),
        sensitivity=sensitivity,
    )


def linear_distribution(camera: DepthCamera, distance: FloatArray, field: float, way: str) -> DepthDistribution:
    """The distribution of depth where inverse depth is normal about its line; the ends of intervals mapped back."""
    line = linear_reading(camera, distance, field, way)
    return distribution_of_line(line.inverse_depth, line.standard_deviation, camera.propagation.probabilities)


def distribution_of_line(
    inverse_depth: FloatArray, deviation: FloatArray, probabilities: tuple[float, ...]
) -> DepthDistribution:
    """Of a normal inverse depth [1/m] of given mean and deviation: ``Z_p = 1/(w + Φ⁻¹(1 − p) u)``."""
    from scipy.special import ndtr, ndtri

    scores = ndtri(1.0 - np.array(probabilities))[:, None]
    known = np.where(deviation > 0.0, deviation, 1.0)
    sure = np.where(inverse_depth > 0.0, 0.0, np.where(np.isnan(inverse_depth), np.nan, 1.0))
    failed = np.where(deviation > 0.0, ndtr(-inverse_depth / known), sure)
    return DepthDistribution(
        probabilities=probabilities,
        quantiles=depth_from_inverse(inverse_depth + scores * deviation)[None],
        failed=np.where(np.isnan(deviation), np.nan, failed)[None],
    )


def noise_distribution(camera: DepthCamera, distance: FloatArray, field: float) -> DepthDistribution:
    """The exact distribution of depth under noise alone: depth falls with disparity, so that quantiles map.

    Infinity is reached at the score of the noise where the reading does, found by bisection to the last digits.
    """
    from scipy.special import ndtr, ndtri

    probabilities = camera.propagation.probabilities
    depths = depth_from_inverse(_under_noise(camera, distance, field, -ndtri(np.array(probabilities))[:, None]))
    seen = ~np.isnan(depths).any(axis=0)
    return DepthDistribution(
        probabilities=probabilities,
        quantiles=np.where(seen, depths, np.nan)[None],
        failed=np.where(seen, ndtr(_score_of_infinity(camera, distance, field)), np.nan)[None],
    )


def _under_noise(camera: DepthCamera, distance: FloatArray, field: float, scores: FloatArray) -> FloatArray:
    """Inverse depth [1/m] read where the noise has so many of its standard deviations, (scores, distances)."""
    errors = {**fixed_errors(camera, "noise"), PIXEL_NOISE: scores}
    return read_draws(camera, errors, distance, field, camera.noise(distance))


def _score_of_infinity(camera: DepthCamera, distance: FloatArray, field: float) -> FloatArray:
    """The score of the noise at which infinity is read, by bisection; ∓9 where it lies beyond."""
    ends = np.array([[-_FARTHEST_SCORE], [_FARTHEST_SCORE]])
    beyond = _under_noise(camera, distance, field, ends) <= 0.0
    found = np.where(beyond[1], _FARTHEST_SCORE, -_FARTHEST_SCORE)
    open_ = np.flatnonzero(beyond[0] & ~beyond[1])
    low, high = np.full(open_.size, -_FARTHEST_SCORE), np.full(open_.size, _FARTHEST_SCORE)
    for _ in range(_BISECTIONS if open_.size else 0):
        middle = 0.5 * (low + high)
        lost = _under_noise(camera, distance[open_], field, middle[None])[0] <= 0.0
        low, high = np.where(lost, middle, low), np.where(lost, high, middle)
    found[open_] = 0.5 * (low + high)
    return np.asarray(found)
