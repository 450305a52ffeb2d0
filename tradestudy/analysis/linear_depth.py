"""Propagation without draws: noise alone, exactly; and the covariance of all errors through the exact Jacobian."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from tradestudy.analysis.depth_distribution import DepthDistribution, share_of_true_matches
from tradestudy.analysis.depth_draws import MeasuresDepth, fixed_errors, read_draws, uncertain_groups
from tradestudy.analysis.error_radius import error_radius, last_scores
from tradestudy.cameras.depth_measurement import PIXEL_NOISE, FieldPosition
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.evaluation import depth_from_inverse
from tradestudy.uncertainty.sources import Sources

# Central differences over this many standard deviations: far above rounding, with a truncation error of a millionth of
# the third-order term.
_STEP: Final = 1e-3
_LEAST_NOISE_PX: Final = 1e-3  # smallest step of the noise; a smaller one would be lost in rounding
_NEVER: Final = 1e-18
_FARTHEST_SCORE: Final = 9.0  # the probability beyond it is below 1e-18
_ROUNDS: Final = 7  # to 1e-7 of a standard deviation


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearisedDepth:
    """Inverse depth, linearised in every uncertain parameter.

    Parameters
    ----------
    parameters
        Names of the parameters.
    covariance
        Covariance of the parameters, square, in their units; noise is in units of its own standard deviation.
    sensitivity
        Derivative of inverse depth with respect to each parameter [1/m per unit], shape (parameters, distances).
    """

    parameters: tuple[str, ...]
    covariance: FloatArray
    sensitivity: FloatArray

    @property
    def standard_deviation(self) -> FloatArray:
        """Standard deviation of inverse depth, √(JᵀVJ) [1/m]."""
        variance = np.einsum("pd,pq,qd->d", self.sensitivity, self.covariance, self.sensitivity)
        # With a correlation of ±1 rounding can make the variance slightly negative.
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def without(self, name: str) -> LinearisedDepth:
        """Leave one parameter out."""
        kept = [k for k, own in enumerate(self.parameters) if own != name]
        return LinearisedDepth(
            parameters=tuple(self.parameters[k] for k in kept),
            covariance=self.covariance[np.ix_(kept, kept)],
            sensitivity=self.sensitivity[kept],
        )


@lru_cache(maxsize=128)
def _covariance(camera: MeasuresDepth, error_source: str) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Names, means and covariance of the uncertain parameters."""
    sources = Sources(groups=uncertain_groups(camera, error_source))
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


@lru_cache(maxsize=128)
def has_covariance(camera: MeasuresDepth) -> bool:
    """Whether every uncertain parameter of a camera has a variance, as a linear model needs."""
    return all(group.covariance is not None for group in camera.calibration.groups)


def linearised_depth(
    camera: MeasuresDepth, distance: FloatArray, field: FieldPosition, error_source: str = "both"
) -> LinearisedDepth:
    """Linearise the depth measurement of a camera at distances [m] about the means of its errors.

    Raises
    ------
    OutOfRangeError
        An uncertain parameter has no variance.
    """
    return _linearised(camera, np.asarray(distance, dtype=np.float64).tobytes(), field, error_source)


@lru_cache(maxsize=4)
def _linearised(camera: MeasuresDepth, distances: bytes, field: FieldPosition, error_source: str) -> LinearisedDepth:
    """The linear model, cached because limits, ratios and tables of a camera request it repeatedly."""
    distance = np.frombuffer(distances)
    names, mean, covariance = _covariance(camera, error_source)
    deviation = np.sqrt(np.diag(covariance))
    moving = np.flatnonzero(deviation > 0.0)
    step = np.broadcast_to(_STEP * deviation[:, None], (deviation.size, distance.size)).copy()
    noise = camera.noise(distance, field)
    if PIXEL_NOISE in names:  # in units of its own standard deviation
        step[names.index(PIXEL_NOISE)] *= np.maximum(1.0, _LEAST_NOISE_PX * camera.sample_pitch / noise)
    values = fixed_errors(camera, error_source)
    for k in np.flatnonzero((deviation > 0.0) | (mean != 0.0)):
        acts = (moving == k)[:, None] * (step[k] if names[k] == PIXEL_NOISE else step[k, :1])
        values[names[k]] = mean[k] + np.concatenate([acts, -acts])
    sensitivity = np.zeros((len(names), distance.size))
    if moving.size:
        read = read_draws(camera, values, distance, field, noise)
        sensitivity[moving] = (read[: moving.size] - read[moving.size :]) / (2.0 * step[moving])
    sensitivity.setflags(write=False)  # shared by the cache
    return LinearisedDepth(parameters=names, covariance=covariance, sensitivity=sensitivity)


def linear_distribution(
    camera: MeasuresDepth, distance: FloatArray, field: FieldPosition, error_source: str, false_matches: float = 0.0
) -> DepthDistribution:
    """The distribution of depth, with all errors treated as additional noise.

    Inverse depth is linear in all errors. The ratio of its standard deviation to that from noise alone scales the
    noise with which the ends of intervals are computed, so noise alone is treated exactly.
    """
    line = linearised_depth(camera, distance, field)
    noise = np.abs(line.sensitivity[line.parameters.index(PIXEL_NOISE)])
    included = line if error_source == "both" else line.without(PIXEL_NOISE)
    return scaled_noise(camera, distance, field, included.standard_deviation / noise, false_matches)


def noise_distribution(
    camera: MeasuresDepth, distance: FloatArray, field: FieldPosition, false_matches: float = 0.0
) -> DepthDistribution:
    """The exact distribution of depth under noise alone: quantiles of disparity map to quantiles of depth."""
    return scaled_noise(camera, distance, field, np.ones(distance.shape), false_matches)


def scaled_noise(
    camera: MeasuresDepth, distance: FloatArray, field: FieldPosition, scale: FloatArray, false_matches: float = 0.0
) -> DepthDistribution:
    """The distribution of depth under noise multiplied by a scale (distances,)."""
    from scipy.special import ndtr, ndtri

    probabilities = camera.propagation.probabilities
    scores = -ndtri(np.array(probabilities))[:, None] * scale
    depths = depth_from_inverse(_under_noise(camera, distance, field, scores))
    seen = ~np.isnan(depths).any(axis=0)

    def failures() -> FloatArray:
        score = _score_of_infinity(camera, distance, field, _FARTHEST_SCORE * np.nan_to_num(np.maximum(scale, 1.0)))
        shares = ndtr(score / np.where(scale > 0.0, scale, _FARTHEST_SCORE**-2))
        failed = np.where(shares > _NEVER, shares, 0.0)
        return np.where(seen, failed, np.nan)[None]

    def radii() -> FloatArray:
        def read(scores: FloatArray) -> FloatArray:
            return depth_from_inverse(_under_noise(camera, distance, field, scores * scale))

        found = error_radius(read, distance, share_of_true_matches(false_matches))
        return np.where(seen, found, np.nan)[None]

    return DepthDistribution(
        probabilities=probabilities,
        quantiles=np.where(seen, depths, np.nan)[None],
        failures=failures,
        radii=radii,
        false_matches=false_matches,
    )


def _under_noise(camera: MeasuresDepth, distance: FloatArray, field: FieldPosition, scores: FloatArray) -> FloatArray:
    """Inverse depth [1/m] measured with the noise at given scores, shape (scores, distances)."""
    errors = {**fixed_errors(camera, "noise"), PIXEL_NOISE: scores}
    return read_draws(camera, errors, distance, field, camera.noise(distance, field))


def _score_of_infinity(
    camera: MeasuresDepth, distance: FloatArray, field: FieldPosition, reach: FloatArray
) -> FloatArray:
    """The score of the noise at which depth reads infinity, by subdivision; ∓reach (distances,) if it lies beyond."""
    beyond = _under_noise(camera, distance, field, np.stack([-reach, reach])) <= 0.0
    found = np.where(beyond[1], reach, -reach)
    open_ = np.flatnonzero(beyond[0] & ~beyond[1])
    if open_.size:
        low, high = last_scores(
            -reach[open_],
            reach[open_],
            lambda scores: _under_noise(camera, distance[open_], field, scores) <= 0.0,
            rounds=_ROUNDS,
        )
        found[open_] = 0.5 * (low + high)
    return np.asarray(found)
