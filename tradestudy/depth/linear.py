"""Propagation without draws: noise alone, exactly; and the covariance of all errors through the exact Jacobian."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Final

import numpy as np

from tradestudy.cameras.calibration import ONE_SIGMA
from tradestudy.cameras.depth_camera import DepthCamera, false_match_share
from tradestudy.cameras.depth_measurement import PIXEL_NOISE, FieldPosition
from tradestudy.depth.distribution import (
    FARTHEST_SCORE,
    DepthDistribution,
    error_radius,
    last_score,
    share_of_true_matches,
)
from tradestudy.depth.draws import MeasuresDepth, fixed_errors, read_draws, uncertain_groups
from tradestudy.depth.remembered import remembered
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.distributions import Normal
from tradestudy.uncertainty.evaluation import depth_from_inverse
from tradestudy.uncertainty.joint import GaussianCopula, JointDraws, JointNormal
from tradestudy.uncertainty.sources import Source, Sources

# Central differences over this many standard deviations: so far above rounding that it changes uncertainties by some
# 1e-12, which leaves them smooth for solvers, with a truncation error of a ten-thousandth of the third-order term.
_STEP: Final = 1e-2
_LEAST_NOISE_PX: Final = 1e-2  # smallest step of the noise; a smaller one would be lost in rounding
_NEVER: Final = 1e-18  # smaller failed shares, of scores near the farthest one or beyond it, count as 0
_INFINITY_TO: Final = 1e-7  # of a standard deviation, with linear interpolation within
_ROUNDING: Final = 1e-15  # of the largest score
# Of the largest score: where a camera without noise measures nothing, because of biased errors, larger scores may.
_TRIED: Final = np.array([-1.0, 0.0, *0.5 ** np.arange(5.0, -1.0, -1.0)])

Reader = Callable[[FloatArray], FloatArray]
"""Inverse depth [1/m] at scores (dimensions, points, distances or 1), shape (points, distances)."""


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
        kept = [k for k, parameter in enumerate(self.parameters) if parameter != name]
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


@remembered(4)  # limits, ratios and tables of a camera request it repeatedly
def linearised_depth(
    camera: MeasuresDepth, distance: FloatArray, field: FieldPosition, error_source: str = "both", /
) -> LinearisedDepth:
    """Linearise the depth measurement of a camera at distances [m] about the means of its errors.

    Raises
    ------
    OutOfRangeError
        An uncertain parameter has no variance.
    """
    names, mean, covariance = _covariance(camera, error_source)
    deviation = np.sqrt(np.diag(covariance))
    moving = np.flatnonzero(deviation > 0.0)
    step = np.broadcast_to(_STEP * deviation[:, None], (deviation.size, distance.size)).copy()
    noise = camera.noise(distance, field)
    if PIXEL_NOISE in names:  # in units of its own standard deviation
        step[names.index(PIXEL_NOISE)] *= np.maximum(1.0, _LEAST_NOISE_PX * camera.sample_pitch / noise)
    values = fixed_errors(camera, error_source)
    # Each draw moves one parameter up or down, so that one reading of the camera gives all differences. Only the noise
    # has a step of its own at each distance, and parameters that stay zero are left out.
    for k in np.flatnonzero((deviation > 0.0) | (mean != 0.0)):
        moved = (moving == k)[:, None] * (step[k] if names[k] == PIXEL_NOISE else step[k, :1])
        values[names[k]] = mean[k] + np.concatenate([moved, -moved])
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
    # Where the image lies exactly on the microlenses, depth does not depend on disparity and is not measured.
    scale = np.divide(included.standard_deviation, noise, out=np.full(noise.shape, np.nan), where=noise > 0.0)
    return scaled_noise(camera, distance, field, scale, false_matches)


def noise_distribution(
    camera: MeasuresDepth, distance: FloatArray, field: FieldPosition, false_matches: float = 0.0
) -> DepthDistribution:
    """The exact distribution of depth under noise alone: quantiles of disparity map to quantiles of depth."""
    return scaled_noise(camera, distance, field, np.ones(distance.shape), false_matches)


def scaled_noise(
    camera: MeasuresDepth, distance: FloatArray, field: FieldPosition, scale: FloatArray, false_matches: float = 0.0
) -> DepthDistribution:
    """The distribution of depth under noise multiplied by a scale (distances,)."""
    from scipy.special import ndtri

    probabilities = camera.propagation.probabilities
    under_noise = _under_noise(camera, distance, field)
    # Depth falls as the noise rises, so the probabilities of near depths belong to high scores.
    depths = depth_from_inverse(under_noise(-ndtri(np.array(probabilities))[:, None] * scale))
    seen = ~np.isnan(depths).any(axis=0)

    def failures() -> FloatArray:
        return np.where(seen, _failed_share(under_noise, scale), np.nan)[None]

    def radii() -> FloatArray:
        radius = error_radius(
            lambda scores: depth_from_inverse(under_noise(scores * scale)),
            distance,
            share_of_true_matches(false_matches),
        )
        return np.where(seen, radius, np.nan)[None]

    return DepthDistribution(
        probabilities=probabilities,
        quantiles=np.where(seen, depths, np.nan)[None],
        failures=failures,
        radii=radii,
        false_matches=false_matches,
    )


def _under_noise(
    camera: MeasuresDepth, distance: FloatArray, field: FieldPosition
) -> Callable[[FloatArray], FloatArray]:
    """Gives the inverse depth [1/m] measured with the noise at given scores, shape (scores, distances)."""
    fixed, noise = fixed_errors(camera, "noise"), camera.noise(distance, field)
    return lambda scores: read_draws(camera, {**fixed, PIXEL_NOISE: scores}, distance, field, noise)


def _failed_share(read: Reader, scale: FloatArray, to: float = _INFINITY_TO) -> FloatArray:
    """Probability that a normal score of standard deviation ``scale`` (distances,) gives no finite depth.

    Inverse depth rises with the score from infinity on. Failures lie below that score and, where a large score turns
    rays out of the field of a lens or sideways, also above another one; both are found by subdivision, to within
    ``to``.
    """
    from scipy.special import ndtr

    reach = FARTHEST_SCORE * np.nan_to_num(np.fmax(scale, 1.0))
    tried = _TRIED[:, np.newaxis] * reach
    inverse = read(tried)
    measured = inverse[1:] > 0.0
    first = 1 + np.argmax(measured, axis=0), np.arange(reach.size)
    ends = np.stack(
        [
            _end_of_failures(read, reach, tried[first], inverse[first], inverse[0], to),
            _end_of_failures(lambda scores: read(-scores), reach, -tried[first], inverse[first], inverse[-1], to),
        ]
    )
    # Without any error, a measurement fails always or never, by the sign of the score: a small scale gives 1 or 0.
    shares = ndtr(ends / np.where(scale > 0.0, scale, FARTHEST_SCORE**-2))
    return np.where(measured.any(axis=0), np.where(shares > _NEVER, shares, 0.0).sum(axis=0), 1.0)


def _end_of_failures(
    read: Reader, reach: FloatArray, measured: FloatArray, inverse: FloatArray, lowest: FloatArray, to: float
) -> FloatArray:
    """The score below which measurements fail (distances,); −reach if none do.

    ``inverse`` is read at the score ``measured``, below which the failures lie, and ``lowest`` at −reach.
    """

    def margin(scores: FloatArray, inverse: FloatArray) -> FloatArray:
        # Where no depth is read, and beyond the score that is measured, the distance from it stands in.
        stands_in = np.isnan(inverse) | (inverse == 0.0) | ((inverse < 0.0) & (scores >= measured))
        return np.where(stands_in, measured - scores, -inverse)

    fails = ~(lowest > 0.0) & (inverse > 0.0)
    if not fails.any():
        return -reach
    highest = margin(-reach, lowest)
    line = (measured + reach) * np.where(fails, highest, 0.0) / np.where(fails, highest + inverse, 1.0) - reach
    ends, margins = last_score(
        reach,
        lambda scores: margin(scores, read(scores))[:, np.newaxis],
        to=np.maximum(to, _ROUNDING * reach),  # among scores in the billions, rounding is larger
        estimate=line,
    )
    above, below = margins[:, 0]
    share = np.divide(above, above - below, out=np.full(reach.shape, 0.5), where=above > below)
    return np.where(fails, ends[0] + share * (ends[1] - ends[0]), -reach)


_SECOND_STEP: Final = 1e-2  # standard deviations, for the gradient
_SECOND_TO: Final = 0.07  # standard deviations, with linear interpolation within
_UNCERTAIN: Final = 0.5  # of the changes of half widths due to mean and variance across the steepest direction
_MEDIAN: Final = 1e-9  # largest score of a median, up to rounding


@dataclass(frozen=True, kw_only=True, eq=False)
class SecondOrder:
    """The distribution to second order, over distances.

    Parameters
    ----------
    expected
        Quantiles of depth; a single scramble. Failures are those along the steepest direction of all errors.
    uncertain
        Share of a half width by which the exact distribution could be wider or narrower.
    """

    expected: DepthDistribution
    uncertain: FloatArray


def second_order(
    camera: DepthCamera, distance: FloatArray, field: FieldPosition, error_source: str, *, any_shape: bool = False
) -> SecondOrder | None:
    """Evaluate depth exactly along the direction in which errors change it most, and to second order across it.

    In standard deviations of independent normal errors, inverse depth is ``h(z) = h₀ + g·z + ½ zᵀKz``. Its quantiles
    are those along g (first-order reliability), each shifted by the curvature across g (second-order reliability).

    Parameters
    ----------
    camera
        The camera with its exact model and its errors.
    distance
        True distances [m] where the camera forms an image.
    field
        Field position.
    error_source
        The errors considered: ``noise``, ``calibration`` or ``both``.
    any_shape
        Whether to treat non-normal errors through their normal scores; the result then only distinguishes a large error
        of the linear model from a small one.

    Returns
    -------
    SecondOrder | None
        None if an error is not normal: then only draws give the error.
    """
    groups = uncertain_groups(camera, error_source)
    if not all(_is_normal(group) or (any_shape and not isinstance(group, JointDraws)) for group in groups):
        return None
    sources = Sources(groups=groups)
    count = max(1, sources.dimensions)  # without any errors, one direction without effect

    def read(scores: FloatArray) -> FloatArray:
        # The steepest direction depends on the distance, so every distance has errors of its own.
        at_distances = np.broadcast_to(scores, (count, scores.shape[1], distance.size))
        drawn = sources.draw(at_distances.reshape(count, -1)[: sources.dimensions])
        values = {name: errors.reshape(at_distances.shape[1:]) for name, errors in drawn.items()}
        inverse = read_draws(
            camera, {**fixed_errors(camera, error_source), **values}, distance, field, camera.noise(distance, field)
        )
        return np.broadcast_to(inverse, at_distances.shape[1:])

    axes = np.eye(count)[:, :, np.newaxis]
    above, below = _read_together(read, _SECOND_STEP * axes, -_SECOND_STEP * axes)
    gradient = (above - below) / (2.0 * _SECOND_STEP)
    length = np.linalg.norm(gradient, axis=0)
    steepest = np.divide(gradient, length, out=np.zeros_like(gradient), where=length > 0.0)
    along, moved, spread = _quantiles(camera, read, steepest, length)

    false_matches = false_match_share(camera, error_source)

    def failed_along() -> FloatArray:
        return _failed_share(lambda scores: read(scores * steepest[:, np.newaxis]), np.ones(distance.shape), _SECOND_TO)

    def with_quantiles(inverse: FloatArray) -> DepthDistribution:
        unseen = np.isnan(inverse).any(axis=0)
        depths = np.where(unseen, np.nan, depth_from_inverse(inverse))
        read_between = partial(_between, camera, inverse)

        def radii() -> FloatArray:
            radius = error_radius(read_between, distance, share_of_true_matches(false_matches))
            return np.where(unseen, np.nan, radius)[np.newaxis]

        return DepthDistribution(
            probabilities=camera.propagation.probabilities,
            quantiles=depths[np.newaxis],
            failures=lambda: np.where(np.isnan(along).any(axis=0), np.nan, failed_along())[np.newaxis],
            radii=radii,
            false_matches=false_matches,
        )

    expected = with_quantiles(along + moved + spread)
    width = expected.half_widths(ONE_SIGMA)[0]
    # Neglected higher orders are taken to change a width by at most a share of what these two shifts do.
    without = [with_quantiles(inverse).half_widths(ONE_SIGMA)[0] for inverse in (along + moved, along + spread)]
    with np.errstate(invalid="ignore", divide="ignore"):
        changes = [np.where(width == other, 0.0, np.abs(np.log(width / other))) for other in without]
    uncertain = _UNCERTAIN * np.sum(changes, axis=0)
    return SecondOrder(expected=expected, uncertain=np.nan_to_num(uncertain, nan=np.inf, posinf=np.inf))


def all_normal(camera: DepthCamera) -> bool:
    """Whether every error of a camera is normal, so that second order describes its depth."""
    return all(map(_is_normal, uncertain_groups(camera, "both")))


def _is_normal(group: object) -> bool:
    if isinstance(group, GaussianCopula):
        return all(isinstance(marginal, Normal) for marginal in group.marginals)
    return isinstance(group, JointNormal) or (isinstance(group, Source) and isinstance(group.distribution, Normal))


def _read_together(read: Reader, *scores: FloatArray) -> list[FloatArray]:
    """Evaluate several sets of scores in one call, which takes hardly longer than one set alone."""
    ends = np.cumsum([points.shape[1] for points in scores])
    return np.split(read(np.concatenate(scores, axis=1)), ends[:-1])


def _quantiles(
    camera: DepthCamera, read: Reader, steepest: FloatArray, length: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Quantiles of inverse depth [1/m] along the steepest direction; their shifts due to mean and variance across it.

    Where the other errors add the mean m(u) and the variance s²(u) at the score u along it, the quantile at u moves by
    ``m + (u s² − ds²/du)/(2 |g|)``. Curvature K across gives ``m = ½ tr K`` and ``s² = ½ ‖K‖² + Σ d²``, with the slopes
    d across, which grow with u.
    """
    from scipy.special import ndtri

    probabilities = camera.propagation.probabilities
    scores = -ndtri(np.array(probabilities))[:, np.newaxis]
    # Orthonormal vectors perpendicular to each direction, shape (dimensions, others, distances).
    across = np.moveaxis(np.linalg.svd(steepest.T[:, np.newaxis])[2][:, 1:], 0, 2).swapaxes(0, 1)
    dimensions, others, distances = across.shape
    ahead = scores * steepest[:, np.newaxis]
    right, left = (
        (ahead[:, :, np.newaxis] + side[:, np.newaxis]).reshape(dimensions, -1, distances) for side in (across, -across)
    )
    first, second = np.triu_indices(others, k=1)
    along, right, left, pairs = _read_together(read, ahead, right, left, across[:, first] + across[:, second])
    right, left = (inverse.reshape(len(probabilities), others, distances) for inverse in (right, left))
    curvature = right + left - 2.0 * along[:, np.newaxis]
    median = len(probabilities) // 2
    mixed = pairs - right[median, first] - right[median, second] + along[median]
    slopes = np.sum(((right - left) / 2.0) ** 2, axis=1)
    # ‖K‖² contains every mixed derivative twice; it is computed at the median alone.
    variance = slopes + 0.5 * np.sum(curvature[median] ** 2, axis=0) + np.sum(mixed**2, axis=0)
    # The slopes d are proportional to u, so the derivative of Σ d² is 2 Σ d² / u, and 0 at the median.
    growth = np.divide(2.0 * slopes, scores, out=np.zeros_like(slopes), where=np.abs(scores) > _MEDIAN)
    spread = scores * variance - growth
    with np.errstate(invalid="ignore", divide="ignore"):
        # Where no error changes depth, there is nothing to spread and no direction either.
        spread = np.divide(spread, 2.0 * length, out=np.zeros_like(spread), where=spread != 0.0)
    return along, 0.5 * np.sum(curvature, axis=1), spread


def _between(camera: DepthCamera, inverse: FloatArray, scores: FloatArray) -> FloatArray:
    """Depth [m] at scores, by the polynomial through the quantiles of inverse depth, constant beyond them."""
    from scipy.special import ndtri

    nodes = -ndtri(np.array(camera.propagation.probabilities))
    within = np.clip(scores, nodes[-1], nodes[0])
    powers = np.linalg.solve(np.vander(nodes), inverse)
    between = np.zeros(within.shape)
    for power in powers:
        between = between * within + power
    return depth_from_inverse(between)
